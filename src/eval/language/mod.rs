//! What a map with language takes things for, beside what they are: at surfaces, and in unseen views.

mod labelled;
mod metrics;

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use self::labelled::{Labelled, Names};
use super::report::LanguageScores;
use super::truth::Truth;
use crate::encoder::TextEncoder;
use crate::error::{Error, Result};
use crate::map::{MapView, RenderSettings, Scorer};

pub use metrics::{ClassScores, class_scores};

/// Points that one thread asks at a time.
const CHUNK: usize = 2048;

/// Judges by the labels of a truth folder. `None` for a map that knows no language, or a folder without
/// labels.
pub fn language_scores(
    view: &MapView,
    truth: &Truth,
    encoder: &TextEncoder,
    settings: &RenderSettings,
    pool: &ThreadPool,
) -> Result<Option<LanguageScores>> {
    let Some(counts) = view.language().filter(|_| !truth.labelled.is_empty()) else {
        return Ok(None);
    };
    if let Some(problem) = counts.contract.mismatch(encoder.contract()) {
        return Err(Error::invalid("encoder", problem));
    }
    let mut names = Names::default();
    let surface = labelled::surface(&truth.labelled, &mut names)?;
    let novel = truth.novel.iter().filter(|novel| truth.labelled.contains(novel));
    let images: Vec<Labelled> = novel
        .map(|novel| labelled::images(view, novel, settings, pool, &mut names))
        .collect::<Result<_>>()?;
    if surface.classes.is_empty() {
        return Err(Error::invalid("truth", "labels.json names classes, but no pixel has one"));
    }
    let texts = encoder.embed_field("classes", &names.all())?;
    let texts = view.scorer(&texts, &[])?;
    let judge = |places: &Labelled| {
        let scores = scores(view, &texts, &places.points, pool);
        class_scores(&scores, &places.classes, texts.len())
    };
    let surface = judge(&surface);
    let images = images.first().map_or(ClassScores::NONE, judge);
    Ok(Some(LanguageScores {
        miou_3d: surface.miou,
        macc_3d: surface.macc,
        map_3d: surface.map,
        known_share_3d: surface.known_share,
        miou_2d: images.miou,
        macc_2d: images.macc,
        map_2d: images.map,
        known_share_2d: images.known_share,
        cosine: surface.cosine,
        classes: surface.classes,
        atoms: counts.atoms,
        bytes: counts.bytes,
    }))
}

/// The cosine of each text at each point, point by point, asked in chunks on `pool`.
fn scores(view: &MapView, texts: &Scorer, points: &[Vec3], pool: &ThreadPool) -> Vec<f32> {
    let ask = |chunk: &[Vec3]| view.class_scores(chunk, texts);
    pool.install(|| points.par_chunks(CHUNK).map(ask).collect::<Vec<_>>()).concat()
}
