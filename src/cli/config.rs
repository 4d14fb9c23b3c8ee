//! `orenx config`: what a server would run on.

use clap::{Args, Subcommand};

use super::serve::ServeArgs;
use crate::config::{ServerConfig, Settings};
use crate::encoder::TextEncoder;
use crate::error::{Error, Result};
use crate::serve::check_files;
use crate::telemetry::check_log;

/// Look at settings without serving anything
#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// Say what `orenx serve` would run on with the same flags, and whether it could: whether the values
    /// are good and the files that they name can be read. Keys are not shown
    Check(ServeArgs),
}

impl ConfigArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let ConfigCommand::Check(flags) = self.command;
        let settings = flags.settings()?;
        check(&settings)?;
        print!("{}", settings.shown()?);
        Ok(())
    }
}

/// Everything that can be told before anything is opened or loaded for good.
fn check(settings: &Settings) -> Result<()> {
    let (config, _) = ServerConfig::from_settings(settings)?;
    check_log(&settings.log)?;
    check_files(&config)?;
    if let Some(file) = config.bus.as_ref().and_then(|bus| bus.file.as_ref()) {
        let unreadable = |e| Error::invalid("zenoh.config", format!("{}: {e}", file.display()));
        std::fs::read(file).map_err(unreadable)?;
    }
    TextEncoder::open(&config.encoder).map(drop).map_err(|error| match error {
        Error::InvalidArgument { .. } => error,
        other => Error::invalid("encoder.folder", other.to_string()),
    })
}
