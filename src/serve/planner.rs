//! Planners' questions over gRPC.

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::grpc::Edge;
use super::stream::Answers;
use super::watch::Watch;
use crate::service::{
    Call, GridQuestion, NearestQuestion, RaysQuestion, RegionQuestion, SliceQuestion,
    SpheresQuestion, TrajectoriesQuestion, WatchedTrajectories,
};
use crate::wire::v1::planner_server::Planner;
use crate::wire::{
    Ending, grid_reply_to_wire, nearest_reply_to_wire, rays_reply_to_wire, slice_reply_to_wire,
    spheres_reply_to_wire, status_from_error, trajectories_reply_to_wire, v1,
};

#[tonic::async_trait]
impl Planner for Edge {
    async fn query_spheres(
        &self,
        request: Request<v1::QuerySpheresRequest>,
    ) -> Result<Response<v1::QuerySpheresReply>, Status> {
        let answer = async {
            let question = SpheresQuestion::try_from(request.into_inner())?;
            self.service.query_spheres(question, Call::GrpcQuerySpheres).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(spheres_reply_to_wire(reply)))
    }

    async fn check_trajectories(
        &self,
        request: Request<v1::CheckTrajectoriesRequest>,
    ) -> Result<Response<v1::CheckTrajectoriesReply>, Status> {
        let answer = async {
            let question = TrajectoriesQuestion::try_from(request.into_inner())?;
            self.service.check_trajectories(question, Call::GrpcCheckTrajectories).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(trajectories_reply_to_wire(reply)))
    }

    async fn cast_rays(
        &self,
        request: Request<v1::CastRaysRequest>,
    ) -> Result<Response<v1::CastRaysReply>, Status> {
        let answer = async {
            let question = RaysQuestion::try_from(request.into_inner())?;
            self.service.cast_rays(question, Call::GrpcCastRays).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(rays_reply_to_wire(reply)))
    }

    async fn get_grid(
        &self,
        request: Request<v1::GetGridRequest>,
    ) -> Result<Response<v1::GetGridReply>, Status> {
        let answer = async {
            let question = GridQuestion::try_from(request.into_inner())?;
            self.service.get_grid(question, Call::GrpcGetGrid).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(grid_reply_to_wire(reply)))
    }

    async fn get_slice(
        &self,
        request: Request<v1::GetSliceRequest>,
    ) -> Result<Response<v1::GetSliceReply>, Status> {
        let answer = async {
            let question = SliceQuestion::try_from(request.into_inner())?;
            self.service.get_slice(question, Call::GrpcGetSlice).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(slice_reply_to_wire(reply)))
    }

    async fn find_nearest(
        &self,
        request: Request<v1::FindNearestRequest>,
    ) -> Result<Response<v1::FindNearestReply>, Status> {
        let answer = async {
            let question = NearestQuestion::try_from(request.into_inner())?;
            self.service.find_nearest(question, Call::GrpcFindNearest).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(nearest_reply_to_wire(reply)))
    }

    type WatchRegionStream = Answers<v1::WatchRegionReply>;

    async fn watch_region(
        &self,
        request: Request<v1::WatchRegionRequest>,
    ) -> Result<Response<Self::WatchRegionStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        let watch = RegionQuestion::try_from(request.into_inner())
            .and_then(|question| self.service.watch_region(question))
            .map_err(|e| status_from_error(&e))?;
        Ok(Response::new(follow(watch, ending)))
    }

    type WatchTrajectoryStream = Answers<v1::WatchTrajectoryReply>;

    async fn watch_trajectory(
        &self,
        request: Request<v1::WatchTrajectoryRequest>,
    ) -> Result<Response<Self::WatchTrajectoryStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        let watch = WatchedTrajectories::try_from(request.into_inner())
            .and_then(|watched| self.service.watch_trajectories(watched))
            .map_err(|e| status_from_error(&e))?;
        Ok(Response::new(follow(watch, ending)))
    }
}

/// Sends news as long as somebody reads them; there is room for one, and the next is looked for once
/// that is taken.
fn follow<W: Watch>(mut watch: W, mut ending: Ending) -> Answers<W::News> {
    let (news, replies) = mpsc::channel(1);
    tokio::spawn(async move {
        let end = tokio::select! {
            end = send(&mut watch, &news) => end,
            status = ending.wait() => Some(status),
            () = news.closed() => None,
        };
        drop(watch);
        if let Some(status) = end {
            // There is no room if the last news are not read yet: then the stream ends behind them.
            let _ = news.try_send(Err(status));
        }
    });
    Box::pin(ReceiverStream::new(replies))
}

/// How the stream ends; `None`: nobody reads it any more.
async fn send<W: Watch>(
    watch: &mut W,
    news: &mpsc::Sender<Result<W::News, Status>>,
) -> Option<Status> {
    loop {
        // Room first: what waits for a slow reader would be old when it is read.
        let room = news.reserve().await.ok()?;
        match watch.news().await {
            Ok(Some(reply)) => room.send(Ok(reply)),
            Ok(None) => return Some(Status::unavailable("the server is stopping")),
            Err(error) => return Some(status_from_error(&error)),
        }
    }
}
