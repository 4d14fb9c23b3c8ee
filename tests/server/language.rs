//! What frames say of meaning.

use orenx::config::{EncoderKind, EncoderSettings, Settings};
use orenx::encoder::TextEncoder;
use orenx::engine::Reason;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::frame::Meaning;
use orenx::wire::v1::{FrameReason, FrameStatus};

use super::{Running, good_frame, open_stream, start, verdict};
use crate::support::encoder::words;

/// Settings of a server with the encoder in `folder`.
fn with_encoder(settings: &mut Settings, folder: &std::path::Path) {
    let kind = EncoderKind::Static;
    settings.encoder = EncoderSettings { kind, folder: folder.into(), ..settings.encoder.clone() };
}

/// The left half of an image is a chair, the right half a table.
fn labels(frame: &v1::Frame) -> v1::LabelImage {
    let k = frame.intrinsics.as_ref().unwrap();
    let row = (0..k.width).map(|u| if u < k.width / 2 { 3 } else { 7 });
    let class = |id, name: &str| v1::LabelClass { id, name: name.into() };
    v1::LabelImage {
        encoding: v1::LabelEncoding::U8.into(),
        data: (0..k.height).flat_map(|_| row.clone()).collect(),
        classes: vec![class(7, "table"), class(3, "chair")],
        ..Default::default()
    }
}

/// A frame with such labels.
fn labelled_frame(seq: u64) -> v1::Frame {
    let mut frame = good_frame(seq);
    frame.meaning = Some(Meaning::Labels(labels(&frame)));
    frame
}

/// A frame with a grid of 4 × 3 features of an encoder.
fn featured_frame(seq: u64, encoder_id: &str, dimension: u32) -> v1::Frame {
    let numbers = (0..12 * dimension).map(|i| (i % 5) as f32 - 1.0);
    let features = v1::FeatureImage {
        encoder_id: encoder_id.into(),
        width: 4,
        height: 3,
        dimension,
        encoding: v1::FeatureEncoding::F32.into(),
        data: numbers.flat_map(f32::to_le_bytes).collect(),
        index: Vec::new(),
    };
    v1::Frame { meaning: Some(Meaning::Features(features)), ..good_frame(seq) }
}

/// The verdicts of frames, one after another.
async fn verdicts(server: &Running, frames: Vec<v1::Frame>) -> Vec<v1::FrameAck> {
    let (sender, mut acks) = open_stream(&server.channel).await;
    let mut verdicts = Vec::new();
    for frame in frames {
        sender.send(frame).await.unwrap();
        verdicts.push(verdict(&mut acks).await);
    }
    verdicts
}

/// A refusal for its encoder, and the words of it.
fn assert_refused(ack: &v1::FrameAck, field: &str, words: &[&str]) {
    let reason = (ack.status(), ack.reason());
    assert_eq!(reason, (FrameStatus::Rejected, FrameReason::Encoder), "{ack:?}");
    assert_eq!(ack.field, field, "{ack:?}");
    for word in words {
        assert!(ack.message.contains(word), "{word} in {}", ack.message);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_need_an_encoder_on_the_server() {
    let server = start(|_| {}).await;
    let acks = verdicts(&server, vec![labelled_frame(1), good_frame(2)]).await;
    assert_refused(&acks[0], "labels", &["text encoder", "encoder.kind"]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated);
    let counts = server.client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!(counts.rejected, [(Reason::Encoder, 1)]);
    server.stop().await.0.unwrap();

    let external = |settings: &mut Settings| {
        settings.encoder.kind = EncoderKind::External;
        (settings.encoder.id, settings.encoder.dimension) = ("clip".into(), 512);
    };
    let server = start(external).await;
    let acks = verdicts(&server, vec![labelled_frame(1), featured_frame(2, "clip", 512)]).await;
    assert_refused(&acks[0], "labels", &["'clip' embeds no text", "512"]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_and_features_of_the_servers_encoder_are_taken_and_others_refused() {
    let folder = words();
    let encoder = TextEncoder::open_static(folder.path()).unwrap();
    let id = encoder.contract().encoder_id.to_string();
    let server = start(|settings| with_encoder(settings, folder.path())).await;
    let mut unknown_word = labelled_frame(4);
    let Some(Meaning::Labels(labels)) = &mut unknown_word.meaning else { panic!("labels") };
    labels.classes[0].name = "nothing".into();
    let frames = vec![
        labelled_frame(1),
        featured_frame(2, &id, 8),
        featured_frame(3, "clip", 8),
        unknown_word,
        featured_frame(5, &id, 7),
    ];
    let acks = verdicts(&server, frames).await;
    assert_eq!(acks[0].status(), FrameStatus::Integrated, "{:?}", acks[0]);
    assert_eq!(acks[1].status(), FrameStatus::Integrated, "{:?}", acks[1]);
    assert_refused(&acks[2], "features.encoder_id", &["'clip'", &id]);
    assert_eq!(acks[3].reason(), FrameReason::InvalidField);
    assert_eq!(acks[3].field, "labels.classes[1].name", "in the order of ids");
    assert_refused(&acks[4], "features.encoder_id", &["7 numbers", "8 of"]);
    server.stop().await.0.unwrap();
}
