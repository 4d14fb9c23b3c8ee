//! Rendered images as bytes: for files, for the wire, for looking at.

use glam::Vec3;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

use super::render::{Channels, Rendering};
use crate::error::{Error, Result};

/// Millimetres of depth in a PNG: 0 is no surface, and 65535 stays free, for it means the same to many
/// readers.
const DEPTH_MM: std::ops::RangeInclusive<f32> = 1.0..=65534.0;

/// One of the images that a rendering holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Output {
    /// sRGB; black where there is no colour
    Color,
    /// z-depth; 0 where there is no surface
    Depth,
    /// World axes, towards the camera's side; as a picture, -1..1 is 0..255, and 0 0 0 where there is
    /// no surface
    Normal,
    /// How much light the ray lost
    Opacity,
    /// Whether the ray left what was observed before it met a surface
    Unknown,
    /// How well a text fits; where nobody knows NaN, and 0 as a picture. Comes with a text alone.
    #[value(skip)]
    Heat,
}

/// How an image is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// 8 bits a channel; depth in 16 bits, millimetres, 0 where there is no surface; opacity and
    /// unknown as grey, 255 being all.
    Png,
    /// Of colour alone; the quality is within 1..=100.
    Jpeg { quality: u8 },
    /// As computed: little-endian f32, row by row, channels side by side, metres for depth.
    F32,
    /// The same in bytes: 0..255 for 0..1 (normals -1..1), 0 or 1 for unknown. Not for depth.
    U8,
}

impl Output {
    /// All that need no text.
    pub const ALL: [Self; 5] =
        [Self::Color, Self::Depth, Self::Normal, Self::Opacity, Self::Unknown];

    /// As in the names of files and fields.
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Normal => "normal",
            Self::Opacity => "opacity",
            Self::Unknown => "unknown",
            Self::Heat => "heat",
        }
    }

    /// What must be rendered for these.
    pub fn channels(outputs: impl IntoIterator<Item = Self>) -> Channels {
        let mut channels = Channels::default();
        for output in outputs {
            match output {
                Self::Color => channels.color = true,
                Self::Depth => channels.depth = true,
                Self::Normal => channels.normal = true,
                Self::Opacity => channels.opacity = true,
                Self::Unknown => channels.unknown = true,
                Self::Heat => channels.heat = true,
            }
        }
        channels
    }

    /// Numbers a pixel.
    fn width(self) -> usize {
        match self {
            Self::Color | Self::Normal => 3,
            Self::Depth | Self::Opacity | Self::Unknown | Self::Heat => 1,
        }
    }
}

impl Encoding {
    /// JPEG where nobody says how good: hard to tell from the image at a tenth of its bytes.
    pub const JPEG: Self = Self::Jpeg { quality: 85 };

    /// As in fields.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg { .. } => "jpeg",
            Self::F32 => "f32",
            Self::U8 => "u8",
        }
    }

    /// Fails on an encoding that an output has not. `field` is what the error calls it.
    pub fn check(self, output: Output, field: &str) -> Result<()> {
        let problem = match (self, output) {
            (Self::Jpeg { quality }, Output::Color) if !(1..=100).contains(&quality) => {
                format!("a JPEG's quality {quality} must be within 1..=100")
            }
            (Self::Jpeg { .. }, Output::Color) => return Ok(()),
            (Self::Jpeg { .. }, _) => {
                format!("jpeg is for color, not for {}: it invents numbers", output.name())
            }
            (Self::U8, Output::Depth) => {
                "u8 has no room for depth: png (16 bits, mm) and f32 have".to_owned()
            }
            _ => return Ok(()),
        };
        Err(Error::invalid(field, problem))
    }

    /// The most bytes that an image takes, but for headers; of a size that nobody has checked, as many
    /// as can be said.
    pub fn bound(self, output: Output, pixels: usize) -> usize {
        let bytes = match (self, output) {
            (Self::F32, _) => 4,
            (Self::Png, Output::Depth) => 2,
            _ => 1,
        };
        pixels.saturating_mul(output.width() * bytes)
    }
}

impl Rendering {
    /// One of its images as bytes. It must have been rendered, and the encoding be one that it has.
    pub fn encode(&self, output: Output, encoding: Encoding) -> Result<Vec<u8>> {
        encoding.check(output, "encoding")?;
        match encoding {
            Encoding::F32 => Ok(bytemuck::cast_slice(&self.numbers(output)).to_vec()),
            Encoding::U8 => Ok(self.bytes(output, 1)),
            Encoding::Png if output == Output::Depth => {
                let mm: Vec<u16> = self.depth_m.iter().map(|&z| millimetres(z)).collect();
                self.png(bytemuck::cast_slice(&mm), ExtendedColorType::L16)
            }
            Encoding::Png => {
                let color = match output.width() {
                    3 => ExtendedColorType::Rgb8,
                    _ => ExtendedColorType::L8,
                };
                self.png(&self.bytes(output, 255), color)
            }
            Encoding::Jpeg { quality } => {
                let mut file = Vec::new();
                let bytes = self.bytes(output, 255);
                JpegEncoder::new_with_quality(&mut file, quality)
                    .write_image(&bytes, self.width, self.height, ExtendedColorType::Rgb8)
                    .map_err(failed)?;
                Ok(file)
            }
        }
    }

    fn numbers(&self, output: Output) -> Vec<f32> {
        match output {
            Output::Color => bytemuck::cast_slice(&self.color).to_vec(),
            Output::Normal => bytemuck::cast_slice(&self.normal).to_vec(),
            Output::Depth => self.depth_m.clone(),
            Output::Opacity => self.opacity.clone(),
            Output::Unknown => self.unknown.iter().map(|&u| f32::from(u)).collect(),
            Output::Heat => self.heat.clone(),
        }
    }

    /// `unknown` is what stands for 1 in the mask.
    fn bytes(&self, output: Output, unknown: u8) -> Vec<u8> {
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        match output {
            Output::Color => self.color.iter().flat_map(|c| c.to_array().map(byte)).collect(),
            Output::Normal => {
                let triple = |n: &Vec3| match *n == Vec3::ZERO {
                    true => [0; 3],
                    false => n.to_array().map(|x| byte(0.5 * x + 0.5)),
                };
                self.normal.iter().flat_map(triple).collect()
            }
            Output::Opacity => self.opacity.iter().map(|&o| byte(o)).collect(),
            Output::Unknown => self.unknown.iter().map(|&u| u * unknown).collect(),
            // NaN becomes 0.
            Output::Heat => self.heat.iter().map(|&score| byte(score)).collect(),
            Output::Depth => Vec::new(),
        }
    }

    /// Fast to make: an image that is streamed is seldom kept.
    fn png(&self, bytes: &[u8], color: ExtendedColorType) -> Result<Vec<u8>> {
        let mut file = Vec::new();
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive)
            .write_image(bytes, self.width, self.height, color)
            .map_err(failed)?;
        Ok(file)
    }
}

fn millimetres(z_m: f32) -> u16 {
    if z_m > 0.0 { (z_m * 1e3).round().clamp(*DEPTH_MM.start(), *DEPTH_MM.end()) as u16 } else { 0 }
}

fn failed(error: ImageError) -> Error {
    Error::Internal(format!("an image was not encoded: {error}"))
}

#[cfg(test)]
mod tests {
    use image::DynamicImage;

    use super::*;

    #[test]
    fn a_size_that_no_image_has_takes_as_much_as_can_be_said() {
        assert_eq!(Encoding::F32.bound(Output::Color, 10), 120);
        assert_eq!(Encoding::F32.bound(Output::Color, usize::MAX / 2), usize::MAX);
    }

    fn rendering() -> Rendering {
        Rendering {
            width: 2,
            height: 1,
            color: vec![Vec3::new(0.0, 0.5, 1.0), Vec3::ZERO],
            depth_m: vec![1.2346, 0.0],
            normal: vec![-Vec3::Z, Vec3::ZERO],
            opacity: vec![1.0, 0.2],
            unknown: vec![0, 1],
            heat: vec![0.6, f32::NAN],
        }
    }

    fn decoded(output: Output, encoding: Encoding) -> DynamicImage {
        let bytes = rendering().encode(output, encoding).expect("encoded");
        image::load_from_memory(&bytes).expect("an image")
    }

    #[test]
    fn png_files_hold_bytes_and_millimetres() {
        let bytes = |output| decoded(output, Encoding::Png).into_bytes();
        assert_eq!(bytes(Output::Color), [0, 128, 255, 0, 0, 0]);
        assert_eq!(bytes(Output::Normal), [128, 128, 0, 0, 0, 0]);
        assert_eq!((bytes(Output::Opacity), bytes(Output::Unknown)), (vec![255, 51], vec![0, 255]));
        assert_eq!(bytes(Output::Heat), [153, 0]);
        let depth = decoded(Output::Depth, Encoding::Png);
        assert_eq!(depth.as_luma16().expect("16 bits").as_raw()[..], [1235, 0]);
        let mm = [0.0002, 70.0, f32::NAN, -1.0].map(millimetres);
        assert_eq!(mm, [1, 65534, 0, 0], "a surface is never 0, nothing always");
    }

    #[test]
    fn raw_images_are_the_numbers_themselves() {
        let encode = |output, encoding| rendering().encode(output, encoding).expect("encoded");
        let numbers = |output| -> Vec<f32> {
            encode(output, Encoding::F32)
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect()
        };
        assert_eq!(numbers(Output::Color), [0.0, 0.5, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(numbers(Output::Depth), [1.2346, 0.0]);
        assert_eq!(numbers(Output::Unknown), [0.0, 1.0]);
        assert_eq!(encode(Output::Unknown, Encoding::U8), [0, 1]);
        for (output, encoding) in
            Output::ALL.iter().flat_map(|o| [(*o, Encoding::F32), (*o, Encoding::U8)].into_iter())
        {
            if encoding.check(output, "").is_ok() {
                assert_eq!(encode(output, encoding).len(), encoding.bound(output, 2));
            }
        }
    }

    #[test]
    fn jpeg_is_for_colour() {
        let image = decoded(Output::Color, Encoding::Jpeg { quality: 100 });
        assert_eq!((image.width(), image.height()), (2, 1));
        for (output, encoding, word) in [
            (Output::Depth, Encoding::JPEG, "not for depth"),
            (Output::Depth, Encoding::U8, "16 bits"),
            (Output::Color, Encoding::Jpeg { quality: 0 }, "1..=100"),
            (Output::Color, Encoding::Jpeg { quality: 101 }, "1..=100"),
        ] {
            let error = encoding.check(output, "images[0].encoding").expect_err("refused");
            let error = error.to_string();
            assert!(error.starts_with("images[0].encoding: ") && error.contains(word), "{error}");
            assert!(rendering().encode(output, encoding).is_err());
        }
    }

    #[test]
    fn outputs_say_what_they_need() {
        let channels = Output::channels([Output::Depth, Output::Unknown]);
        let expected = Channels { depth: true, unknown: true, ..Channels::default() };
        assert_eq!(channels, expected);
        assert_eq!(Output::channels(Output::ALL), Channels::ALL);
    }
}
