//! Depth out of `Image` and `CompressedImage`, and back (REP-118): `16UC1` in millimetres where 0 is
//! nothing, `32FC1` in metres where NaN is nothing.

use image::DynamicImage;

use super::color::decompress;
use super::messages::{CompressedImage, Header, Image};
use super::rows;
use crate::error::{Error, Result};
use crate::frame::{DepthImage, check_unit};

const UNITS_PER_METRE: f32 = 1000.0;
/// What compressed_depth_image_transport puts before a PNG: the format (i32) and the two numbers that
/// quantise inverse depth (f32), little-endian.
const CONFIG_BYTES: usize = 12;
const PNG: &[u8] = b"\x89PNG";

/// Depth, z along the optical axis, in metres.
pub fn depth_from_image(image: &Image<'_>) -> Result<DepthImage> {
    let (width, height) = (image.width, image.height);
    match image.encoding.as_str() {
        "16UC1" | "mono16" => {
            let read = match image.is_bigendian {
                0 => u16::from_le_bytes,
                _ => u16::from_be_bytes,
            };
            // Sizes are believed once the rows are there.
            let rows = rows("depth", image, 2)?;
            let mut raw = Vec::with_capacity(width as usize * height as usize);
            for row in rows {
                raw.extend(row.as_chunks::<2>().0.iter().map(|b| read(*b)));
            }
            from_millimetres(width, height, &raw)
        }
        "32FC1" => {
            let read = match image.is_bigendian {
                0 => f32::from_le_bytes,
                _ => f32::from_be_bytes,
            };
            let rows = rows("depth", image, 4)?;
            let mut metres = Vec::with_capacity(width as usize * height as usize);
            for row in rows {
                metres.extend(row.as_chunks::<4>().0.iter().map(|b| read(*b)));
            }
            from_metres(width, height, metres)
        }
        other => Err(unknown(other)),
    }
}

/// The same out of PNG, as both transports of compressed images send it.
pub fn depth_from_compressed(image: &CompressedImage<'_>) -> Result<DepthImage> {
    let encoding = image.format.split(';').next().unwrap_or_default().trim();
    let (config, png) = match image.data.split_at_checked(CONFIG_BYTES) {
        Some((config, png)) if png.starts_with(PNG) => (Some(config), png),
        _ => (None, image.data),
    };
    let grey = match decompress("depth", png, image::ImageFormat::Png)? {
        DynamicImage::ImageLuma16(grey) => grey,
        other => {
            let problem = format!("must be 16-bit grey, is {:?}", other.color());
            return Err(Error::invalid("depth.data", problem));
        }
    };
    let (width, height) = grey.dimensions();
    match (encoding, config) {
        ("16UC1" | "mono16", _) => from_millimetres(width, height, grey.as_raw()),
        ("32FC1", Some(config)) => {
            let number = |at: usize| {
                f32::from_le_bytes([config[at], config[at + 1], config[at + 2], config[at + 3]])
            };
            let (scale, offset) = (number(4), number(8));
            let metre =
                |raw: &u16| if *raw == 0 { 0.0 } else { scale / (f32::from(*raw) - offset) };
            from_metres(width, height, grey.as_raw().iter().map(metre).collect())
        }
        _ => Err(unknown(&image.format)),
    }
}

/// `32FC1` of metres; NaN where there is nothing. `data` holds the bytes.
pub fn depth_to_image<'a>(
    header: Header,
    size: (u32, u32),
    metres: &[f32],
    data: &'a mut Vec<u8>,
) -> Image<'a> {
    data.clear();
    data.extend(metres.iter().flat_map(|z| if *z > 0.0 { *z } else { f32::NAN }.to_le_bytes()));
    let (width, height) = size;
    let encoding = "32FC1".into();
    Image { header, height, width, encoding, is_bigendian: 0, step: 4 * width, data }
}

fn from_millimetres(width: u32, height: u32, raw: &[u16]) -> Result<DepthImage> {
    let metre = |d: &u16| if *d == u16::MAX { 0.0 } else { f32::from(*d) / UNITS_PER_METRE };
    check_unit("depth.encoding", raw.iter().map(metre))?;
    Ok(DepthImage::from_u16(width, height, raw, UNITS_PER_METRE))
}

fn from_metres(width: u32, height: u32, metres: Vec<f32>) -> Result<DepthImage> {
    check_unit("depth.encoding", metres.iter().copied())?;
    Ok(DepthImage::from_metres(width, height, metres))
}

fn unknown(encoding: &str) -> Error {
    let encoding: String = encoding.chars().take(64).collect();
    Error::invalid("depth.encoding", format!("'{encoding}' is neither 16UC1 nor 32FC1"))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn image<'a>(encoding: &str, step: u32, big: bool, data: &'a [u8]) -> Image<'a> {
        let (header, encoding) = (Header::default(), encoding.into());
        Image { header, height: 2, width: 2, encoding, is_bigendian: big.into(), step, data }
    }

    #[test]
    fn a_size_is_not_believed_before_its_rows_are_there() {
        for encoding in ["16UC1", "32FC1"] {
            let vast =
                Image { width: 1 << 20, height: 1 << 20, ..image(encoding, 8, false, &[0; 16]) };
            let refused = depth_from_image(&vast).expect_err("no rows").to_string();
            assert!(refused.contains("1048576x1048576"), "{refused}");
        }
    }

    #[test]
    fn both_encodings_and_orders_of_bytes_are_read_row_by_row() {
        let expected = [1.0, 2.0, 0.0, 0.5];
        let raw = [1000u16, 2000, 0, 500];
        let metres = [1.0f32, 2.0, f32::NAN, 0.5];
        for big in [false, true] {
            let mut bytes = Vec::new();
            for row in raw.chunks(2) {
                row.iter().for_each(|d| {
                    bytes.extend(if big { d.to_be_bytes() } else { d.to_le_bytes() });
                });
                bytes.extend([9; 3]);
            }
            let depth = depth_from_image(&image("16UC1", 7, big, &bytes)).expect("good");
            assert_eq!(depth.metres, expected);
            let bytes: Vec<u8> = metres
                .iter()
                .flat_map(|z| if big { z.to_be_bytes() } else { z.to_le_bytes() })
                .collect();
            let depth = depth_from_image(&image("32FC1", 8, big, &bytes)).expect("good");
            assert_eq!(depth.metres, expected);
        }
    }

    #[test]
    fn wrong_sizes_and_kinds_are_refused() {
        let data = [0; 8];
        for (image, words) in [
            (image("rgb8", 4, false, &data), "'rgb8' is neither"),
            (image("16UC1", 3, false, &data), "step"),
            (image("16UC1", 5, false, &data), "8 bytes"),
            (Image { width: 100_000, ..image("16UC1", 200_000, false, &data) }, "8192"),
            (Image { height: 0, ..image("16UC1", 4, false, &data) }, "8192"),
            (Image { step: u32::MAX, ..image("16UC1", 4, false, &data) }, "bytes"),
        ] {
            let error = depth_from_image(&image).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn compressed_depth_is_png_with_or_without_its_header() {
        let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![2000u16, 0]);
        let mut png = Cursor::new(Vec::new());
        DynamicImage::ImageLuma16(grey.expect("its size"))
            .write_to(&mut png, image::ImageFormat::Png)
            .expect("memory");
        let png = png.into_inner();
        let mut config = 0i32.to_le_bytes().to_vec();
        config.extend(3000f32.to_le_bytes());
        config.extend(500f32.to_le_bytes());
        let with_header = [config, png.clone()].concat();
        let read = |format: &str, data: &[u8]| {
            let (header, format) = (Header::default(), format.into());
            depth_from_compressed(&CompressedImage { header, format, data })
        };
        for (format, data, expected) in [
            ("16UC1; compressedDepth png", &with_header, [2.0, 0.0]),
            ("16UC1; compressedDepth", &with_header, [2.0, 0.0]),
            ("16UC1; png compressed ", &png, [2.0, 0.0]),
            ("32FC1; compressedDepth png", &with_header, [2.0, 0.0]),
        ] {
            assert_eq!(read(format, data).expect(format).metres, expected, "{format}");
        }
        read("16UC1; compressedDepth rvl", &[0; 40]).expect_err("no PNG");
        read("32FC1; png compressed", &png).expect_err("floats without their header");
        read("jpeg", &png).expect_err("no depth");
    }
}
