//! Colours out of `Image` and `CompressedImage`, and back.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder, ImageFormat};

use super::messages::{CompressedImage, Header, Image};
use super::{check_sides, rows};
use crate::error::{Error, Result};
use crate::frame::ColorImage;

const JPEG: &[u8] = b"\xff\xd8";

/// Three bytes a pixel, whatever the order and the number of channels was.
pub fn color_from_image(image: &Image<'_>) -> Result<ColorImage> {
    let (bytes, order) = match image.encoding.as_str() {
        "rgb8" => (3, [0, 1, 2]),
        "bgr8" => (3, [2, 1, 0]),
        "rgba8" => (4, [0, 1, 2]),
        "bgra8" => (4, [2, 1, 0]),
        "mono8" | "8UC1" => (1, [0, 0, 0]),
        other => {
            let other: String = other.chars().take(64).collect();
            let problem = format!("'{other}' is none of rgb8, bgr8, rgba8, bgra8, mono8");
            return Err(Error::invalid("color.encoding", problem));
        }
    };
    // Sizes are believed once the rows are there.
    let rows = rows("color", image, bytes)?;
    let mut rgb = Vec::with_capacity(3 * image.width as usize * image.height as usize);
    for row in rows {
        if (bytes, order) == (3, [0, 1, 2]) {
            rgb.extend_from_slice(row);
        } else {
            rgb.extend(row.chunks_exact(bytes).flat_map(|pixel| order.map(|at| pixel[at])));
        }
    }
    Ok(ColorImage { width: image.width, height: image.height, rgb })
}

/// The same out of JPEG or PNG, whatever it is said to be.
pub fn color_from_compressed(image: &CompressedImage<'_>) -> Result<ColorImage> {
    let format = if image.data.starts_with(JPEG) { ImageFormat::Jpeg } else { ImageFormat::Png };
    let image = decompress("color", image.data, format)?.into_rgb8();
    let (width, height) = image.dimensions();
    Ok(ColorImage { width, height, rgb: image.into_raw() })
}

/// `rgb8`.
pub fn color_to_image(header: Header, size: (u32, u32), rgb: &[u8]) -> Image<'_> {
    let (width, height) = size;
    let encoding = "rgb8".into();
    Image { header, height, width, encoding, is_bigendian: 0, step: 3 * width, data: rgb }
}

/// An image whose size is no larger than any may be, so that a small message cannot ask for much
/// memory.
pub(super) fn decompress(what: &str, data: &[u8], format: ImageFormat) -> Result<DynamicImage> {
    let wrong =
        |e: image::ImageError| Error::invalid(format!("{what}.data"), format!("{format:?}: {e}"));
    let decoder =
        image::ImageReader::with_format(Cursor::new(data), format).into_decoder().map_err(wrong)?;
    let (width, height) = decoder.dimensions();
    check_sides(what, width, height)?;
    DynamicImage::from_decoder(decoder).map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_come_in_any_order() {
        let header = Header::default;
        let read = |encoding: &str, step: u32, data: &[u8]| {
            let encoding = encoding.into();
            let image = Image {
                header: header(),
                height: 1,
                width: 2,
                encoding,
                is_bigendian: 0,
                step,
                data,
            };
            color_from_image(&image).map(|color| color.rgb)
        };
        let expected = vec![1, 2, 3, 4, 5, 6];
        assert_eq!(read("rgb8", 6, &[1, 2, 3, 4, 5, 6]).expect("rgb"), expected);
        assert_eq!(read("bgr8", 7, &[3, 2, 1, 6, 5, 4, 0]).expect("bgr"), expected);
        assert_eq!(read("rgba8", 8, &[1, 2, 3, 9, 4, 5, 6, 9]).expect("rgba"), expected);
        assert_eq!(read("bgra8", 8, &[3, 2, 1, 9, 6, 5, 4, 9]).expect("bgra"), expected);
        assert_eq!(read("mono8", 2, &[7, 8]).expect("grey"), [7, 7, 7, 8, 8, 8]);
        let error = read("yuv422", 4, &[0; 4]).expect_err("yuv").to_string();
        assert!(error.contains("'yuv422' is none of"), "{error}");
    }

    #[test]
    fn compressed_colours_say_themselves_what_they_are() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            let mut bytes = Cursor::new(Vec::new());
            let grey = image::RgbImage::from_pixel(8, 6, image::Rgb([128, 128, 128]));
            DynamicImage::from(grey).write_to(&mut bytes, format).expect("memory");
            let (header, data) = (Header::default(), bytes.into_inner());
            let image =
                CompressedImage { header, format: "bgr8; jpeg compressed".into(), data: &data };
            let color = color_from_compressed(&image).expect("good");
            assert_eq!((color.width, color.height), (8, 6));
            // JPEG rounds.
            assert!(color.rgb.iter().all(|c| c.abs_diff(128) <= 1), "{format:?}");
            let cut = CompressedImage { data: &data[..data.len() / 2], ..image };
            assert!(color_from_compressed(&cut).is_err() || format == ImageFormat::Jpeg);
        }
    }
}
