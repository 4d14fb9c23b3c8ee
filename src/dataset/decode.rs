//! Image files to pixels.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::codecs::png::PngDecoder;
use image::{ColorType, ExtendedColorType, ImageDecoder, ImageError, ImageReader, Limits};

use crate::error::{Error, Result};
use crate::frame::{ColorImage, DepthImage, MAX_SIDE};

/// Width and height of a PNG, from its header.
pub(super) fn png_size(path: &Path) -> Result<(u32, u32)> {
    Ok(png(path)?.dimensions())
}

/// A 16-bit grey PNG as depth, with `units_per_metre`; its size must be `size`.
pub(super) fn depth(path: &Path, units_per_metre: f32, size: (u32, u32)) -> Result<DepthImage> {
    let decoder = png(path)?;
    check_size(path, decoder.dimensions(), size)?;
    if decoder.color_type() != ColorType::L16 {
        return Err(Error::invalid(
            path.display().to_string(),
            format!("depth must be 16-bit grey, not {:?}", decoder.color_type()),
        ));
    }
    let mut raw = vec![0u16; size.0 as usize * size.1 as usize];
    decoder.read_image(bytemuck::cast_slice_mut(&mut raw)).map_err(|e| broken(path, e))?;
    Ok(DepthImage::from_u16(size.0, size.1, &raw, units_per_metre))
}

/// An 8- or 16-bit grey PNG as the ids of classes; its size must be `size`. `None` where there is no
/// file: not every frame need be labelled.
pub(super) fn labels(path: &Path, size: (u32, u32)) -> Result<Option<Vec<u16>>> {
    if let Ok(false) = path.try_exists() {
        return Ok(None);
    }
    let decoder = png(path)?;
    check_size(path, decoder.dimensions(), size)?;
    let pixels = size.0 as usize * size.1 as usize;
    // Not the type that pixels are decoded to: fewer bits would be spread over eight.
    let ids = match decoder.original_color_type() {
        ExtendedColorType::L8 => {
            let mut ids = vec![0u8; pixels];
            decoder.read_image(&mut ids).map_err(|e| broken(path, e))?;
            ids.into_iter().map(u16::from).collect()
        }
        ExtendedColorType::L16 => {
            let mut ids = vec![0u16; pixels];
            decoder.read_image(bytemuck::cast_slice_mut(&mut ids)).map_err(|e| broken(path, e))?;
            ids
        }
        other => {
            return Err(Error::invalid(
                path.display().to_string(),
                format!("labels must be 8-bit or 16-bit grey, not {other:?}"),
            ));
        }
    };
    Ok(Some(ids))
}

/// A JPEG or PNG as 8-bit RGB; its size must be `size`, for depth and colour share intrinsics.
/// `None` where there is no file: depth alone makes a map too.
pub(super) fn color(path: &Path, size: (u32, u32)) -> Result<Option<ColorImage>> {
    if let Ok(false) = path.try_exists() {
        return Ok(None);
    }
    let mut reader = ImageReader::new(open(path)?)
        .with_guessed_format()
        .map_err(|source| Error::io(path, source))?;
    reader.limits(limits());
    let image = reader.decode().map_err(|e| broken(path, e))?.into_rgb8();
    check_size(path, image.dimensions(), size)?;
    Ok(Some(ColorImage { width: size.0, height: size.1, rgb: image.into_raw() }))
}

fn open(path: &Path) -> Result<BufReader<File>> {
    let file = File::open(path).map_err(|source| Error::io(path, source))?;
    Ok(BufReader::with_capacity(1 << 16, file))
}

fn png(path: &Path) -> Result<PngDecoder<BufReader<File>>> {
    PngDecoder::with_limits(open(path)?, limits()).map_err(|e| broken(path, e))
}

/// A header that asks for more than any accepted frame is refused before memory is taken.
fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits
}

fn broken(path: &Path, error: ImageError) -> Error {
    match error {
        // A file that ends early is damaged; it exists and can be read.
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::io(path, source)
        }
        other => Error::corrupt(path.display().to_string(), other.to_string()),
    }
}

fn check_size(path: &Path, found: (u32, u32), expected: (u32, u32)) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::invalid(
        path.display().to_string(),
        format!(
            "{}x{} pixels, but the recording's depth has {}x{}",
            found.0, found.1, expected.0, expected.1
        ),
    ))
}
