//! What operators ask over gRPC.

use std::sync::Arc;
use std::time::Instant;

use tonic::{Request, Response, Status};

use crate::config::Settings;
use crate::telemetry::set_log_level;
use crate::wire::v1::admin_server::Admin;
use crate::wire::{status_from_error, v1};

/// `orenx.v1.Admin`.
#[derive(Clone)]
pub(super) struct Desk(pub(super) Arc<Settings>);

#[tonic::async_trait]
impl Admin for Desk {
    async fn set_log_level(
        &self,
        request: Request<v1::SetLogLevelRequest>,
    ) -> Result<Response<v1::SetLogLevelReply>, Status> {
        let started = Instant::now();
        let level = request.into_inner().level;
        let before = set_log_level(&level).map_err(|e| status_from_error(&e))?;
        let server_us = started.elapsed().as_micros() as u64;
        Ok(Response::new(v1::SetLogLevelReply { before, server_us }))
    }

    async fn get_config(
        &self,
        _request: Request<v1::GetConfigRequest>,
    ) -> Result<Response<v1::GetConfigReply>, Status> {
        let started = Instant::now();
        let toml = self.0.shown().map_err(|e| status_from_error(&e))?;
        let server_us = started.elapsed().as_micros() as u64;
        Ok(Response::new(v1::GetConfigReply { toml, server_us }))
    }
}
