//! `orenx serve`: the map server, until Ctrl-C or SIGTERM.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::heap;
use crate::config::{ServerConfig, Settings};
use crate::error::Result;
use crate::serve::{self, Listeners};
use crate::service::Service;
use crate::telemetry::{check_log, log_as};
use crate::threads::Urgency;

/// Serve a map: take frames, answer questions, save at the end
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Settings; what the file leaves out has its default (deploy/orenx.toml lists every key)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting, over the file and the environment (where it is ORENX_SECTION_KEY); may be
    /// repeated
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
    /// Serve over Zenoh too, and connect to this router, as in tcp/127.0.0.1:7447; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub zenoh_connect: Vec<String>,
    /// Serve over Zenoh too, with this configuration (JSON5)
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// What keys over Zenoh begin with
    #[arg(long, value_name = "PREFIX")]
    pub zenoh_prefix: Option<String>,
}

impl ServeArgs {
    pub fn run(self) -> anyhow::Result<()> {
        heap::bound();
        let settings = self.settings()?;
        let (config, map) = ServerConfig::from_settings(&settings)?;
        check_log(&config.written.log)?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .enable_all()
            .on_thread_start(|| Urgency::Prompt.declare())
            .build()?;
        runtime.block_on(async {
            log_as(&config.written.log)?;
            // The ports first: a second server must not wait for a map before it says so, and probes
            // are told that it is being loaded.
            let listeners = Listeners::bind(&config).await?;
            let start = config.clone();
            let started = tokio::task::spawn_blocking(move || Service::start(&start, map));
            let (service, mappers) = started.await.context("loading the map")??;
            let maps = service.list_maps();
            println!("orenx serves gRPC on grpc://{}", listeners.grpc_address()?);
            if let Some(address) = listeners.http_address() {
                println!("orenx serves HTTP on http://{address}");
            }
            if let Some(bus) = &config.bus {
                println!("orenx serves Zenoh below {}", bus.prefix);
            }
            for map in maps {
                match map.problem.as_str() {
                    "" => println!("map '{}', epoch {}", map.map_id, map.epoch),
                    problem => println!("map '{}' is not served: {problem}", map.map_id),
                }
            }
            let served = serve::run(listeners, service, interrupted()).await;
            // Joins the mappers: what went wrong there comes back from either.
            let saved = mappers.stop();
            served?;
            saved?;
            match &config.storage {
                Some(folder) => println!("saved in {}", folder.display()),
                None => println!("stopped; the map was in memory only"),
            }
            Ok(())
        })
    }
}

impl ServeArgs {
    /// The settings of all layers.
    pub(super) fn settings(&self) -> Result<Settings> {
        Settings::layered(self.config.as_deref(), std::env::vars_os(), &self.flags())
    }

    /// Every flag as a setting; those that have a name of their own go over `--set`.
    fn flags(&self) -> Vec<String> {
        let mut flags = self.set.clone();
        if !self.zenoh_connect.is_empty() {
            flags.push(format!("zenoh.connect={}", self.zenoh_connect.join(",")));
        }
        if let Some(file) = &self.zenoh_config {
            flags.push(format!("zenoh.config={}", file.display()));
        }
        if let Some(prefix) = &self.zenoh_prefix {
            flags.push(format!("zenoh.prefix={prefix}"));
        }
        flags
    }
}

/// Waits for Ctrl-C or SIGTERM. Where signals cannot be listened to, waits for ever: the process
/// then ends as the system ends it.
pub(super) async fn interrupted() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        if let Ok(mut terminate) = signal(SignalKind::terminate()) {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminate.recv() => {}
            }
            return;
        }
    }
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending::<()>().await;
    }
}
