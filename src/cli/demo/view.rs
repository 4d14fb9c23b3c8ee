//! An image of the demo's room: the line that draws it, and how well it shows the room.

use anyhow::ensure;
use glam::{DQuat, DVec3};

use super::curl;
use crate::client::{HttpClient, camera_json};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::geometry::Pose;
use crate::map::Camera;
use crate::service::DEFAULT_MAP;

/// A pixel is right if no channel is off by more than this, of 255.
const TOLERANCE: u8 = 40;
/// The share of the pixels that must be right.
const RIGHT_SHARE: f64 = 0.7;
/// Decimal places of what is printed: a unit quaternion needs more of them than a place.
const PLACES: f64 = 1e4;

/// A view of the room that can be printed.
pub(super) struct View {
    /// The frame of the walk that saw the same.
    frame: usize,
    body: String,
}

impl View {
    /// Where the walk is at `frame`.
    pub(super) fn new(room: &Synthetic, frame: usize) -> Self {
        let Pose { rotation, translation } = room.pose(frame);
        let short = |x: f64| (x * PLACES).round() / PLACES;
        let world_from_camera = Pose {
            rotation: DQuat::from_array(rotation.to_array().map(short)),
            translation: DVec3::from_array(translation.to_array().map(short)),
        };
        let mut camera = Camera { world_from_camera, intrinsics: room.intrinsics() };
        let k = &mut camera.intrinsics;
        (k.fx, k.fy) = (short(k.fx), short(k.fy));
        Self { frame, body: camera_json(&camera).to_string() }
    }

    fn path() -> String {
        format!("/v1/maps/{DEFAULT_MAP}/render")
    }

    /// A line to paste.
    pub(super) fn line(&self, url: &str) -> String {
        format!("{} -o room.png", curl::post(url, &Self::path(), &self.body))
    }

    /// Draws what the line draws and compares it with what the camera saw; the share of right pixels.
    pub(super) async fn check(&self, url: &str, room: &Synthetic) -> anyhow::Result<()> {
        let answer = HttpClient::new(url)?.post_json(&Self::path(), self.body.clone()).await?;
        let ours = image::load_from_memory(&answer)?.into_rgb8().into_raw();
        let truth = room.load(self.frame, true)?.color.map(|color| color.rgb).unwrap_or_default();
        ensure!(ours.len() == truth.len(), "the image has another size");
        let is_right =
            |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).all(|(a, b)| a.abs_diff(*b) <= TOLERANCE);
        let right = ours.chunks_exact(3).zip(truth.chunks_exact(3)).filter(is_right).count();
        let share = 3.0 * right as f64 / ours.len() as f64;
        println!("the image from where the robot began: {:.0} % of its pixels right", share * 1e2);
        ensure!(share >= RIGHT_SHARE, "that is less than {:.0} %", RIGHT_SHARE * 1e2);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_short_and_asks_for_a_camera() {
        let view = View::new(&Synthetic::room(10).with_width(64), 0);
        let line = view.line("http://127.0.0.1:7611");
        assert!(line.len() < 400 && line.ends_with("-o room.png"), "{line}");
        let camera: serde_json::Value = serde_json::from_str(&view.body).expect("JSON");
        let rotation = camera["world_from_camera"]["rotation"].as_array().expect("four numbers");
        let length: f64 =
            rotation.iter().filter_map(|n| n.as_f64()).map(|n| n * n).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-3, "{length}");
    }
}
