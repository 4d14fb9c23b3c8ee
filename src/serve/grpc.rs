//! Questions over gRPC: about points, for images, and in words.

use std::sync::Arc;
use std::time::Instant;

use tokio::sync::watch;
use tonic::{Request, Response, Status, Streaming};

use super::stream::{Answers, answer_stream};
use crate::error;
use crate::map::Edit;
use crate::service::{
    Call, ClassifyQuestion, FindQuestion, ImageQuestion, PointsQuestion, Service,
};
use crate::wire::v1::language_server::Language;
use crate::wire::v1::maps_server::Maps;
use crate::wire::v1::query_server::Query;
use crate::wire::v1::render_server::Render;
use crate::wire::{
    Ending, classify_reply_to_wire, edited_to_wire, encoders_to_wire, find_reply_to_wire,
    image_reply_to_wire, map_detail_to_wire, map_list_to_wire, map_reset_to_wire,
    map_stats_to_wire, points_reply_to_wire, status_from_error, v1,
};

/// `orenx.v1.Query`, `Render`, `Language` and `Maps`: messages in, verbs, messages out.
#[derive(Clone)]
pub(super) struct Edge {
    pub(super) service: Arc<Service>,
    pub(super) closing: watch::Receiver<bool>,
}

impl Edge {
    /// `closing` turns true when streams must end.
    pub(super) fn new(service: Arc<Service>, closing: watch::Receiver<bool>) -> Self {
        Self { service, closing }
    }
}

#[tonic::async_trait]
impl Query for Edge {
    async fn query_points(
        &self,
        request: Request<v1::QueryPointsRequest>,
    ) -> Result<Response<v1::QueryPointsReply>, Status> {
        let answer = async {
            let question = PointsQuestion::try_from(request.into_inner())?;
            self.service.query_points(question, Call::GrpcQueryPoints).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(points_reply_to_wire(reply)))
    }

    type StreamQueryStream = Answers<v1::StreamQueryReply>;

    async fn stream_query(
        &self,
        request: Request<Streaming<v1::StreamQueryRequest>>,
    ) -> Result<Response<Self::StreamQueryStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        Ok(Response::new(answer_stream(self.service.clone(), request.into_inner(), ending)))
    }
}

#[tonic::async_trait]
impl Render for Edge {
    async fn render(
        &self,
        request: Request<v1::RenderRequest>,
    ) -> Result<Response<v1::RenderReply>, Status> {
        let answer = async {
            let question = ImageQuestion::try_from(request.into_inner())?;
            self.service.render(question, Call::GrpcRender).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(image_reply_to_wire(reply)))
    }

    type RenderStreamStream = Answers<v1::RenderStreamReply>;

    async fn render_stream(
        &self,
        request: Request<Streaming<v1::RenderStreamRequest>>,
    ) -> Result<Response<Self::RenderStreamStream>, Status> {
        let ending = Ending::of(&request, self.closing.clone());
        Ok(Response::new(answer_stream(self.service.clone(), request.into_inner(), ending)))
    }
}

impl Edge {
    async fn find<Q>(&self, question: Q, call: Call) -> Result<Response<v1::QueryTextReply>, Status>
    where
        FindQuestion: TryFrom<Q, Error = error::Error>,
    {
        let answer = async { self.service.find(FindQuestion::try_from(question)?, call).await };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(find_reply_to_wire(reply)))
    }
}

#[tonic::async_trait]
impl Language for Edge {
    async fn query_text(
        &self,
        request: Request<v1::QueryTextRequest>,
    ) -> Result<Response<v1::QueryTextReply>, Status> {
        self.find(request.into_inner(), Call::GrpcQueryText).await
    }

    async fn query_embedding(
        &self,
        request: Request<v1::QueryEmbeddingRequest>,
    ) -> Result<Response<v1::QueryTextReply>, Status> {
        self.find(request.into_inner(), Call::GrpcQueryEmbedding).await
    }

    async fn classify(
        &self,
        request: Request<v1::ClassifyRequest>,
    ) -> Result<Response<v1::ClassifyReply>, Status> {
        let answer = async {
            let question = ClassifyQuestion::try_from(request.into_inner())?;
            self.service.classify(question, Call::GrpcClassify).await
        };
        let reply = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(classify_reply_to_wire(reply)))
    }

    async fn list_encoders(
        &self,
        request: Request<v1::ListEncodersRequest>,
    ) -> Result<Response<v1::ListEncodersReply>, Status> {
        let started = Instant::now();
        let map_id = request.into_inner().map_id;
        let encoders = self.service.encoders(&map_id).map_err(|e| status_from_error(&e))?;
        Ok(Response::new(encoders_to_wire(encoders, started.elapsed())))
    }
}

impl Edge {
    /// Reads an edit off the network threads, since a mesh may be large, and does it.
    async fn edit(
        &self,
        map_id: &str,
        read: impl FnOnce() -> error::Result<Edit> + Send + 'static,
    ) -> Result<Response<v1::EditReply>, Status> {
        let started = Instant::now();
        let answer = async {
            let edit = tokio::task::spawn_blocking(read)
                .await
                .map_err(|_| error::Error::Internal("reading an edit failed".into()))??;
            self.service.edit_map(map_id, edit).await
        };
        let edited = answer.await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(edited_to_wire(edited, started.elapsed())))
    }
}

#[tonic::async_trait]
impl Maps for Edge {
    async fn list_maps(
        &self,
        _request: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsReply>, Status> {
        let started = Instant::now();
        Ok(Response::new(map_list_to_wire(self.service.list_maps(), started.elapsed())))
    }

    async fn get_map(
        &self,
        request: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::GetMapReply>, Status> {
        let started = Instant::now();
        let detail = self
            .service
            .map_detail(&request.into_inner().map_id)
            .map_err(|e| status_from_error(&e))?;
        Ok(Response::new(map_detail_to_wire(detail, started.elapsed())))
    }

    async fn create_map(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::GetMapReply>, Status> {
        let started = Instant::now();
        let v1::CreateMapRequest { map_id, settings } = request.into_inner();
        // In order, so that of several mistakes the same is told each time.
        let settings = settings.into_iter().collect();
        let detail =
            self.service.create_map(&map_id, &settings).await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(map_detail_to_wire(detail, started.elapsed())))
    }

    async fn delete_map(
        &self,
        request: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapReply>, Status> {
        let started = Instant::now();
        let map_id = request.into_inner().map_id;
        self.service.delete_map(&map_id).await.map_err(|e| status_from_error(&e))?;
        Ok(Response::new(v1::DeleteMapReply { server_us: started.elapsed().as_micros() as u64 }))
    }

    async fn reset_map(
        &self,
        request: Request<v1::ResetMapRequest>,
    ) -> Result<Response<v1::ResetMapReply>, Status> {
        let started = Instant::now();
        let emptied = self
            .service
            .reset_map(&request.into_inner().map_id)
            .await
            .map_err(|e| status_from_error(&e))?;
        Ok(Response::new(map_reset_to_wire(emptied, started.elapsed())))
    }

    async fn clear_region(
        &self,
        request: Request<v1::ClearRegionRequest>,
    ) -> Result<Response<v1::EditReply>, Status> {
        let message = request.into_inner();
        let map_id = message.map_id.clone();
        self.edit(&map_id, move || Ok(Edit::Clear(message.try_into()?))).await
    }

    async fn stamp_geometry(
        &self,
        request: Request<v1::StampGeometryRequest>,
    ) -> Result<Response<v1::EditReply>, Status> {
        let message = request.into_inner();
        let map_id = message.map_id.clone();
        self.edit(&map_id, move || Ok(Edit::Stamp(message.try_into()?))).await
    }

    async fn get_map_stats(
        &self,
        request: Request<v1::GetMapStatsRequest>,
    ) -> Result<Response<v1::GetMapStatsReply>, Status> {
        let started = Instant::now();
        let report = self
            .service
            .map_stats(&request.into_inner().map_id)
            .map_err(|e| status_from_error(&e))?;
        Ok(Response::new(map_stats_to_wire(report, started.elapsed())))
    }
}
