//! Synthetic scenes as recordings on disk.

use std::fs;
use std::path::Path;

use image::{ImageBuffer, Luma, RgbImage};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;

/// Writes frames with their labels in the 7-Scenes layout.
pub(crate) fn write(data: &Synthetic, folder: &Path, frames: &[usize]) {
    fs::create_dir_all(folder).unwrap();
    let k = data.intrinsics();
    let matrix = format!("{} 0 {}\n0 {} {}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy);
    fs::write(folder.join("camera-intrinsics.txt"), matrix).unwrap();
    for index in frames {
        let frame = data.load(*index, true).unwrap();
        let labels = data.labels(*index).unwrap().unwrap();
        let file = |suffix: &str| folder.join(format!("frame-{index:06}.{suffix}"));
        let grey = |pixels: Vec<u16>, suffix: &str| {
            let image = ImageBuffer::<Luma<u16>, _>::from_raw(k.width, k.height, pixels);
            image.unwrap().save(file(suffix)).unwrap();
        };
        grey(frame.depth.metres.iter().map(|z| (z * 1e3).round() as u16).collect(), "depth.png");
        grey(labels.ids, "label.png");
        let rgb = frame.color.unwrap().rgb;
        RgbImage::from_raw(k.width, k.height, rgb).unwrap().save(file("color.png")).unwrap();
        let pose = frame.world_from_camera;
        let (r, t) = (glam::DMat3::from_quat(pose.rotation), pose.translation);
        let row = |i: usize| format!("{} {} {} {}\n", r.row(i).x, r.row(i).y, r.row(i).z, t[i]);
        fs::write(file("pose.txt"), row(0) + &row(1) + &row(2) + "0 0 0 1\n").unwrap();
        let classes = labels.classes.iter().map(|c| (c.id.to_string(), c.name.as_str().into()));
        let classes: serde_json::Map<String, serde_json::Value> = classes.collect();
        let json = serde_json::json!({ "classes": classes });
        fs::write(folder.join("labels.json"), json.to_string()).unwrap();
    }
}
