//! The image payloads of `ingest.proto`: raw, PNG and JPEG bytes to pixels, within limits.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder};

use super::{MAX_PIXELS, v1};
use crate::error::{Error, Fault, Result};
use crate::frame::{ColorImage, DepthImage, MAX_SIDE, check_unit};
use crate::geometry::Intrinsics;

/// Integer depth must have at least this many units in a metre, and at most the other.
const UNITS_PER_METRE: std::ops::RangeInclusive<f32> = 1.0..=1e6;

/// Where the size of depth and color is said.
const SAYS: &str = "intrinsics say";

/// Refuses sizes that must not be allocated for; everything below trusts `k.pixels()`.
pub(super) fn check_size(k: &Intrinsics) -> Result<()> {
    let sides = 1..=MAX_SIDE;
    if !sides.contains(&k.width) || !sides.contains(&k.height) || k.pixels() > MAX_PIXELS {
        return Err(Error::frame(
            Fault::Intrinsics,
            "intrinsics.width/height",
            format!(
                "{}x{} must be within 1..={MAX_SIDE} each and {MAX_PIXELS} pixels in all",
                k.width, k.height
            ),
        ));
    }
    Ok(())
}

pub(super) fn depth_from_wire(depth: v1::DepthImage, k: &Intrinsics) -> Result<DepthImage> {
    use v1::DepthEncoding as Encoding;
    let encoding = Encoding::try_from(depth.encoding).unwrap_or(Encoding::Unspecified);
    let units = depth.units_per_metre;
    let whole = matches!(encoding, Encoding::U16 | Encoding::Png16);
    if whole && !UNITS_PER_METRE.contains(&units) {
        return Err(Error::invalid(
            "depth.units_per_metre",
            format!("{units} must be within 1..=1000000 (1000 for millimetres)"),
        ));
    }
    let size = (k.width, k.height);
    match encoding {
        Encoding::Unspecified => Err(Error::invalid(
            "depth.encoding",
            format!("{} is none of U16, F32_METRES, PNG16", depth.encoding),
        )),
        Encoding::U16 => {
            check_len("depth.data", depth.data.len(), k, "u16", 2)?;
            let raw: Vec<u16> =
                depth.data.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
            integer_depth(&raw, units, k)
        }
        Encoding::F32Metres => {
            if units != 0.0 && units != 1.0 {
                return Err(Error::invalid(
                    "depth.units_per_metre",
                    format!("{units} must be 0 or 1: F32_METRES is in metres"),
                ));
            }
            check_len("depth.data", depth.data.len(), k, "f32", 4)?;
            let metres: Vec<f32> = depth
                .data
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect();
            check_unit("depth.data", metres.iter().copied())?;
            Ok(DepthImage::from_metres(k.width, k.height, metres))
        }
        Encoding::Png16 => {
            match decode("depth.data", &depth.data, image::ImageFormat::Png, size, SAYS)? {
                DynamicImage::ImageLuma16(grey) => integer_depth(grey.as_raw(), units, k),
                other => Err(Error::invalid(
                    "depth.data",
                    format!("PNG16 must be 16-bit grey, is {:?}", other.color()),
                )),
            }
        }
    }
}

fn integer_depth(raw: &[u16], units: f32, k: &Intrinsics) -> Result<DepthImage> {
    let metre = |d: &u16| if *d == u16::MAX { 0.0 } else { f32::from(*d) / units };
    check_unit("depth.units_per_metre", raw.iter().map(metre))?;
    Ok(DepthImage::from_u16(k.width, k.height, raw, units))
}

pub(super) fn color_from_wire(color: v1::ColorImage, k: &Intrinsics) -> Result<ColorImage> {
    use v1::ColorEncoding as Encoding;
    let encoding = Encoding::try_from(color.encoding).unwrap_or(Encoding::Unspecified);
    let format = match encoding {
        Encoding::Unspecified => {
            return Err(Error::invalid(
                "color.encoding",
                format!("{} is none of RGB8, JPEG, PNG", color.encoding),
            ));
        }
        Encoding::Rgb8 => {
            check_len("color.data", color.data.len(), k, "rgb8", 3)?;
            return Ok(ColorImage { width: k.width, height: k.height, rgb: color.data });
        }
        Encoding::Jpeg => image::ImageFormat::Jpeg,
        Encoding::Png => image::ImageFormat::Png,
    };
    let rgb = decode("color.data", &color.data, format, (k.width, k.height), SAYS)?
        .into_rgb8()
        .into_raw();
    Ok(ColorImage { width: k.width, height: k.height, rgb })
}

fn check_len(field: &str, len: usize, k: &Intrinsics, kind: &str, bytes: usize) -> Result<()> {
    let needed = k.pixels() * bytes;
    if len != needed {
        return Err(Error::frame(
            Fault::SizeMismatch,
            field,
            format!("{len} bytes, but {}x{} {kind} needs {needed}", k.width, k.height),
        ));
    }
    Ok(())
}

/// Decodes a compressed image whose header must say the size that is known of it, so that a small
/// message cannot ask for much memory; `says` is from where.
pub(super) fn decode(
    field: &str,
    data: &[u8],
    format: image::ImageFormat,
    size: (u32, u32),
    says: &str,
) -> Result<DynamicImage> {
    let wrong = |e: image::ImageError| Error::invalid(field, format!("{format:?}: {e}"));
    let decoder =
        image::ImageReader::with_format(Cursor::new(data), format).into_decoder().map_err(wrong)?;
    let (width, height) = decoder.dimensions();
    if (width, height) != size {
        let problem = format!("is {width}x{height}, but {says} {}x{}", size.0, size.1);
        return Err(Error::frame(Fault::SizeMismatch, field, problem));
    }
    DynamicImage::from_decoder(decoder).map_err(wrong)
}
