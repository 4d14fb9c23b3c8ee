//! Questions for images with one field wrong in turn, alone and in a stream.

use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::render_stream_reply::Answer;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;

use super::super::start;
use super::{ended, well};

const PATH: &str = "/orenx.v1.Render/Render";

/// What is wrong with a question, the code of its refusal, the field, and what is said.
type Fault = (fn(&mut v1::RenderRequest), Code, &'static str, &'static [&'static str]);

const POSE: &str = "world_from_camera";
const FAULTS: &[Fault] = {
    use Code::{FailedPrecondition, InvalidArgument, NotFound};
    &[
        (|q| q.map_id.clear(), InvalidArgument, "map_id", &["default"]),
        (|q| q.map_id = "attic".into(), NotFound, "", &["map_id", "attic"]),
        (|q| q.world_from_camera = None, InvalidArgument, POSE, &["required"]),
        (
            |q| pose(q).translation = None,
            InvalidArgument,
            "world_from_camera.translation",
            &["required"],
        ),
        (
            |q| pose(q).translation.as_mut().unwrap().y = f64::NAN,
            InvalidArgument,
            "world_from_camera.translation",
            &["finite"],
        ),
        (
            |q| pose(q).translation.as_mut().unwrap().y = 1e5,
            InvalidArgument,
            "world_from_camera.translation",
            &["10000"],
        ),
        (
            |q| pose(q).rotation.as_mut().unwrap().w = 2.0,
            InvalidArgument,
            "world_from_camera.rotation",
            &["length 2", "0.01"],
        ),
        (|q| q.intrinsics = None, InvalidArgument, "intrinsics", &["required"]),
        (|q| camera(q).fx = 0.0, InvalidArgument, "intrinsics.fx", &["0 px"]),
        (|q| camera(q).fy = f64::NAN, InvalidArgument, "intrinsics.fy", &["NaN"]),
        (|q| camera(q).cx = f64::INFINITY, InvalidArgument, "intrinsics.cx", &["inf"]),
        (|q| camera(q).width = 0, InvalidArgument, "intrinsics.width", &["0", "1..=4096"]),
        (|q| camera(q).height = 4097, InvalidArgument, "intrinsics.height", &["4097", "1..=4096"]),
        (
            |q| (camera(q).width, camera(q).height) = (40, 26),
            InvalidArgument,
            "intrinsics",
            &["40x26", "1040", "1000", "server.max_pixels"],
        ),
        (|q| q.images[1].output = 0, InvalidArgument, "images[1].output", &["0", "COLOR, DEPTH"]),
        (|q| q.images[1].output = 77, InvalidArgument, "images[1].output", &["77", "UNKNOWN"]),
        (|q| q.images[0].encoding = 9, InvalidArgument, "images[0].encoding", &["9", "PNG, JPEG"]),
        (|q| q.images[1].encoding = 2, InvalidArgument, "images[1].encoding", &["not for depth"]),
        (|q| q.images[1].encoding = 4, InvalidArgument, "images[1].encoding", &["no room", "f32"]),
        (
            |q| q.images[0].jpeg_quality = 50,
            InvalidArgument,
            "images[0].jpeg_quality",
            &["50", "JPEG"],
        ),
        (
            |q| (q.images[0].encoding, q.images[0].jpeg_quality) = (2, 101),
            InvalidArgument,
            "images[0].jpeg_quality",
            &["101", "1..=100"],
        ),
        (|q| q.images = vec![q.images[0]; 9], InvalidArgument, "images", &["9", "1..=8"]),
        (|q| q.renderer = 3, InvalidArgument, "renderer", &["3", "TILE, RAY"]),
        (|q| q.min_epoch = 1, FailedPrecondition, "", &["min_epoch", "1", "newest is 0"]),
        (|q| q.max_age_ms = 50, FailedPrecondition, "", &["max_age_ms", "no frame", "50"]),
    ]
};

fn pose(question: &mut v1::RenderRequest) -> &mut v1::Pose {
    question.world_from_camera.as_mut().unwrap()
}

fn camera(question: &mut v1::RenderRequest) -> &mut v1::Intrinsics {
    question.intrinsics.as_mut().unwrap()
}

fn good() -> v1::RenderRequest {
    let image = |output: v1::ImageOutput| v1::ImageRequest {
        output: output.into(),
        ..v1::ImageRequest::default()
    };
    v1::RenderRequest {
        map_id: DEFAULT_MAP.into(),
        world_from_camera: Some(v1::Pose {
            translation: Some(v1::Vector3::default()),
            rotation: Some(v1::Quaternion { w: 1.0, ..v1::Quaternion::default() }),
        }),
        intrinsics: Some(v1::Intrinsics {
            fx: 30.0,
            fy: 30.0,
            cx: 19.5,
            cy: 9.5,
            width: 40,
            height: 20,
        }),
        images: vec![image(v1::ImageOutput::Color), image(v1::ImageOutput::Depth)],
        ..v1::RenderRequest::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn each_is_refused_by_name_alone_and_in_a_stream() {
    let server = start(|settings| settings.server.max_pixels = 1000).await;
    let mut client = v1::render_client::RenderClient::new(server.channel.clone());
    let (questions, outgoing) = mpsc::channel(1);
    let mut replies =
        client.render_stream(ReceiverStream::new(outgoing)).await.unwrap().into_inner();
    for (id, (spoil, code, field, words)) in (1..).zip(FAULTS) {
        let mut question = good();
        spoil(&mut question);
        let before = ended(&server, PATH, *code).await;
        let status = client.render(question.clone()).await.expect_err(words[0]);
        assert_eq!(ended(&server, PATH, *code).await, before + 1.0, "{field}");
        assert_eq!(status.code(), *code, "{}", status.message());
        assert!(status.message().starts_with(field), "{field}: {}", status.message());
        for word in *words {
            assert!(status.message().contains(word), "{word} in: {}", status.message());
        }

        let request = Some(question);
        questions.send(v1::RenderStreamRequest { id, request }).await.unwrap();
        let reply = replies.message().await.unwrap().expect("a reply");
        let Some(Answer::Error(error)) = reply.answer else { panic!("{reply:?}") };
        assert_eq!((reply.id, error.code), (id, i32::from(*code) as u32));
        assert_eq!((error.field.as_str(), error.message.as_str()), (*field, status.message()));
        well(&server).await;
    }
    questions.send(v1::RenderStreamRequest { id: 99, request: None }).await.unwrap();
    let reply = replies.message().await.unwrap().expect("a reply");
    assert!(matches!(reply.answer, Some(Answer::Error(e)) if e.field == "request"));

    // The stream goes on.
    let request = Some(good());
    questions.send(v1::RenderStreamRequest { id: 100, request }).await.unwrap();
    let reply = replies.message().await.unwrap().expect("a reply");
    assert!(matches!(reply.answer, Some(Answer::Reply(reply)) if reply.images.len() == 2));
    drop(questions);
    assert!(replies.message().await.unwrap().is_none(), "it ends with its questions");
    server.stop().await.0.unwrap();
}
