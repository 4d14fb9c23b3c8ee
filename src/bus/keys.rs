//! The key space: what is said where, below one prefix.

use crate::config::check_chunk;
use crate::error::Result;

/// Makes and reads keys below a prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    prefix: String,
}

/// Whose frames a key is for.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct FrameKey {
    pub robot_id: String,
    pub sensor_id: String,
}

impl FrameKey {
    /// Checks that both may be parts of a key.
    pub fn new(robot_id: &str, sensor_id: &str) -> Result<Self> {
        check_chunk("robot_id", robot_id)?;
        check_chunk("sensor_id", sensor_id)?;
        Ok(Self { robot_id: robot_id.into(), sensor_id: sensor_id.into() })
    }
}

impl Keys {
    /// Keys below `prefix`, which the settings have checked.
    pub fn new(prefix: &str) -> Self {
        Self { prefix: prefix.into() }
    }

    /// A key of a map.
    pub fn of_map(&self, map_id: &str, rest: &str) -> String {
        format!("{}/{map_id}/{rest}", self.prefix)
    }

    /// Where every sensor's frames for a map are put.
    pub fn all_frames(&self, map_id: &str) -> String {
        self.of_map(map_id, "in/*/*/frame")
    }

    /// Where one sensor's frames are put.
    pub fn frame(&self, map_id: &str, of: &FrameKey) -> String {
        self.of_map(map_id, &format!("in/{}/{}/frame", of.robot_id, of.sensor_id))
    }

    /// Whose frames `key` is for; `None` if it is no key of frames of this map.
    pub fn read_frame(&self, map_id: &str, key: &str) -> Option<FrameKey> {
        let rest = key.strip_prefix(&self.of_map(map_id, "in/"))?.strip_suffix("/frame")?;
        let (robot_id, sensor_id) = rest.split_once('/')?;
        FrameKey::new(robot_id, sensor_id).ok()
    }

    /// Where the acks of one sensor's frames are said.
    pub fn ack(&self, map_id: &str, of: &FrameKey) -> String {
        self.of_map(map_id, &format!("out/ack/{}/{}", of.robot_id, of.sensor_id))
    }

    /// Where every question about a map is asked.
    pub fn questions(&self, map_id: &str) -> String {
        self.of_map(map_id, "q/*")
    }

    /// Where a question is asked.
    pub fn question(&self, map_id: &str, verb: &str) -> String {
        self.of_map(map_id, &format!("q/{verb}"))
    }

    /// Where the state of a map is said, again and again.
    pub fn status(&self, map_id: &str) -> String {
        self.of_map(map_id, "out/status")
    }

    /// Where a slice of a map is said, again and again.
    pub fn slice(&self, map_id: &str, name: &str) -> String {
        self.of_map(map_id, &format!("out/slice/{name}"))
    }

    /// Where the news of a watch are said.
    pub fn watch(&self, map_id: &str, id: &str) -> String {
        self.of_map(map_id, &format!("out/watch/{id}"))
    }

    /// Whoever serves the map lives as long as this token.
    pub fn alive(&self, map_id: &str, id: &str) -> String {
        self.of_map(map_id, &format!("alive/{id}"))
    }
}

#[cfg(test)]
mod tests {
    use zenoh::key_expr::KeyExpr;

    use super::*;

    #[test]
    fn keys_are_those_of_the_interface() {
        let keys = Keys::new("fleet/orenx");
        let of = FrameKey::new("bot1", "front").expect("names");
        assert_eq!(keys.frame("default", &of), "fleet/orenx/default/in/bot1/front/frame");
        assert_eq!(keys.ack("default", &of), "fleet/orenx/default/out/ack/bot1/front");
        assert_eq!(keys.question("default", "points"), "fleet/orenx/default/q/points");
        assert_eq!(keys.status("default"), "fleet/orenx/default/out/status");
        assert_eq!(keys.alive("default", "a1"), "fleet/orenx/default/alive/a1");
        for expression in [keys.all_frames("default"), keys.questions("default")] {
            KeyExpr::try_from(expression).expect("canonical");
        }
    }

    #[test]
    fn a_key_of_frames_says_whose_they_are() {
        let keys = Keys::new("orenx");
        let of = FrameKey::new("bot 1", "front").expect("names");
        assert_eq!(keys.read_frame("default", &keys.frame("default", &of)), Some(of));
        for other in [
            "orenx/default/in/bot/frame",
            "orenx/default/in/bot/a/b/frame",
            "orenx/attic/in/bot/a/frame",
            "orenx/default/in/bot/a/frames",
            "orenx/default/in/*/a/frame",
        ] {
            assert_eq!(keys.read_frame("default", other), None, "{other}");
        }
    }

    #[test]
    fn names_that_cannot_be_keys_are_refused() {
        for (robot, sensor, field) in [
            ("a/b", "c", "robot_id"),
            ("", "c", "robot_id"),
            ("a", "c?", "sensor_id"),
            ("a", "@c", "sensor_id"),
            ("a", "c\n", "sensor_id"),
        ] {
            let error = FrameKey::new(robot, sensor).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
        }
    }
}
