//! A question for images: what every transport fills in, and the checks that it must pass.

use std::time::Duration;

use super::DEFAULT_MAP;
use super::sought::Sought;
use crate::config::Renderer;
use crate::error::{Error, Result};
use crate::map::{Camera, Encoding, Output};

/// Images of one answer.
pub const MAX_IMAGES: usize = 8;
/// All images of one answer, bytes: so that it fits into a message.
pub const MAX_IMAGE_BYTES: usize = 56 << 20;

/// What a client wants to see. Nothing in it is checked before [`super::Service::render`] sees it, so
/// that every transport refuses the same things in the same words.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageQuestion {
    pub map_id: String,
    pub camera: Camera,
    /// What to answer, in this order.
    pub images: Vec<ImageKind>,
    pub renderer: Renderer,
    /// What [`Output::Heat`] is the heat of.
    pub text: Option<Sought>,
    /// The oldest epoch that may answer.
    pub min_epoch: u64,
    /// How long ago the newest frame may have come, by the server's clock.
    pub max_age: Option<Duration>,
}

/// One image of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageKind {
    pub output: Output,
    pub encoding: Encoding,
}

/// Images from one place, all of one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageReply {
    /// As they were asked for, encoded.
    pub images: Vec<(ImageKind, Vec<u8>)>,
    pub width: u32,
    pub height: u32,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// Time spent in the server.
    pub spent: Duration,
}

impl ImageQuestion {
    /// Images of the default map, whatever its age, by the fast renderer.
    pub fn new(camera: Camera, images: Vec<ImageKind>) -> Self {
        Self {
            map_id: DEFAULT_MAP.into(),
            camera,
            images,
            renderer: Renderer::Tile,
            text: None,
            min_epoch: 0,
            max_age: None,
        }
    }

    /// The most bytes that the answer takes.
    pub fn bytes(&self) -> usize {
        let pixels = self.camera.intrinsics.pixels();
        let images = self.images.iter().map(|kind| kind.encoding.bound(kind.output, pixels));
        images.fold(0, usize::saturating_add)
    }

    /// Refuses what no map could answer.
    pub(super) fn check(&self, max_pixels: usize) -> Result<()> {
        self.camera.check()?;
        let k = &self.camera.intrinsics;
        if k.pixels() > max_pixels {
            return Err(Error::invalid(
                "intrinsics",
                format!(
                    "{}x{} are {} pixels; the limit is {max_pixels} (server.max_pixels)",
                    k.width,
                    k.height,
                    k.pixels()
                ),
            ));
        }
        if !(1..=MAX_IMAGES).contains(&self.images.len()) {
            let problem = format!("{} images must be within 1..={MAX_IMAGES}", self.images.len());
            return Err(Error::invalid("images", problem));
        }
        let is_heat = |kind: &ImageKind| kind.output == Output::Heat;
        if self.text.is_none() && self.images.iter().any(is_heat) {
            return Err(Error::invalid("text", "is required: what HEAT is the heat of"));
        }
        for (at, ImageKind { output, encoding }) in self.images.iter().enumerate() {
            encoding.check(*output, &format!("images[{at}].encoding"))?;
        }
        if self.bytes() > MAX_IMAGE_BYTES {
            let problem = format!("{} bytes; the limit is {MAX_IMAGE_BYTES}", self.bytes());
            return Err(Error::invalid("images", problem));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Intrinsics, Pose};

    fn question() -> ImageQuestion {
        let intrinsics =
            Intrinsics { fx: 500.0, fy: 500.0, cx: 19.5, cy: 9.5, width: 40, height: 20 };
        let camera = Camera { world_from_camera: Pose::IDENTITY, intrinsics };
        let kind = ImageKind { output: Output::Depth, encoding: Encoding::Png };
        ImageQuestion::new(camera, vec![kind])
    }

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        question().check(800).expect("as large as it may be");
        let f32_color = ImageKind { output: Output::Color, encoding: Encoding::F32 };
        type Spoil = fn(&mut ImageQuestion);
        let cases: [(&str, &str, Spoil); 7] = [
            ("intrinsics", "880 pixels; the limit is 800 (server.max_pixels)", |q| {
                q.camera.intrinsics.height = 22;
            }),
            ("intrinsics.width", "4097", |q| q.camera.intrinsics.width = 4097),
            ("world_from_camera.translation", "finite", |q| {
                q.camera.world_from_camera.translation.x = f64::NAN;
            }),
            ("images", "0 images", |q| q.images.clear()),
            ("text", "HEAT", |q| q.images[0].output = Output::Heat),
            ("images", "9 images", |q| q.images = vec![q.images[0]; 9]),
            ("images[1].encoding", "jpeg is for color", |q| {
                q.images.push(ImageKind { encoding: Encoding::JPEG, ..q.images[0] });
            }),
        ];
        for (field, words, spoil) in cases {
            let mut question = question();
            spoil(&mut question);
            let refused = question.check(800).expect_err(words);
            assert_eq!(refused.field(), Some(field), "{refused}");
            assert!(refused.to_string().contains(words), "{refused}");
        }
        let mut large = question();
        (large.camera.intrinsics.width, large.camera.intrinsics.height) = (2000, 2000);
        large.images = vec![f32_color; 2];
        let refused = large.check(4_000_000).expect_err("too much").to_string();
        assert!(refused.contains("96000000 bytes; the limit is 58720256"), "{refused}");
    }
}
