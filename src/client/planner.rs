//! Planners' questions to a server over gRPC.

use tonic::Streaming;

use super::{Authorized, Client};
use crate::error::Result;
use crate::service::{
    GridQuestion, GridReply, NearestQuestion, NearestReply, RaysQuestion, RaysReply,
    RegionQuestion, SliceQuestion, SliceReply, SpheresQuestion, SpheresReply, TrajectoriesQuestion,
    TrajectoriesReply, WatchedTrajectories,
};
use crate::wire::v1::planner_client::PlannerClient;
use crate::wire::{
    MAX_MESSAGE_BYTES, error_from_status, grid_question_to_wire, grid_reply_from_wire,
    nearest_question_to_wire, rays_question_to_wire, region_question_to_wire,
    slice_question_to_wire, spheres_question_to_wire, trajectories_question_to_wire, v1,
    watched_trajectories_to_wire,
};

impl Client {
    fn planner(&self) -> PlannerClient<Authorized> {
        PlannerClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES)
    }

    /// How far spheres are from surfaces.
    pub async fn query_spheres(&self, question: &SpheresQuestion) -> Result<SpheresReply> {
        let reply = self.planner().query_spheres(spheres_question_to_wire(question)).await;
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// Whether a robot of spheres gets along trajectories.
    pub async fn check_trajectories(
        &self,
        question: &TrajectoriesQuestion,
    ) -> Result<TrajectoriesReply> {
        let message = trajectories_question_to_wire(question);
        let reply = self.planner().check_trajectories(message).await;
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// Where rays end.
    pub async fn cast_rays(&self, question: &RaysQuestion) -> Result<RaysReply> {
        let reply = self.planner().cast_rays(rays_question_to_wire(question)).await;
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// The voxels of a box.
    pub async fn get_grid(&self, question: &GridQuestion) -> Result<GridReply> {
        let reply = self.planner().get_grid(grid_question_to_wire(question)).await;
        grid_reply_from_wire(reply.map_err(|status| error_from_status(&status))?.into_inner())
    }

    /// A slice of the map.
    pub async fn get_slice(&self, question: &SliceQuestion) -> Result<SliceReply> {
        let reply = self.planner().get_slice(slice_question_to_wire(question)).await;
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// Nearest surfaces, and distances to unknown space.
    pub async fn find_nearest(&self, question: &NearestQuestion) -> Result<NearestReply> {
        let reply = self.planner().find_nearest(nearest_question_to_wire(question)).await;
        Ok(reply.map_err(|status| error_from_status(&status))?.into_inner().into())
    }

    /// A box as it is, and then what changes in it.
    pub async fn watch_region(&self, question: &RegionQuestion) -> Result<RegionNews> {
        let news = self.planner().watch_region(region_question_to_wire(question)).await;
        Ok(RegionNews(news.map_err(|status| error_from_status(&status))?.into_inner()))
    }

    /// Trajectories as they are, and again whenever that changes.
    pub async fn watch_trajectories(
        &self,
        watched: &WatchedTrajectories,
    ) -> Result<TrajectoryNews> {
        let news = self.planner().watch_trajectory(watched_trajectories_to_wire(watched)).await;
        Ok(TrajectoryNews(news.map_err(|status| error_from_status(&status))?.into_inner()))
    }
}

/// What changes in a box.
pub struct RegionNews(Streaming<v1::WatchRegionReply>);

impl RegionNews {
    /// The next change; `None` after the last.
    pub async fn next(&mut self) -> Result<Option<v1::WatchRegionReply>> {
        self.0.message().await.map_err(|status| error_from_status(&status))
    }
}

/// What becomes of trajectories.
pub struct TrajectoryNews(Streaming<v1::WatchTrajectoryReply>);

impl TrajectoryNews {
    /// The next event; `None` after the last.
    pub async fn next(&mut self) -> Result<Option<TrajectoriesReply>> {
        let event = self.0.message().await.map_err(|status| error_from_status(&status))?;
        Ok(event.and_then(|event| event.result).map(Into::into))
    }
}
