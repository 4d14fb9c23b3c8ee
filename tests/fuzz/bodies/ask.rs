//! Questions and edits as messages, asked of a small map that is served: what no map could answer must be
//! refused before anything is worked out, and everything else is answered. A byte that says which
//! message, and its bytes.

use std::time::Instant;

use orenx::engine::{FrameSink, Queue, Verdict};
use orenx::error::{Error, Result, Status};
use orenx::map::Edit;
use orenx::service::{
    Call, ClassifyQuestion, FindQuestion, GridQuestion, ImageQuestion, NearestQuestion,
    PointsQuestion, RaysQuestion, RegionQuestion, SliceQuestion, SpheresQuestion,
    TrajectoriesQuestion, WatchedTrajectories,
};
use orenx::wire::{IncomingFrame, frame_to_wire, read_message, v1};
use prost::Message;

use super::server::{Server, note_change, with};
use super::{Layout, Target, kind_of, of_kind, questions, scene};

pub(super) const TARGET: Target =
    Target { name: "ask", read, seeds, layout: Layout::Protobuf(1), longest: 2048 };

/// Those of `wire` from its third on, in the same order.
type Read = fn(&Server, &[u8]) -> Result<()>;
const KINDS: [Read; 16] = [
    |s, bytes| {
        let question = PointsQuestion::try_from(read_message::<v1::QueryPointsRequest>(bytes)?)?;
        s.wait(s.service.query_points(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = SpheresQuestion::try_from(read_message::<v1::QuerySpheresRequest>(bytes)?)?;
        s.wait(s.service.query_spheres(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let message = read_message::<v1::CheckTrajectoriesRequest>(bytes)?;
        let question = TrajectoriesQuestion::try_from(message)?;
        s.wait(s.service.check_trajectories(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = RaysQuestion::try_from(read_message::<v1::CastRaysRequest>(bytes)?)?;
        s.wait(s.service.cast_rays(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = NearestQuestion::try_from(read_message::<v1::FindNearestRequest>(bytes)?)?;
        s.wait(s.service.find_nearest(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = GridQuestion::try_from(read_message::<v1::GetGridRequest>(bytes)?)?;
        s.wait(s.service.get_grid(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = SliceQuestion::try_from(read_message::<v1::GetSliceRequest>(bytes)?)?;
        s.wait(s.service.get_slice(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = ImageQuestion::try_from(read_message::<v1::RenderRequest>(bytes)?)?;
        s.wait(s.service.render(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = FindQuestion::try_from(read_message::<v1::QueryTextRequest>(bytes)?)?;
        s.wait(s.service.find(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = FindQuestion::try_from(read_message::<v1::QueryEmbeddingRequest>(bytes)?)?;
        s.wait(s.service.find(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let question = ClassifyQuestion::try_from(read_message::<v1::ClassifyRequest>(bytes)?)?;
        s.wait(s.service.classify(question, Call::GrpcQueryPoints)).map(drop)
    },
    |s, bytes| {
        let message = read_message::<v1::ClearRegionRequest>(bytes)?;
        let map_id = message.map_id.clone();
        s.wait(s.service.edit_map(&map_id, Edit::Clear(message.try_into()?)))?;
        note_change();
        Ok(())
    },
    |s, bytes| {
        let message = read_message::<v1::StampGeometryRequest>(bytes)?;
        let map_id = message.map_id.clone();
        s.wait(s.service.edit_map(&map_id, Edit::Stamp(message.try_into()?)))?;
        note_change();
        Ok(())
    },
    |s, bytes| {
        let question = RegionQuestion::try_from(read_message::<v1::WatchRegionRequest>(bytes)?)?;
        s.service.watch_region(question).map(drop)
    },
    |s, bytes| {
        let message = read_message::<v1::WatchTrajectoryRequest>(bytes)?;
        let watched = WatchedTrajectories::try_from(message)?;
        s.service.watch_trajectories(watched).map(drop)
    },
    frame,
];

fn read(input: &[u8]) -> bool {
    let Some((kind, bytes)) = kind_of(input, KINDS.len()) else { return false };
    match with(|server| KINDS[kind](server, bytes)) {
        Ok(()) => true,
        Err(error) => {
            let fault = error.status();
            assert_ne!(
                fault,
                Status::Internal,
                "{error}: nothing from outside may break a promise"
            );
            false
        }
    }
}

/// Hears what became of a frame.
struct Ear(std::sync::mpsc::SyncSender<Verdict>);

impl FrameSink for Ear {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, verdict: Verdict) {
        let _ = self.0.send(verdict);
    }
}

/// Sends a frame to the map and waits for its verdict.
pub(super) fn submit(server: &Server, incoming: IncomingFrame) -> Result<()> {
    let IncomingFrame { map_id, policy, frame, .. } = incoming;
    let (ear, verdicts) = std::sync::mpsc::sync_channel(1);
    let session = server.service.session();
    let sink = Box::new(Ear(ear));
    server.wait(server.service.submit_frame(session, &map_id, frame, policy, sink, Instant::now()));
    match verdicts.recv().expect("every frame gets one verdict") {
        Verdict::Integrated { .. } => Ok(()),
        Verdict::Rejected(error) => Err(error),
        Verdict::Dropped(reason) => Err(Error::FailedPrecondition(format!("{reason:?}"))),
    }
}

fn frame(server: &Server, bytes: &[u8]) -> Result<()> {
    submit(server, IncomingFrame::try_from(read_message::<v1::Frame>(bytes)?)?)?;
    note_change();
    Ok(())
}

fn seeds() -> Vec<Vec<u8>> {
    let frame = frame_to_wire("default", &scene::frame(50), orenx::engine::QueuePolicy::Block);
    let mut all: Vec<_> =
        questions::all().into_iter().map(|(kind, bytes)| of_kind(kind, &bytes)).collect();
    all.push(of_kind(15, &frame.encode_to_vec()));
    all
}
