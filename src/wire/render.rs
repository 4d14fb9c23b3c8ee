//! `render.proto`: questions for images and their answers.

use std::time::Duration;

use super::geometry::{
    intrinsics_from_wire, intrinsics_to_wire, pose_from_wire, pose_to_wire, required,
};
use super::language::text_to_wire;
use super::query::{refusal_from_wire, refusal_to_wire};
use super::{MAX_MESSAGE_BYTES, v1};
use crate::config::Renderer;
use crate::error::{Error, Result};
use crate::map::{Camera, Encoding, Output};
use crate::service::{ImageKind, ImageQuestion, ImageReply, MAX_IMAGE_BYTES, Sought};

// An answer, its headers and those of its PNG files included, is one message.
const _: () = assert!(MAX_IMAGE_BYTES + (1 << 20) <= MAX_MESSAGE_BYTES);

/// What an empty list of images stands for.
const USUAL: [ImageKind; 2] = [
    ImageKind { output: Output::Color, encoding: Encoding::Png },
    ImageKind { output: Output::Depth, encoding: Encoding::Png },
];

/// Shape and names are checked here, as they are of the message; the rest where every transport's
/// questions are.
impl TryFrom<v1::RenderRequest> for ImageQuestion {
    type Error = Error;

    fn try_from(message: v1::RenderRequest) -> Result<Self> {
        let camera = Camera {
            world_from_camera: pose_from_wire(required(
                "world_from_camera",
                message.world_from_camera,
            )?)?,
            intrinsics: intrinsics_from_wire(required("intrinsics", message.intrinsics)?),
        };
        let kind = |(at, image): (usize, &v1::ImageRequest)| {
            let field = |name: &str| format!("images[{at}].{name}");
            Ok(ImageKind {
                output: output_from_wire(&field("output"), image.output)?,
                encoding: encoding_from_wire(&field, image)?,
            })
        };
        let images = message.images.iter().enumerate().map(kind).collect::<Result<Vec<_>>>()?;
        Ok(Self {
            camera,
            images: if images.is_empty() { USUAL.to_vec() } else { images },
            renderer: renderer_from_wire(message.renderer)?,
            text: message.text.map(Sought::try_from).transpose()?,
            map_id: message.map_id,
            min_epoch: message.min_epoch,
            max_age: (message.max_age_ms > 0).then(|| Duration::from_millis(message.max_age_ms)),
        })
    }
}

/// The message of a question.
pub fn image_question_to_wire(question: &ImageQuestion) -> v1::RenderRequest {
    let image = |kind: &ImageKind| v1::ImageRequest {
        output: output_to_wire(kind.output).into(),
        encoding: encoding_to_wire(kind.encoding).into(),
        jpeg_quality: match kind.encoding {
            Encoding::Jpeg { quality } => quality.into(),
            _ => 0,
        },
    };
    v1::RenderRequest {
        map_id: question.map_id.clone(),
        world_from_camera: Some(pose_to_wire(&question.camera.world_from_camera)),
        intrinsics: Some(intrinsics_to_wire(&question.camera.intrinsics)),
        images: question.images.iter().map(image).collect(),
        renderer: match question.renderer {
            Renderer::Tile => v1::Renderer::Tile.into(),
            Renderer::Ray => v1::Renderer::Ray.into(),
        },
        min_epoch: question.min_epoch,
        // At least 1: a limit of 0 would read as none.
        max_age_ms: question.max_age.map_or(0, |age| (age.as_millis() as u64).max(1)),
        text: question.text.as_ref().map(text_to_wire),
    }
}

fn renderer_from_wire(renderer: i32) -> Result<Renderer> {
    match v1::Renderer::try_from(renderer) {
        Ok(v1::Renderer::Unspecified | v1::Renderer::Tile) => Ok(Renderer::Tile),
        Ok(v1::Renderer::Ray) => Ok(Renderer::Ray),
        Err(_) => Err(Error::invalid("renderer", format!("{renderer} is none of TILE, RAY"))),
    }
}

fn output_from_wire(field: &str, output: i32) -> Result<Output> {
    match v1::ImageOutput::try_from(output) {
        Ok(v1::ImageOutput::Color) => Ok(Output::Color),
        Ok(v1::ImageOutput::Depth) => Ok(Output::Depth),
        Ok(v1::ImageOutput::Normal) => Ok(Output::Normal),
        Ok(v1::ImageOutput::Opacity) => Ok(Output::Opacity),
        Ok(v1::ImageOutput::Unknown) => Ok(Output::Unknown),
        Ok(v1::ImageOutput::Heat) => Ok(Output::Heat),
        Ok(v1::ImageOutput::Unspecified) | Err(_) => Err(Error::invalid(
            field,
            format!("{output} is none of COLOR, DEPTH, NORMAL, OPACITY, UNKNOWN, HEAT"),
        )),
    }
}

fn output_to_wire(output: Output) -> v1::ImageOutput {
    match output {
        Output::Color => v1::ImageOutput::Color,
        Output::Depth => v1::ImageOutput::Depth,
        Output::Normal => v1::ImageOutput::Normal,
        Output::Opacity => v1::ImageOutput::Opacity,
        Output::Unknown => v1::ImageOutput::Unknown,
        Output::Heat => v1::ImageOutput::Heat,
    }
}

fn encoding_from_wire(
    field: &impl Fn(&str) -> String,
    image: &v1::ImageRequest,
) -> Result<Encoding> {
    let encoding = match v1::ImageEncoding::try_from(image.encoding) {
        Ok(v1::ImageEncoding::Jpeg) => return jpeg(&field("jpeg_quality"), image.jpeg_quality),
        Ok(v1::ImageEncoding::Unspecified | v1::ImageEncoding::Png) => Encoding::Png,
        Ok(v1::ImageEncoding::F32) => Encoding::F32,
        Ok(v1::ImageEncoding::U8) => Encoding::U8,
        Err(_) => {
            let problem = format!("{} is none of PNG, JPEG, F32, U8", image.encoding);
            return Err(Error::invalid(field("encoding"), problem));
        }
    };
    if image.jpeg_quality != 0 {
        let problem = format!("{} needs encoding JPEG", image.jpeg_quality);
        return Err(Error::invalid(field("jpeg_quality"), problem));
    }
    Ok(encoding)
}

/// 0 is the usual quality.
fn jpeg(field: &str, quality: u32) -> Result<Encoding> {
    match u8::try_from(quality) {
        Ok(0) => Ok(Encoding::JPEG),
        Ok(quality @ 1..=100) => Ok(Encoding::Jpeg { quality }),
        _ => Err(Error::invalid(field, format!("{quality} must be within 1..=100"))),
    }
}

fn encoding_to_wire(encoding: Encoding) -> v1::ImageEncoding {
    match encoding {
        Encoding::Png => v1::ImageEncoding::Png,
        Encoding::Jpeg { .. } => v1::ImageEncoding::Jpeg,
        Encoding::F32 => v1::ImageEncoding::F32,
        Encoding::U8 => v1::ImageEncoding::U8,
    }
}

/// The message of an answer.
pub fn image_reply_to_wire(reply: ImageReply) -> v1::RenderReply {
    let image = |(kind, data): (ImageKind, Vec<u8>)| v1::RenderedImage {
        output: output_to_wire(kind.output).into(),
        encoding: encoding_to_wire(kind.encoding).into(),
        data,
    };
    v1::RenderReply {
        images: reply.images.into_iter().map(image).collect(),
        width: reply.width,
        height: reply.height,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

/// The answer to a question for `images`.
pub fn image_reply_from_wire(message: v1::RenderReply, images: &[ImageKind]) -> Result<ImageReply> {
    if message.images.len() != images.len() {
        let problem = format!("{} images where {} are", message.images.len(), images.len());
        return Err(Error::corrupt("the server's answer", problem));
    }
    let bytes = message.images.into_iter().map(|image| image.data);
    Ok(ImageReply {
        images: images.iter().copied().zip(bytes).collect(),
        width: message.width,
        height: message.height,
        epoch: message.epoch,
        newest_stamp_ns: message.newest_stamp_ns,
        spent: Duration::from_micros(message.server_us),
    })
}

/// The message of a question in a stream.
pub fn stream_image_question_to_wire(id: u64, question: &ImageQuestion) -> v1::RenderStreamRequest {
    v1::RenderStreamRequest { id, request: Some(image_question_to_wire(question)) }
}

/// The question of a stream's request.
pub fn stream_image_question_from_wire(message: v1::RenderStreamRequest) -> Result<ImageQuestion> {
    required("request", message.request)?.try_into()
}

/// The message of what became of a question in a stream.
pub fn stream_image_reply_to_wire(id: u64, outcome: Result<ImageReply>) -> v1::RenderStreamReply {
    use v1::render_stream_reply::Answer;
    let answer = match outcome {
        Ok(reply) => Answer::Reply(image_reply_to_wire(reply)),
        Err(error) => Answer::Error(refusal_to_wire(&error)),
    };
    v1::RenderStreamReply { id, answer: Some(answer) }
}

/// What became of a question for `images` in a stream.
pub fn stream_image_reply_from_wire(
    message: v1::RenderStreamReply,
    images: &[ImageKind],
) -> Result<Result<ImageReply>> {
    use v1::render_stream_reply::Answer;
    Ok(match required("answer", message.answer)? {
        Answer::Reply(reply) => Ok(image_reply_from_wire(reply, images)?),
        Answer::Error(error) => Err(refusal_from_wire(error)),
    })
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;
    use prost::Message;

    use super::*;
    use crate::geometry::{Intrinsics, Pose};

    prop_compose! {
        fn kinds()(
            output in prop::sample::select([&Output::ALL[..], &[Output::Heat]].concat()),
            encoding in prop_oneof![
                Just(Encoding::Png), Just(Encoding::F32), Just(Encoding::U8),
                (1u8..=100).prop_map(|quality| Encoding::Jpeg { quality }),
            ],
        ) -> ImageKind {
            ImageKind { output, encoding }
        }
    }

    prop_compose! {
        fn questions()(
            (angle, translation) in (-3.0f64..3.0, prop::array::uniform3(-1e3f64..1e3)),
            numbers in prop::array::uniform4(1.0f64..1e3),
            (width, height) in (0u32..5000, 0u32..5000),
            images in prop::collection::vec(kinds(), 1..9),
            [is_ray, has_text] in any::<[bool; 2]>(),
            (min_epoch, max_age_ms) in (any::<u64>(), prop::option::of(1..u64::MAX)),
        ) -> ImageQuestion {
            let [fx, fy, cx, cy] = numbers;
            // As it arrives: of unit length.
            let rotation = DQuat::from_rotation_y(angle).normalize();
            ImageQuestion {
                map_id: "default".into(),
                camera: Camera {
                    world_from_camera: Pose { rotation, translation: DVec3::from(translation) },
                    intrinsics: Intrinsics { fx, fy, cx, cy, width, height },
                },
                images,
                renderer: if is_ray { Renderer::Ray } else { Renderer::Tile },
                text: has_text.then(|| Sought::words(&["somewhere to sit"])),
                min_epoch,
                max_age: max_age_ms.map(Duration::from_millis),
            }
        }
    }

    proptest! {
        #[test]
        fn a_question_comes_back_as_it_was(question in questions()) {
            let bytes = image_question_to_wire(&question).encode_to_vec();
            let message = v1::RenderRequest::decode(bytes.as_slice()).expect("our own");
            let mut back = ImageQuestion::try_from(message).expect("good");
            let rotation = question.camera.world_from_camera.rotation;
            prop_assert!((back.camera.world_from_camera.rotation - rotation).length() < 1e-15);
            back.camera.world_from_camera.rotation = rotation;
            prop_assert_eq!(back, question);
        }

        #[test]
        fn noise_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(message) = v1::RenderRequest::decode(bytes.as_slice()) {
                let _ = ImageQuestion::try_from(message);
            }
        }
    }

    #[test]
    fn what_became_of_a_streamed_question_comes_back() {
        let reply = ImageReply {
            images: vec![(USUAL[0], vec![1, 2]), (USUAL[1], vec![3])],
            width: 2,
            height: 1,
            epoch: 4,
            newest_stamp_ns: 5,
            spent: Duration::from_micros(6),
        };
        let message = stream_image_reply_to_wire(7, Ok(reply.clone()));
        assert_eq!(message.id, 7);
        let back = stream_image_reply_from_wire(message.clone(), &USUAL).expect("whole");
        assert_eq!(back.expect("an answer"), reply);
        assert!(stream_image_reply_from_wire(message, &USUAL[..1]).is_err(), "not what was asked");
        let message = stream_image_reply_to_wire(7, Err(Error::invalid("renderer", "7 is none")));
        let back = stream_image_reply_from_wire(message, &USUAL).expect("whole");
        assert_eq!(back.expect_err("refused").to_string(), "renderer: 7 is none");
        let nothing = v1::RenderStreamReply::default();
        assert!(stream_image_reply_from_wire(nothing, &USUAL).is_err());
    }

    #[test]
    fn no_images_are_colour_and_depth() {
        let identity = v1::Quaternion { w: 1.0, ..v1::Quaternion::default() };
        let pose = v1::Pose { translation: Some(v1::Vector3::default()), rotation: Some(identity) };
        let message = v1::RenderRequest {
            world_from_camera: Some(pose),
            intrinsics: Some(v1::Intrinsics::default()),
            ..v1::RenderRequest::default()
        };
        let question = ImageQuestion::try_from(message).expect("enough");
        assert_eq!((question.images, question.renderer), (USUAL.to_vec(), Renderer::Tile));
    }
}
