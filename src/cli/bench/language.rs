//! `orenx bench language`: what compression costs (paper Table IX). Classes of the synthetic house, seen
//! through features whose cones overlap, told apart by codes and by full features.
//!
//! All ways to keep features map the same frames, and are judged at the same places: those that views
//! from between the frames show, one a cell of 5 cm.

mod cone;

use std::sync::Arc;

use clap::Args;
use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use tempfile::TempDir;

use self::cone::{Cone, Shape, Sight, cosine};
use super::figure::{Figure, Target, Unit};
use super::printer::Printer;
use crate::config::{CodeForm, DictionaryKind, LanguageConfig, MapConfig, MapSettings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::error::{Error, Result};
use crate::eval::{ClassScores, class_scores};
use crate::frame::{Contract, FeatureImage, Frame, NO_FEATURE};
use crate::map::{MapView, Mapper, query_pool};
use crate::modality::language::{Dictionary, DictionarySettings, UnitFeatures};
use crate::numpy::write_array;

/// How well classes are told apart by codes and by full features, by atoms, form of the codes and
/// origin of the dictionary, and what they take (a synthetic house)
#[derive(Debug, Args)]
pub(super) struct LanguageArgs {
    /// Numbers of a feature, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "N,M", default_values_t = [512, 1024], value_parser = clap::value_parser!(u32).range(256..=1024))]
    dimension: Vec<u32>,
    /// Frames of the walk through the house
    #[arg(long, value_name = "N", default_value_t = 138, value_parser = clap::value_parser!(u32).range(4..=10_000))]
    frames: u32,
    /// Views between frames whose places are judged
    #[arg(long, value_name = "N", default_value_t = 46, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Width of the images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 320, value_parser = clap::value_parser!(u32).range(32..=640))]
    width: u32,
}

/// What codes must save, without a loss of average precision.
const COMPRESSION: Target = Target::at_least(3.7);
const GAIN: Target = Target::at_least(0.0);
/// Pixels of a judged view: every fourth; and of each cell of this size one place.
const STEP: u32 = 4;
const CELL_M: f32 = 0.05;
/// Of the judged places, so many have their features decoded and compared.
const DECODED: usize = 4000;
/// Of the frames, those that the offline dictionary is made from.
const OFFLINE: u32 = 4;

/// A way to keep features.
struct Variant {
    name: String,
    mapper: Mapper,
    /// Whether it is what a map does unless told otherwise.
    is_usual: bool,
}

/// What became of it.
struct Row {
    name: String,
    is_usual: bool,
    atoms: usize,
    bytes: f64,
    scores: ClassScores,
    /// Of decoded features with what an encoder sees there.
    cosine: f64,
}

/// Frames, and the features that their pixels have.
struct Walk {
    data: Synthetic,
    cone: Cone,
    contract: Contract,
    /// Every n-th pixel leaves its feature in the map.
    stride: u32,
}

impl LanguageArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let pool = query_pool(0)?;
        for dimension in &self.dimension {
            let name = format!("{dimension} numbers, {} frames", self.frames);
            let (shape, rows) = self.measure(*dimension as usize, &pool)?;
            if !out.is_json() {
                table(out, &name, &shape, &rows)?;
            } else {
                out.figures(shape_figures(&name, &shape))?;
                for row in &rows {
                    out.figures(row.figures(&name, &rows))?;
                }
            }
            out.figures(verdict(&name, &rows))?;
        }
        Ok(())
    }

    fn measure(&self, dimension: usize, pool: &ThreadPool) -> Result<(Shape, Vec<Row>)> {
        let data = Synthetic::house(self.frames as usize).with_width(self.width);
        let cone = Cone::new(dimension, data.scene(0).classes().len());
        let contract = Contract { encoder_id: "cone".into(), dimension };
        let stride = config(&MapSettings::default())?.language.stride;
        let walk = Walk { data, cone, contract, stride };
        let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
        let mut variants = variants(&walk, &folder)?;
        for index in 0..self.frames {
            let frame = walk.frame(index)?;
            let take = |variant: &mut Variant| variant.mapper.integrate(&frame).map(drop);
            pool.install(|| variants.par_iter_mut().try_for_each(take))?;
        }
        let sights = self.judged()?;
        let features = |sights: &[Sight]| -> Vec<Vec<f32>> {
            pool.install(|| sights.par_iter().map(|sight| walk.cone.feature(sight)).collect())
        };
        let some: Vec<Sight> =
            sights.iter().step_by(sights.len().div_ceil(DECODED).max(1)).copied().collect();
        let seen = features(&some);
        let classes: Vec<u16> = some.iter().map(|sight| sight.class).collect();
        let shape = Shape::of(&seen, &classes);
        let rows = variants.into_iter().map(|mut variant| {
            let view = variant.mapper.publish();
            row(&variant, &view, &walk, &sights, (&some, &seen), pool)
        });
        Ok((shape, rows.collect::<Result<_>>()?))
    }

    /// Places that views from between the frames show.
    fn judged(&self) -> Result<Vec<Sight>> {
        let data = Synthetic::house(2 * self.frames as usize).with_width(self.width);
        let (mut cells, mut sights) = (FxHashSet::default(), Vec::new());
        for view in 0..self.views {
            let index = 2 * (view * self.frames / self.views) + 1;
            // Numbers of views go on after those of frames.
            let found = sights_of(&data, index as usize, self.frames + view, STEP)?;
            let is_new = |sight: &Sight| cells.insert((sight.point / CELL_M).floor().as_ivec3());
            sights.extend(found.1.into_iter().filter(is_new));
        }
        Ok(sights)
    }
}

/// A frame, and its pixels, every `step`-th, that are not at an edge.
fn sights_of(data: &Synthetic, index: usize, view: u32, step: u32) -> Result<(Frame, Vec<Sight>)> {
    let frame = data.load(index, false)?;
    let places = data.labels(index)?.map(|labels| labels.places()).unwrap_or_default();
    let k = frame.intrinsics;
    let mut sights = Vec::new();
    for v in (step / 2..k.height).step_by(step as usize) {
        for u in (step / 2..k.width).step_by(step as usize) {
            let z = frame.depth.at(u, v);
            let class = places.get((v * k.width + u) as usize).copied().unwrap_or(NO_FEATURE);
            if z > 0.0 && class != NO_FEATURE && !frame.depth.is_edge(u, v) {
                let point = frame.world_point(u, v, z);
                sights.push(Sight { class, point, view, pixel: [u, v] });
            }
        }
    }
    Ok((frame, sights))
}

impl Walk {
    /// A frame with a feature at each pixel that a map takes one from.
    fn frame(&self, index: u32) -> Result<Frame> {
        let (mut frame, sights) = sights_of(&self.data, index as usize, index, self.stride)?;
        let k = frame.intrinsics;
        let mut of_pixel = vec![NO_FEATURE; k.pixels()];
        for (feature, sight) in sights.iter().enumerate() {
            let [u, v] = sight.pixel;
            of_pixel[(v * k.width + u) as usize] = feature as u16;
        }
        frame.features = Some(FeatureImage {
            contract: self.contract.clone(),
            width: k.width,
            height: k.height,
            index: Some(of_pixel),
            features: sights.iter().flat_map(|sight| self.cone.feature(sight)).collect(),
        });
        Ok(frame)
    }

    /// The directions that hold most of what a part of the frames shows, found when all is known: the
    /// mean is not taken away.
    fn offline(&self) -> Result<Vec<f32>> {
        let settings = DictionarySettings {
            decay: 1.0 - f32::EPSILON,
            threshold: f32::MIN_POSITIVE,
            capacity: ATOMS,
            first_frames: 1,
        };
        let mut dictionary = Dictionary::new(self.contract.dimension, settings)?;
        for index in (0..self.data.len() as u32).step_by(OFFLINE as usize) {
            let (_, sights) = sights_of(&self.data, index as usize, index, self.stride)?;
            let features = sights.iter().flat_map(|sight| self.cone.feature(sight)).collect();
            dictionary.accumulate(&UnitFeatures::new(features, self.contract.dimension)?)?;
        }
        dictionary.grow();
        Ok(dictionary.state().atoms)
    }
}

/// Atoms of the largest dictionaries.
const ATOMS: usize = 256;

/// Distances and language, nothing trained.
fn config(settings: &MapSettings) -> Result<MapConfig> {
    let modalities = vec!["sdf".into(), "language".into()];
    MapConfig::from_settings(&MapSettings { modalities, steps: Some(0), ..settings.clone() })
}

/// The rows of the table. Small dictionaries come twice: with the usual threshold, by which what is seen
/// first takes all of their places, and with one that leaves some.
fn variants(walk: &Walk, folder: &TempDir) -> Result<Vec<Variant>> {
    let atoms = walk.offline()?;
    let (count, path) = (atoms.len() / walk.contract.dimension, folder.path().join("atoms.npy"));
    let mut file = std::fs::File::create(&path).map_err(|e| Error::io(&path, e))?;
    write_array(&mut file, &[count, walk.contract.dimension], &atoms)
        .map_err(|e| Error::io(&path, e))?;
    let usual = config(&MapSettings::default())?;
    let variant = |name: &str, change: &dyn Fn(&mut LanguageConfig)| -> Result<Variant> {
        let mut config = usual.clone();
        change(&mut config.language);
        let is_usual = config.language == usual.language;
        Ok(Variant { name: name.into(), mapper: Mapper::new(config)?, is_usual })
    };
    let online = |capacity, threshold| {
        move |language: &mut LanguageConfig| {
            (language.capacity, language.threshold) = (capacity, threshold);
            language.codes = CodeForm::F32;
        }
    };
    let largest = |terms| {
        move |language: &mut LanguageConfig| {
            (language.codes, language.terms) = (CodeForm::TopK, terms);
        }
    };
    let given = |dictionary: DictionaryKind| {
        move |language: &mut LanguageConfig| {
            (language.dictionary, language.codes) = (dictionary.clone(), CodeForm::F32);
        }
    };
    let threshold = usual.language.threshold;
    Ok(vec![
        variant("full features", &given(DictionaryKind::Full))?,
        variant("offline, 256 atoms", &given(DictionaryKind::Given(path)))?,
        variant("online, 64 atoms", &online(64, threshold))?,
        variant("online, 64 atoms of 0.8 %", &online(64, 0.008))?,
        variant("online, 128 atoms", &online(128, threshold))?,
        variant("online, 128 atoms of 0.4 %", &online(128, 0.004))?,
        variant("online, 256 atoms", &online(ATOMS as u32, threshold))?,
        variant("online, 256 atoms, halves", &|_| ())?,
        variant("online, 256 atoms, top-4", &largest(4))?,
        variant("online, 256 atoms, top-16", &largest(16))?,
        variant("online, 256 atoms, top-48", &largest(48))?,
    ])
}

fn row(
    variant: &Variant,
    view: &Arc<MapView>,
    walk: &Walk,
    sights: &[Sight],
    (some, seen): (&[Sight], &[Vec<f32>]),
    pool: &ThreadPool,
) -> Result<Row> {
    let counts = view.language().ok_or_else(|| Error::Internal("no feature was taken".into()))?;
    let texts = view.scorer(walk.cone.texts(), &[])?;
    let at = |sights: &[Sight]| sights.iter().map(|sight| sight.point).collect::<Vec<Vec3>>();
    let ask = |chunk: &[Sight]| view.class_scores(&at(chunk), &texts);
    let scores = pool.install(|| sights.par_chunks(1024).map(ask).collect::<Vec<_>>()).concat();
    let classes: Vec<u16> = sights.iter().map(|sight| sight.class).collect();
    let dimension = walk.contract.dimension;
    let decode = |(chunk, seen): (&[Sight], &[Vec<f32>])| -> Vec<f64> {
        let decoded = view.features(&at(chunk));
        let pairs = decoded.chunks_exact(dimension).zip(seen);
        pairs.map(|(decoded, seen)| cosine(decoded, seen)).filter(|c| c.is_finite()).collect()
    };
    let cosines = pool.install(|| {
        let chunks = some.par_chunks(256).zip(seen.par_chunks(256));
        chunks.map(decode).collect::<Vec<_>>().concat()
    });
    let square = (dimension * dimension * size_of::<f32>()) as f64;
    let bytes = counts.bytes as f64;
    // Full features need no dictionary; one that learns keeps half of a symmetric matrix.
    let bytes = match view.config().language.dictionary {
        DictionaryKind::Full => bytes - square,
        DictionaryKind::Online => bytes + square / 2.0,
        DictionaryKind::Given(_) => bytes,
    };
    Ok(Row {
        name: variant.name.clone(),
        is_usual: variant.is_usual,
        atoms: counts.atoms,
        bytes,
        scores: class_scores(&scores, &classes, texts.len()),
        cosine: cosines.iter().sum::<f64>() / cosines.len() as f64,
    })
}

/// How many times less a row takes than full features, which are the first.
fn compression(row: &Row, rows: &[Row]) -> f64 {
    rows.first().map_or(f64::NAN, |full| full.bytes / row.bytes)
}

/// What the usual settings save, and what becomes of average precision.
fn verdict(name: &str, rows: &[Row]) -> Vec<Figure> {
    let figures = rows.iter().filter(|row| row.is_usual).flat_map(|row| {
        let case = format!("{name}, {}: the usual settings", row.name);
        let gain = row.scores.map - rows.first().map_or(f64::NAN, |full| full.scores.map);
        let saved = Figure::new(&case, "compression", compression(row, rows), Unit::Times);
        let gain = Figure::new(&case, "map_gain", gain, Unit::Share);
        [saved.against(Some(COMPRESSION)), gain.against(Some(GAIN))]
    });
    figures.collect()
}

impl Row {
    fn figures(&self, name: &str, rows: &[Self]) -> Vec<Figure> {
        let case = format!("{name}, {}", self.name);
        let scores = &self.scores;
        [
            ("atoms", self.atoms as f64, Unit::Count),
            ("miou_3d", scores.miou, Unit::Share),
            ("macc_3d", scores.macc, Unit::Share),
            ("map_3d", scores.map, Unit::Share),
            ("cosine", self.cosine, Unit::Share),
            ("known", scores.known_share, Unit::Share),
            ("bytes", self.bytes, Unit::Bytes),
            ("compression", compression(self, rows), Unit::Times),
        ]
        .map(|(measure, value, unit)| Figure::new(&case, measure, value, unit))
        .into()
    }
}

fn shape_figures(name: &str, shape: &Shape) -> Vec<Figure> {
    let case = format!("{name}, features");
    let angles = ["angle_p5", "angle_median", "angle_p95"].into_iter().zip(shape.angles_rad);
    let mut figures: Vec<Figure> =
        angles.map(|(of, angle)| Figure::new(&case, of, angle, Unit::Radians)).collect();
    figures.push(Figure::new(&case, "overlapping_classes", shape.overlapping, Unit::Share));
    figures
}

fn table(out: &mut Printer, name: &str, shape: &Shape, rows: &[Row]) -> anyhow::Result<()> {
    let [least, middle, most] = shape.angles_rad.map(f64::to_degrees);
    out.line(&format!(
        "{name}: {least:.0}° to {most:.0}° (5 to 95 %, middle {middle:.0}°) from their mean; cones of \
         {:.0} % of the pairs of classes overlap",
        shape.overlapping * 100.0
    ))?;
    out.line(&format!(
        "{:<28}{:>6}{:>8}{:>8}{:>8}{:>8}{:>9}{:>9}",
        "", "atoms", "cosine", "mIoU", "mAcc", "mAP", "MB", "times"
    ))?;
    for row in rows {
        let scores = &row.scores;
        let [miou, macc, map] = [scores.miou, scores.macc, scores.map].map(|x| x * 100.0);
        out.line(&format!(
            "{:<28}{:>6}{:>8.3}{miou:>8.2}{macc:>8.2}{map:>8.2}{:>9.2}{:>9.2}",
            row.name,
            row.atoms,
            row.cosine,
            row.bytes * 1e-6,
            compression(row, rows)
        ))?;
    }
    Ok(())
}
