//! Who answers questions in words: a map file with an encoder beside it, or a server.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;
use tokio::runtime::Runtime;

use super::credentials::CredentialArgs;
use super::encoder::EncoderArgs;
use super::open::{MapName, asking_runtime, is_url, open_view};
use crate::client::Questioner;
use crate::encoder::TextEncoder;
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::geometry::Aabb;
use crate::map::{
    CHUNK_POINTS, Camera, Channels, Encoding, Findings, MapView, Output, RenderSettings, Scorer,
    query_pool, render_with,
};
use crate::modality::language::NEGATIVES;
use crate::service::{ClassifyQuestion, FindQuestion, ImageKind, ImageQuestion, Sought};

/// A map and what embeds words for it.
pub(super) struct Answerer {
    source: Source,
    /// Always there beside a map file; a server has its own, if it is not given one.
    encoder: Option<TextEncoder>,
}

enum Source {
    View { view: Arc<MapView>, pool: ThreadPool },
    Server { client: Questioner, runtime: Runtime, map_id: String },
}

/// What a camera sees, and how well it fits.
pub(super) struct Heat {
    pub(super) color: Vec<Vec3>,
    /// NaN where nobody knows.
    pub(super) scores: Vec<f32>,
}

impl Answerer {
    /// Opens a map file, or connects to a server.
    pub(super) fn open(
        map: &str,
        name: &MapName,
        encoder: &EncoderArgs,
        credentials: &CredentialArgs,
    ) -> Result<Self> {
        let map_id = name.of(map)?;
        if is_url(map) {
            let encoder = encoder.open()?;
            let runtime = asking_runtime()?;
            let client = runtime.block_on(Questioner::connect_with(map, &credentials.read()?))?;
            return Ok(Self { source: Source::Server { client, runtime, map_id }, encoder });
        }
        let view = open_view(Path::new(map))?;
        let contract = view.contract().ok_or_else(|| {
            let problem = "has no language: it was made without features or labels (--encoder)";
            Error::invalid(map, problem)
        })?;
        let encoder = fitting(encoder, contract)?;
        let pool = query_pool(0)?;
        Ok(Self { source: Source::View { view, pool }, encoder: Some(encoder) })
    }

    /// Words as the map is asked for them: embedded here where there is an encoder.
    pub(super) fn sought(&self, words: Sought, field: &str) -> Result<Sought> {
        let (Some(encoder), Sought::Words { prompts, negatives }) = (&self.encoder, &words) else {
            return Ok(words);
        };
        let embed = |field: &str, texts: &[String]| {
            let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
            encoder.embed_field(field, &texts)
        };
        let usual = || NEGATIVES.map(str::to_owned).to_vec();
        Ok(Sought::Embeddings {
            encoder_id: encoder.contract().encoder_id.to_string(),
            prompts: embed(field, prompts)?,
            negatives: embed("negatives", &negatives.clone().unwrap_or_else(usual))?,
        })
    }

    /// The things that fit, best first.
    pub(super) fn find(&self, question: &FindQuestion) -> Result<Findings> {
        match &self.source {
            Source::View { view, .. } => {
                let settings = question.settings()?;
                let scorer = scorer(view, &question.sought)?;
                view.find(&scorer, &settings, &|| false).ok_or_else(not_asked_to_stop)
            }
            Source::Server { client, runtime, map_id } => {
                let question = FindQuestion { map_id: map_id.clone(), ..question.clone() };
                Ok(runtime.block_on(client.find(&question))?.findings)
            }
        }
    }

    /// The class of each point and its cosine.
    pub(super) fn classify(
        &self,
        points: &[Vec3],
        classes: &Sought,
    ) -> Result<(Vec<i32>, Vec<f32>)> {
        match &self.source {
            Source::View { view, pool } => {
                let scorer = scorer(view, classes)?;
                let piece = |points: &[Vec3]| view.classify(points, &scorer);
                let pieces: Vec<_> =
                    pool.install(|| points.par_chunks(CHUNK_POINTS).map(piece).collect());
                let (class, score): (Vec<_>, Vec<_>) = pieces.into_iter().unzip();
                Ok((class.concat(), score.concat()))
            }
            Source::Server { client, runtime, map_id } => {
                let question = ClassifyQuestion {
                    map_id: map_id.clone(),
                    ..ClassifyQuestion::new(points.to_vec(), classes.clone())
                };
                let reply = runtime.block_on(client.classify(&question))?;
                Ok((reply.class, reply.score))
            }
        }
    }

    /// What a camera sees, and how well it fits.
    pub(super) fn draw(&self, camera: &Camera, sought: &Sought) -> Result<Heat> {
        camera.check()?;
        match &self.source {
            Source::View { view, pool } => {
                let channels = Channels { color: true, heat: true, ..Channels::NONE };
                let settings = RenderSettings::default();
                let text = scorer(view, sought)?;
                let drawn =
                    render_with(view, camera, channels, &settings, Some(&text), pool, &|| false)
                        .ok_or_else(not_asked_to_stop)?;
                Ok(Heat { color: drawn.color, scores: drawn.heat })
            }
            Source::Server { client, runtime, map_id } => {
                let kind = |output| ImageKind { output, encoding: Encoding::F32 };
                let images = vec![kind(Output::Color), kind(Output::Heat)];
                let (map_id, text) = (map_id.clone(), Some(sought.clone()));
                let question =
                    ImageQuestion { map_id, text, ..ImageQuestion::new(*camera, images) };
                let reply = runtime.block_on(client.render(&question))?;
                let numbers = |at: usize| -> Vec<f32> {
                    let bytes = reply.images.get(at).map_or(&[][..], |(_, bytes)| bytes);
                    let (numbers, _) = bytes.as_chunks::<4>();
                    numbers.iter().map(|b| f32::from_le_bytes(*b)).collect()
                };
                let color = numbers(0).chunks_exact(3).map(Vec3::from_slice).collect();
                Ok(Heat { color, scores: numbers(1) })
            }
        }
    }

    /// The box around everything observed.
    pub(super) fn bounds(&self) -> Result<Aabb> {
        match &self.source {
            Source::View { view, .. } => Ok(view.bounds()),
            Source::Server { client, runtime, map_id } => runtime.block_on(client.bounds(map_id)),
        }
    }
}

/// The encoder that a map's features came from.
fn fitting(arguments: &EncoderArgs, contract: &Contract) -> Result<TextEncoder> {
    let id = &contract.encoder_id;
    let encoder = arguments.open()?.ok_or_else(|| {
        let problem = format!(
            "a map file holds no text encoder, and its features came from '{id}': say where that \
             is, as static:FOLDER or onnx:FOLDER"
        );
        Error::invalid("encoder", problem)
    })?;
    match contract.mismatch(encoder.contract()) {
        Some(problem) => Err(Error::invalid("encoder", problem)),
        None => Ok(encoder),
    }
}

fn scorer(view: &MapView, sought: &Sought) -> Result<Scorer> {
    match sought {
        Sought::Embeddings { prompts, negatives, .. } => view.scorer(prompts, negatives),
        Sought::Words { .. } => Err(Error::Internal("these words were not embedded".into())),
    }
}

fn not_asked_to_stop() -> Error {
    Error::Internal("nobody asked to stop".into())
}
