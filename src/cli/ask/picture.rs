//! What fits, in warm colours over what is there, and boxes around it.

use font8x8::legacy::BASIC_LEGACY;
use glam::{DVec3, Vec3};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::cli::render::Size;
use crate::error::{Error, Result};
use crate::map::{Camera, OrientedBox};

/// What fits a little, and what fits best, sRGB.
const WARM: Vec3 = Vec3::new(1.0, 0.85, 0.1);
const HOT: Vec3 = Vec3::new(0.9, 0.1, 0.05);
/// How much of its colour a place keeps, so that warm colours stand out.
const KEPT: f32 = 0.45;
/// How much of a place the tint covers, from a little to best.
const COVER: [f32; 2] = [0.35, 0.85];
/// Frames and their numbers.
const INK: [u8; 3] = [20, 230, 255];
/// Pixels of a dot of a letter.
const DOT: i64 = 2;

/// An image, row by row.
pub(super) struct Picture {
    size: Size,
    rgb: Vec<[u8; 3]>,
}

impl Picture {
    /// Colours with a tint where the score reaches the first of `range`, and the most of it where it
    /// reaches the second. The rest is turned towards grey.
    pub(super) fn tinted(size: Size, color: &[Vec3], scores: &[f32], range: [f32; 2]) -> Self {
        let [least, most] = range;
        let tint = |(color, score): (&Vec3, &f32)| {
            let grey = Vec3::splat(color.dot(Vec3::new(0.3, 0.6, 0.1)));
            let base = grey.lerp(*color, KEPT);
            let mixed = if *score >= least {
                let t = ((score - least) / (most - least).max(1e-3)).clamp(0.0, 1.0);
                base.lerp(WARM.lerp(HOT, t), COVER[0] + (COVER[1] - COVER[0]) * t)
            } else {
                base
            };
            mixed.to_array().map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8)
        };
        Self { size, rgb: color.iter().zip(scores).map(tint).collect() }
    }

    /// Draws the edges of a box and its name.
    pub(super) fn frame(&mut self, camera: &Camera, around: &OrientedBox, name: &str) {
        let own = camera.world_from_camera.inverse();
        let k = &camera.intrinsics;
        let pixel = |point: Vec3| {
            let p: DVec3 = own.transform(point.as_dvec3());
            (p.z > 0.05).then(|| [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy])
        };
        let corner = |at: usize| {
            let sign = Vec3::from([0, 1, 2].map(|axis| (at >> axis & 1) as f32 * 2.0 - 1.0));
            pixel(around.center + around.rotation * (sign * around.half_size))
        };
        for at in 0..8 {
            for other in [1, 2, 4].map(|bit| at | bit).into_iter().filter(|other| *other != at) {
                if let (Some(from), Some(to)) = (corner(at), corner(other)) {
                    self.line(from, to);
                }
            }
        }
        if let Some([u, v]) = pixel(around.center) {
            self.write(name, u.round() as i64, v.round() as i64);
        }
    }

    /// A PNG file.
    pub(super) fn png(&self) -> Result<Vec<u8>> {
        let mut file = Vec::new();
        let Size { width, height } = self.size;
        PngEncoder::new(&mut file)
            .write_image(self.rgb.as_flattened(), width, height, ExtendedColorType::Rgb8)
            .map_err(|e| Error::Internal(format!("an image was not encoded: {e}")))?;
        Ok(file)
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2]) {
        let reach = f64::from(self.size.width.max(self.size.height));
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil();
        // A line that is longer than any image leaves it.
        let steps = steps.clamp(1.0, 4.0 * reach);
        for at in 0..=steps as u32 {
            let t = f64::from(at) / steps;
            let [u, v] = [0, 1].map(|i| (from[i] + (to[i] - from[i]) * t).round() as i64);
            self.put(u, v, INK);
        }
    }

    /// Letters around a pixel, on a ground of their own.
    fn write(&mut self, text: &str, u: i64, v: i64) {
        let width = 8 * DOT * text.chars().count() as i64;
        let (left, top) = (u - width / 2, v - 4 * DOT);
        for (at, letter) in (0..).zip(text.chars()) {
            let glyph = BASIC_LEGACY.get(letter as usize).unwrap_or(&BASIC_LEGACY[63]);
            for (row, bits) in (0..).zip(glyph) {
                for column in 0..8 {
                    let ink = if bits >> column & 1 == 1 { INK } else { [0; 3] };
                    for dot in 0..DOT * DOT {
                        let x = left + (8 * at + column) * DOT + dot % DOT;
                        self.put(x, top + row * DOT + dot / DOT, ink);
                    }
                }
            }
        }
    }

    fn put(&mut self, u: i64, v: i64, color: [u8; 3]) {
        let Size { width, height } = self.size;
        if (0..i64::from(width)).contains(&u)
            && (0..i64::from(height)).contains(&v)
            && let Some(pixel) = self.rgb.get_mut((v * i64::from(width) + u) as usize)
        {
            *pixel = color;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::geometry::{Intrinsics, Pose};

    #[test]
    fn warm_colours_are_where_it_fits() {
        let size = Size { width: 4, height: 1 };
        let scores = [f32::NAN, 0.4, 0.5, 0.9];
        let picture = Picture::tinted(size, &[Vec3::splat(0.5); 4], &scores, [0.5, 0.9]);
        assert_eq!(picture.rgb[..2], [[128; 3]; 2]);
        let redness = |at: usize| i32::from(picture.rgb[at][0]) - i32::from(picture.rgb[at][2]);
        assert!(redness(2) > 50 && redness(3) > redness(2), "{:?}", picture.rgb);
        let file = picture.png().expect("a file");
        let back = image::load_from_memory(&file).expect("an image").into_rgb8();
        assert_eq!((back.width(), back.height()), (4, 1));
    }

    #[test]
    fn a_frame_is_around_its_box_and_has_a_name() {
        let size = Size { width: 100, height: 80 };
        let black = vec![Vec3::ZERO; 8000];
        let mut picture = Picture::tinted(size, &black, &vec![f32::NAN; 8000], [0.5, 1.0]);
        let intrinsics =
            Intrinsics { fx: 100.0, fy: 100.0, cx: 50.0, cy: 40.0, width: 100, height: 80 };
        let camera = Camera { world_from_camera: Pose::IDENTITY, intrinsics };
        let around = OrientedBox {
            center: Vec3::new(0.0, 0.0, 4.5),
            rotation: Quat::IDENTITY,
            half_size: Vec3::new(1.0, 0.8, 0.5),
        };
        picture.frame(&camera, &around, "1");
        let at = |u: usize, v: usize| picture.rgb[v * 100 + u];
        // The near face is 4 m away: 25 pixels a metre.
        for (u, v) in [(25, 20), (75, 20), (25, 60), (75, 60), (50, 20), (25, 40)] {
            assert_eq!(at(u, v), INK, "{u} {v}");
        }
        let inked = (42..58).flat_map(|u| (32..48).map(move |v| (u, v)));
        let inked = inked.filter(|(u, v)| at(*u, *v) == INK).count();
        assert!((20..200).contains(&inked), "{inked} dots of a figure");
        assert_eq!(at(5, 5), [0; 3]);
        // What is behind the camera, or far outside of the image, does no harm.
        let behind = OrientedBox { center: Vec3::new(0.0, 0.0, -3.0), ..around };
        picture.frame(&camera, &behind, "2");
        let beside = OrientedBox { center: Vec3::new(1e6, 0.0, 1.0), ..around };
        picture.frame(&camera, &beside, "3");
    }
}
