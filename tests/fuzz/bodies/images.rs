//! Compressed images, as frames bring them: PNG and JPEG, of depth, colours and classes. A byte that
//! says which, and the file.

use std::io::Cursor;

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, ImageReader, Luma, RgbImage};
use orenx::error::Result;
use orenx::wire::ros2::{CompressedImage, Header, color_from_compressed, depth_from_compressed};
use orenx::wire::{IncomingFrame, v1};

use super::{Layout, Target, kind_of, of_kind};

pub(super) const TARGET: Target =
    Target { name: "images", read, seeds, layout: Layout::Image, longest: 4096 };

type Read = fn(&[u8]) -> Result<()>;
const KINDS: [Read; 7] = [
    |file| frame(file, ImageFormat::Png, |f, data| f.depth = depth(data)),
    |file| frame(file, ImageFormat::Png, |f, data| f.color = color(v1::ColorEncoding::Png, data)),
    |file| frame(file, ImageFormat::Jpeg, |f, data| f.color = color(v1::ColorEncoding::Jpeg, data)),
    |file| {
        frame(file, ImageFormat::Png, |f, data| {
            f.meaning = Some(v1::frame::Meaning::Labels(v1::LabelImage {
                encoding: v1::LabelEncoding::Png.into(),
                data,
                ..v1::LabelImage::default()
            }));
        })
    },
    |file| color_from_compressed(&compressed("", file)).map(drop),
    |file| depth_from_compressed(&compressed("16UC1; png compressed", file)).map(drop),
    |file| depth_from_compressed(&compressed("32FC1; compressedDepth png", file)).map(drop),
];

fn read(input: &[u8]) -> bool {
    kind_of(input, KINDS.len()).is_some_and(|(kind, file)| KINDS[kind](file).is_ok())
}

fn compressed<'a>(format: &str, data: &'a [u8]) -> CompressedImage<'a> {
    CompressedImage { header: Header::default(), format: format.into(), data }
}

fn depth(data: Vec<u8>) -> Option<v1::DepthImage> {
    let encoding = v1::DepthEncoding::Png16.into();
    Some(v1::DepthImage { encoding, units_per_metre: 1000.0, data })
}

fn color(encoding: v1::ColorEncoding, data: Vec<u8>) -> Option<v1::ColorImage> {
    Some(v1::ColorImage { encoding: encoding.into(), data })
}

/// A frame whose camera has as many pixels as the file says of itself, so that it is read on.
fn frame(
    file: &[u8],
    format: ImageFormat,
    put: impl FnOnce(&mut v1::Frame, Vec<u8>),
) -> Result<()> {
    let size = ImageReader::with_format(Cursor::new(file), format).into_dimensions();
    let (width, height) = size.unwrap_or((1, 1));
    let pixels = width as usize * height as usize;
    let rotation = Some(v1::Quaternion { w: 1.0, ..v1::Quaternion::default() });
    let mut message = v1::Frame {
        world_from_camera: Some(v1::Pose { translation: Some(v1::Vector3::default()), rotation }),
        intrinsics: Some(v1::Intrinsics { width, height, ..v1::Intrinsics::default() }),
        depth: Some(v1::DepthImage {
            encoding: v1::DepthEncoding::F32Metres.into(),
            // Of a size that is refused anyway there need be no pixels.
            data: vec![0; if pixels <= orenx::wire::MAX_PIXELS { 4 * pixels } else { 0 }],
            units_per_metre: 1.0,
        }),
        ..v1::Frame::default()
    };
    put(&mut message, file.to_vec());
    IncomingFrame::try_from(message).map(drop)
}

fn seeds() -> Vec<Vec<u8>> {
    let file = |image: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let deep = ImageBuffer::<Luma<u16>, _>::from_fn(8, 6, |x, y| Luma([(1000 + x * y) as u16]));
    let deep = file(&DynamicImage::ImageLuma16(deep), ImageFormat::Png);
    let colors = RgbImage::from_fn(8, 6, |x, y| image::Rgb([x as u8 * 9, y as u8 * 9, 7]));
    let colors = DynamicImage::ImageRgb8(colors);
    let clear = DynamicImage::ImageRgba16(colors.to_rgba16());
    let classes = GrayImage::from_fn(8, 6, |x, _| Luma([x as u8 % 3]));
    let classes = file(&DynamicImage::ImageLuma8(classes), ImageFormat::Png);
    let [png, jpeg] = [ImageFormat::Png, ImageFormat::Jpeg].map(|format| file(&colors, format));
    // What compressed_depth_image_transport puts before its PNG.
    let quantised = [&[0; 4][..], &3000f32.to_le_bytes(), &500f32.to_le_bytes(), &deep].concat();
    vec![
        of_kind(0, &deep),
        of_kind(1, &png),
        of_kind(1, &file(&clear, ImageFormat::Png)),
        of_kind(2, &jpeg),
        of_kind(3, &classes),
        of_kind(3, &deep),
        of_kind(4, &jpeg),
        of_kind(5, &deep),
        of_kind(6, &quantised),
    ]
}
