//! Messages of `orenx.v1`, each into what it stands for: what clients of gRPC and Zenoh send, and what a
//! server answers them. A byte that says which message, and its bytes.

use orenx::engine::QueuePolicy;
use orenx::error::{Error, Result};
use orenx::map::{Clear, Edited, Stamp};
use orenx::service::{
    ClassifyQuestion, ClassifyReply, FindQuestion, FindReply, GridQuestion, ImageQuestion,
    NearestQuestion, NearestReply, PointsQuestion, PointsReply, RaysQuestion, RaysReply,
    RegionQuestion, SliceQuestion, Sought, SpheresQuestion, SpheresReply, TrajectoriesQuestion,
    TrajectoriesReply, WatchedTrajectories,
};
use orenx::wire::{self, FrameHead, IncomingFrame, Subscription, read_message, v1};
use prost::Message;

use super::{Layout, Target, kind_of, of_kind, questions, scene};

pub(super) const TARGET: Target =
    Target { name: "wire", read, seeds, layout: Layout::Protobuf(1), longest: 4096 };

type Read = fn(&[u8]) -> Result<()>;

const KINDS: [Read; 28] = [
    frame,
    head,
    into::<v1::QueryPointsRequest, PointsQuestion>,
    into::<v1::QuerySpheresRequest, SpheresQuestion>,
    into::<v1::CheckTrajectoriesRequest, TrajectoriesQuestion>,
    into::<v1::CastRaysRequest, RaysQuestion>,
    into::<v1::FindNearestRequest, NearestQuestion>,
    into::<v1::GetGridRequest, GridQuestion>,
    into::<v1::GetSliceRequest, SliceQuestion>,
    into::<v1::RenderRequest, ImageQuestion>,
    into::<v1::QueryTextRequest, FindQuestion>,
    into::<v1::QueryEmbeddingRequest, FindQuestion>,
    into::<v1::ClassifyRequest, ClassifyQuestion>,
    into::<v1::ClearRegionRequest, Clear>,
    into::<v1::StampGeometryRequest, Stamp>,
    into::<v1::WatchRegionRequest, RegionQuestion>,
    into::<v1::WatchTrajectoryRequest, WatchedTrajectories>,
    into::<v1::Text, Sought>,
    told::<v1::SubscribeRequest, Subscription>,
    told::<v1::QueryPointsReply, PointsReply>,
    told::<v1::QuerySpheresReply, SpheresReply>,
    told::<v1::CheckTrajectoriesReply, TrajectoriesReply>,
    told::<v1::CastRaysReply, RaysReply>,
    told::<v1::FindNearestReply, NearestReply>,
    told::<v1::QueryTextReply, FindReply>,
    told::<v1::ClassifyReply, ClassifyReply>,
    told::<v1::EditReply, Edited>,
    answers,
];

fn read(input: &[u8]) -> bool {
    kind_of(input, KINDS.len()).is_some_and(|(kind, bytes)| KINDS[kind](bytes).is_ok())
}

fn into<M: Message + Default, T: TryFrom<M, Error = Error>>(bytes: &[u8]) -> Result<()> {
    T::try_from(read_message::<M>(bytes)?).map(drop)
}

fn told<M: Message + Default, T: From<M>>(bytes: &[u8]) -> Result<()> {
    drop(T::from(read_message::<M>(bytes)?));
    Ok(())
}

/// A frame that is good comes back from its own message.
fn frame(bytes: &[u8]) -> Result<()> {
    let incoming = IncomingFrame::try_from(read_message::<v1::Frame>(bytes)?)?;
    incoming.frame.check()?;
    let IncomingFrame { map_id, policy, frame, labels } = incoming;
    let message = wire::labelled_frame_to_wire(&map_id, &frame, labels.as_ref(), policy);
    let again = IncomingFrame::try_from(message).expect("a good frame can be sent on");
    assert_eq!(again.frame.depth, frame.depth);
    Ok(())
}

fn head(bytes: &[u8]) -> Result<()> {
    let head = FrameHead::read(bytes)?;
    let (policy, summary) = (head.policy(), head.summary());
    assert!(matches!(policy, QueuePolicy::Latest | QueuePolicy::Block));
    let (robot, sensor) = (summary.robot_id.to_string(), summary.sensor_id.to_string());
    head.named("default", &robot, &sensor).map(drop)
}

/// What is an answer only together with its question.
fn answers(bytes: &[u8]) -> Result<()> {
    let (which, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    match which % 7 {
        0 => wire::grid_reply_from_wire(read_message(bytes)?).map(drop),
        1 => wire::stream_reply_from_wire(read_message(bytes)?).map(drop),
        2 => wire::image_reply_from_wire(read_message(bytes)?, &[]).map(drop),
        3 => wire::map_stats_from_wire(read_message(bytes)?).map(drop),
        4 => wire::snapshot_from_wire(Some(read_message(bytes)?)).map(drop),
        5 => wire::stream_image_question_from_wire(read_message(bytes)?).map(drop),
        _ => {
            // The header of raw columns, a line end, and the columns.
            let at = bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
            let (header, body) = bytes.split_at(at);
            let header = String::from_utf8_lossy(header);
            wire::columns_from_wire(&header, body.get(1..).unwrap_or_default(), 2).map(drop)
        }
    }
}

fn seeds() -> Vec<Vec<u8>> {
    let frame = scene::frame(3);
    let message = |policy| wire::frame_to_wire("default", &frame, policy);
    let raw = v1::Frame {
        depth: Some(v1::DepthImage {
            encoding: v1::DepthEncoding::U16.into(),
            units_per_metre: 1000.0,
            data: frame
                .depth
                .metres
                .iter()
                .flat_map(|z| ((z * 1e3) as u16).to_le_bytes())
                .collect(),
        }),
        meaning: Some(v1::frame::Meaning::Labels(v1::LabelImage {
            encoding: v1::LabelEncoding::U8.into(),
            data: vec![1; frame.depth.metres.len()],
            classes: vec![v1::LabelClass { id: 1, name: "chair".into() }],
            ..v1::LabelImage::default()
        })),
        ..message(QueuePolicy::Block)
    };
    let mut all = vec![
        of_kind(0, &message(QueuePolicy::Latest).encode_to_vec()),
        of_kind(0, &raw.encode_to_vec()),
        of_kind(1, &message(QueuePolicy::Latest).encode_to_vec()),
        of_kind(27, b"\x06distance_m;type=f32;width=1;offset=0\n\0\0\x80?\0\0\0@"),
    ];
    // Questions stand in the list of kinds behind frames and heads, in the order of their own target.
    let questions = questions::all().into_iter();
    all.extend(questions.map(|(kind, bytes)| of_kind(2 + kind, &bytes)));
    all
}
