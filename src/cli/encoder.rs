//! The text encoder of commands that read words.

use clap::Args;

use crate::config::EncoderSettings;
use crate::encoder::TextEncoder;
use crate::error::Result;

/// `--encoder`.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct EncoderArgs {
    /// What embeds words: static:FOLDER, a table of tokens, or onnx:FOLDER, the text tower of a network
    #[arg(long, value_name = "KIND:FOLDER")]
    encoder: Option<EncoderSettings>,
}

impl EncoderArgs {
    /// What was asked for.
    pub(super) fn settings(&self) -> Option<&EncoderSettings> {
        self.encoder.as_ref()
    }

    /// The encoder, where one was asked for.
    pub(super) fn open(&self) -> Result<Option<TextEncoder>> {
        self.encoder.as_ref().map_or(Ok(None), TextEncoder::open)
    }
}
