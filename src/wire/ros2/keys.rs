//! Where topics and services are on Zenoh, and the liveliness tokens that make an endpoint visible to
//! `ros2 topic list`: of zenoh-bridge-ros2dds, and of rmw_zenoh.

use super::types::Type;
use crate::error::{Error, Result};

/// What stands for an empty part of rmw_zenoh's tokens, and for a slash.
const PERCENT: &str = "%";
/// What stands for a slash in the bridge's tokens.
const SECTION: &str = "§";
/// The qualities of service of rmw_zenoh's tokens: reliable, volatile, the last ten, everything else as
/// it comes.
const RMW_QOS: &str = "::,10:,:,:,,";
/// The bridge's: with a key or not, reliability (1: reliable), durability, history.
const BRIDGE_QOS: &str = ":1::";

/// What an endpoint does on its topic, or under its service's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    Publisher,
    Subscriber,
    Server,
}

impl Role {
    fn code(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscriber => "MS",
            Self::Server => "SS",
        }
    }
}

/// One of a node's publishers, subscribers or servers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint<'a> {
    pub role: Role,
    /// As ROS has it; outer slashes do not count.
    pub topic: &'a str,
    pub kind: Type,
    /// [`Type::hash`], or what its place is taken by.
    pub hash: &'a str,
}

/// The node that endpoints belong to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token<'a> {
    pub domain: u32,
    /// The id of the Zenoh session, in hexadecimal.
    pub session: &'a str,
    pub node: &'a str,
}

/// The key of a topic of a robot behind zenoh-bridge-ros2dds; `namespace` is the bridge's own.
pub fn bridge_key(namespace: &str, topic: &str) -> Result<String> {
    let topic = checked(topic)?;
    Ok(match namespace.trim_matches('/') {
        "" => topic.into(),
        namespace => format!("{}/{topic}", checked(namespace)?),
    })
}

/// The key of a topic of rmw_zenoh.
pub fn rmw_key(domain: u32, topic: &str, kind: &Type, hash: &str) -> Result<String> {
    Ok(format!("{domain}/{}/{}/{hash}", checked(topic)?, kind.dds_name))
}

/// The token of an endpoint behind the bridge. `key` is that of its topic.
pub fn bridge_token(session: &str, role: Role, key: &str, kind: &Type) -> String {
    let (code, key) = (role.code(), key.replace('/', SECTION));
    let kind = kind.name.replace('/', SECTION);
    let token = format!("@/{session}/@ros2_lv/{code}/{key}/{kind}");
    // Services have no qualities of their own.
    if role == Role::Server { token } else { format!("{token}/{BRIDGE_QOS}") }
}

/// The token of a node of rmw_zenoh, in the root namespace.
pub fn rmw_node_token(token: &Token<'_>) -> String {
    let Token { domain, session, node } = token;
    format!("@ros2_lv/{domain}/{session}/0/0/NN/{PERCENT}/{PERCENT}/{node}")
}

/// The token of the `index`-th endpoint (from 1) of a node of rmw_zenoh.
pub fn rmw_token(token: &Token<'_>, index: usize, endpoint: &Endpoint<'_>) -> Result<String> {
    let Token { domain, session, node } = token;
    let topic = checked(endpoint.topic)?.replace('/', PERCENT);
    Ok(format!(
        "@ros2_lv/{domain}/{session}/0/{index}/{}/{PERCENT}/{PERCENT}/{node}/\
         {PERCENT}{topic}/{}/{}/{RMW_QOS}",
        endpoint.role.code(),
        endpoint.kind.dds_name,
        endpoint.hash
    ))
}

/// A topic without its outer slashes. What Zenoh takes for a pattern is refused, and so are empty
/// parts.
fn checked(topic: &str) -> Result<&str> {
    let bare = topic.trim_matches('/');
    let is_part = |part: &str| {
        !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
    };
    if bare.len() > 255 || !bare.split('/').all(is_part) {
        let topic: String = topic.chars().take(64).collect();
        let problem = format!("'{topic}' is no name as in camera/depth/image_raw");
        return Err(Error::invalid("topic", problem));
    }
    Ok(bare)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_those_of_both_worlds() {
        assert_eq!(bridge_key("", "/camera/depth/image").expect("good"), "camera/depth/image");
        assert_eq!(bridge_key("/bot1", "/camera").expect("good"), "bot1/camera");
        assert_eq!(
            rmw_key(0, "/chatter", &Type::STRING, Type::STRING.hash).expect("good"),
            "0/chatter/std_msgs::msg::dds_::String_/\
             RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
        );
        for topic in ["", "/", "a//b", "a/*", "a b", "@a", "a#"] {
            bridge_key("", topic).expect_err(topic);
            rmw_key(0, topic, &Type::STRING, "*").expect_err(topic);
        }
    }

    #[test]
    fn tokens_are_those_of_both_worlds() {
        let token = Token { domain: 3, session: "a1b2", node: "orenx" };
        assert_eq!(rmw_node_token(&token), "@ros2_lv/3/a1b2/0/0/NN/%/%/orenx");
        let endpoint = Endpoint {
            role: Role::Publisher,
            topic: "/orenx/grid",
            kind: Type::OCCUPANCY_GRID,
            hash: "RIHS01_00",
        };
        assert_eq!(
            rmw_token(&token, 7, &endpoint).expect("good"),
            "@ros2_lv/3/a1b2/0/7/MP/%/%/orenx/%orenx%grid/nav_msgs::msg::dds_::OccupancyGrid_/\
             RIHS01_00/::,10:,:,:,,"
        );
        assert_eq!(
            bridge_token("a1b2", Role::Subscriber, "bot1/tf", &Type::TF_MESSAGE),
            "@/a1b2/@ros2_lv/MS/bot1§tf/tf2_msgs§msg§TFMessage/:1::"
        );
        let key = "nvblox_node/get_esdf_and_gradient";
        assert_eq!(
            bridge_token("a1b2", Role::Server, key, &Type::ESDF_SERVICE),
            "@/a1b2/@ros2_lv/SS/nvblox_node§get_esdf_and_gradient/nvblox_msgs§srv§EsdfAndGradients"
        );
        let server = Endpoint { role: Role::Server, kind: Type::ESDF_SERVICE, ..endpoint };
        let token = rmw_token(&token, 8, &server).expect("good");
        assert!(token.contains("/8/SS/%/%/orenx/%orenx%grid/nvblox_msgs::srv::dds_::EsdfAndG"));
    }

    #[test]
    fn types_are_spelled_in_both_ways() {
        assert_eq!(Type::IMAGE.name, "sensor_msgs/msg/Image");
        assert_eq!(Type::IMAGE.dds_name, "sensor_msgs::msg::dds_::Image_");
        assert_eq!(Type::ESDF_SERVICE.dds_name, "nvblox_msgs::srv::dds_::EsdfAndGradients_");
        assert!(Type::ALL.iter().all(|kind| kind.hash.len() == 71), "a hash is of 32 bytes");
    }
}
