//! Settings of ROS 2: which bridge, which topics come in and go out, and how they belong together.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// How often anything goes out at most.
const MAX_HZ: f64 = 100.0;

/// `[ros2]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Settings {
    pub bridge: String,
    pub domain: u32,
    pub namespace: String,
    pub type_hashes: bool,
    pub robot: String,
    pub sensor: String,
    pub depth: String,
    pub color: String,
    pub camera_info: String,
    pub rectified: bool,
    pub pose: String,
    pub tf: String,
    pub tf_static: String,
    pub map_frame: String,
    pub camera_frame: String,
    pub tolerance_ms: f64,
    pub wait_ms: u32,
    pub grid: String,
    pub distance: String,
    pub grid_hz: f64,
    pub grid_cell_m: f32,
    pub grid_low_m: f32,
    pub grid_high_m: f32,
    pub robot_radius_m: f32,
    pub cloud: String,
    pub cloud_hz: f64,
    pub image: String,
    pub image_depth: String,
    pub image_hz: f64,
    pub text: String,
    pub matches: String,
    pub esdf: String,
    pub esdf_voxel_m: f32,
}

impl Default for Ros2Settings {
    fn default() -> Self {
        Self {
            bridge: "off".into(),
            domain: 0,
            namespace: String::new(),
            type_hashes: true,
            robot: "ros2".into(),
            sensor: "camera".into(),
            depth: "/camera/depth/image_rect_raw".into(),
            color: String::new(),
            camera_info: "/camera/depth/camera_info".into(),
            rectified: true,
            pose: String::new(),
            tf: "/tf".into(),
            tf_static: "/tf_static".into(),
            map_frame: "map".into(),
            camera_frame: String::new(),
            tolerance_ms: 20.0,
            wait_ms: 500,
            grid: "/orenx/grid".into(),
            distance: "/orenx/distance_slice".into(),
            grid_hz: 2.0,
            grid_cell_m: 0.05,
            grid_low_m: 0.1,
            grid_high_m: 0.6,
            robot_radius_m: 0.0,
            cloud: "/orenx/cloud".into(),
            cloud_hz: 0.5,
            image: "/orenx/image".into(),
            image_depth: "/orenx/image_depth".into(),
            image_hz: 1.0,
            text: "/orenx/text".into(),
            matches: "/orenx/matches".into(),
            esdf: "/nvblox_node/get_esdf_and_gradient".into(),
            esdf_voxel_m: 0.05,
        }
    }
}

/// What stands between the robot and Zenoh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Bridge {
    /// zenoh-bridge-ros2dds, with its namespace.
    Dds { namespace: String },
    /// rmw_zenoh. Without hashes for ROS 2 Humble, which has none.
    Rmw { domain: u32, has_hashes: bool },
}

/// Topics that go out, at a rate, and what is answered; an empty one is not.
#[derive(Debug, Clone, PartialEq)]
pub struct Ros2Outputs {
    pub grid: Option<String>,
    pub distance: Option<String>,
    pub grid_interval: Duration,
    /// Edge of a cell of both, m.
    pub cell_m: f32,
    /// The band of heights that obstacles count in, m.
    pub band_m: (f32, f32),
    /// What is closer to an obstacle is occupied, m.
    pub radius_m: f32,
    pub cloud: Option<String>,
    pub cloud_interval: Duration,
    pub image: Option<String>,
    pub image_depth: Option<String>,
    pub image_interval: Duration,
    /// Where words come in, and what fits them goes out.
    pub text: Option<(String, String)>,
    /// The service that answers boxes of distances.
    pub esdf: Option<String>,
    /// Edge of its voxels, m.
    pub esdf_voxel_m: f32,
}

/// Checked settings of ROS 2. Names of topics are checked where keys are made of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Ros2Config {
    pub bridge: Bridge,
    pub robot: String,
    pub sensor: String,
    pub depth: String,
    pub color: Option<String>,
    pub camera_info: String,
    /// Whether images have no distortion, whatever their `CameraInfo` says of the lens.
    pub rectified: bool,
    /// A topic of poses in the place of TF.
    pub pose: Option<String>,
    pub tf: String,
    pub tf_static: String,
    pub map_frame: String,
    /// `None`: that of the depth images.
    pub camera_frame: Option<String>,
    pub tolerance: Duration,
    pub patience: Duration,
    pub outputs: Ros2Outputs,
}

impl Ros2Config {
    /// Checks `[ros2]`; `None` where it is off.
    pub fn from_settings(settings: &Ros2Settings) -> Result<Option<Self>> {
        let s = settings;
        let some = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        let bridge = match s.bridge.as_str() {
            "off" => return Ok(None),
            "dds-bridge" => Bridge::Dds { namespace: s.namespace.clone() },
            "rmw-zenoh" => {
                within("domain", f64::from(s.domain), 0.0, 232.0)?;
                Bridge::Rmw { domain: s.domain, has_hashes: s.type_hashes }
            }
            other => {
                let problem = format!("'{other}' is none of off, dds-bridge, rmw-zenoh");
                return Err(invalid("bridge", problem));
            }
        };
        for (key, value) in [
            ("robot", &s.robot),
            ("sensor", &s.sensor),
            ("depth", &s.depth),
            ("camera_info", &s.camera_info),
            ("map_frame", &s.map_frame),
        ] {
            if value.is_empty() {
                return Err(invalid(key, "is required"));
            }
        }
        let millis = |ms: f64| Duration::from_secs_f64(ms * 1e-3);
        Ok(Some(Self {
            bridge,
            robot: s.robot.clone(),
            sensor: s.sensor.clone(),
            depth: s.depth.clone(),
            color: some(&s.color),
            camera_info: s.camera_info.clone(),
            rectified: s.rectified,
            pose: some(&s.pose),
            tf: s.tf.clone(),
            tf_static: s.tf_static.clone(),
            map_frame: s.map_frame.trim_start_matches('/').into(),
            camera_frame: some(s.camera_frame.trim_start_matches('/')),
            tolerance: millis(within("tolerance_ms", s.tolerance_ms, 0.0, 10_000.0)?),
            patience: millis(within("wait_ms", s.wait_ms.into(), 0.0, 60_000.0)?),
            outputs: outputs(s)?,
        }))
    }
}

fn outputs(s: &Ros2Settings) -> Result<Ros2Outputs> {
    let some = |text: &str| (!text.is_empty()).then(|| text.to_owned());
    let interval = |key: &str, hz: f64| {
        within(key, hz, 0.01, MAX_HZ).map(|hz| Duration::from_secs_f64(1.0 / hz))
    };
    let metres = |key: &str, value: f32, low: f64, high: f64| {
        within(key, value.into(), low, high).map(|_| value)
    };
    let band_m = (
        metres("grid_low_m", s.grid_low_m, -1e4, 1e4)?,
        metres("grid_high_m", s.grid_high_m, -1e4, 1e4)?,
    );
    if band_m.0 > band_m.1 || band_m.1 - band_m.0 > 10.0 {
        let problem = format!("{} must lie within 10 m above grid_low_m, {}", band_m.1, band_m.0);
        return Err(invalid("grid_high_m", problem));
    }
    if s.text.is_empty() != s.matches.is_empty() {
        return Err(invalid("matches", "needs text, and text needs matches"));
    }
    Ok(Ros2Outputs {
        grid: some(&s.grid),
        distance: some(&s.distance),
        grid_interval: interval("grid_hz", s.grid_hz)?,
        cell_m: metres("grid_cell_m", s.grid_cell_m, 0.01, 1.0)?,
        band_m,
        radius_m: metres("robot_radius_m", s.robot_radius_m, 0.0, 2.0)?,
        cloud: some(&s.cloud),
        cloud_interval: interval("cloud_hz", s.cloud_hz)?,
        image: some(&s.image),
        image_depth: some(&s.image_depth),
        image_interval: interval("image_hz", s.image_hz)?,
        text: some(&s.text).zip(some(&s.matches)),
        esdf: some(&s.esdf),
        esdf_voxel_m: metres("esdf_voxel_m", s.esdf_voxel_m, 0.001, 1.0)?,
    })
}

fn within(key: &str, value: f64, low: f64, high: f64) -> Result<f64> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(invalid(key, format!("{value} must be within {low}..={high}")))
}

fn invalid(key: &str, problem: impl Into<String>) -> Error {
    Error::invalid(format!("ros2.{key}"), problem)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ServerConfig, Settings};

    fn checked(change: impl FnOnce(&mut Ros2Settings)) -> Result<Option<Ros2Config>> {
        let mut settings = Ros2Settings { bridge: "dds-bridge".into(), ..Ros2Settings::default() };
        change(&mut settings);
        Ros2Config::from_settings(&settings)
    }

    #[test]
    fn it_is_off_until_a_bridge_is_named() {
        assert_eq!(Ros2Config::from_settings(&Ros2Settings::default()).expect("good"), None);
        let config = checked(|_| {}).expect("good").expect("on");
        assert_eq!(config.bridge, Bridge::Dds { namespace: String::new() });
        assert_eq!((config.color, config.pose, config.camera_frame), (None, None, None));
        assert_eq!(config.tolerance, Duration::from_millis(20));
        let config = checked(|s| s.bridge = "rmw-zenoh".into()).expect("good").expect("on");
        assert_eq!(config.bridge, Bridge::Rmw { domain: 0, has_hashes: true });
    }

    #[test]
    fn the_example_is_a_good_one() {
        let text = include_str!("../../deploy/ros2/realsense.toml");
        let mut settings = Settings::parse(text, "realsense.toml").expect("it parses");
        settings.bus.connect = vec!["tcp/robot:7447".into()];
        let (config, _) = ServerConfig::from_settings(&settings).expect("good");
        let ros2 = config.ros2.expect("on");
        assert_eq!((ros2.rectified, ros2.pose), (false, None));
        assert!(ros2.color.is_some_and(|topic| topic.contains("color")));
        settings.bus.connect.clear();
        let error = ServerConfig::from_settings(&settings).expect_err("without Zenoh").to_string();
        assert!(error.starts_with("ros2.bridge: needs Zenoh"), "{error}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        type Spoil = fn(&mut Ros2Settings);
        let cases: [(&str, Spoil); 9] = [
            ("ros2.bridge: 'rclcpp'", |s| s.bridge = "rclcpp".into()),
            ("ros2.depth: is required", |s| s.depth = String::new()),
            ("ros2.tolerance_ms: NaN", |s| s.tolerance_ms = f64::NAN),
            ("ros2.grid_hz: 0", |s| s.grid_hz = 0.0),
            ("ros2.grid_cell_m: 0.001", |s| s.grid_cell_m = 0.001),
            ("ros2.grid_high_m: 0.05", |s| s.grid_high_m = 0.05),
            ("ros2.matches: needs text", |s| s.text = String::new()),
            ("ros2.esdf_voxel_m: 0 must", |s| s.esdf_voxel_m = 0.0),
            ("ros2.domain: 233", |s| {
                s.bridge = "rmw-zenoh".into();
                s.domain = 233;
            }),
        ];
        for (words, spoil) in cases {
            let error = checked(spoil).expect_err(words).to_string();
            assert!(error.starts_with(words), "{error}");
        }
    }
}
