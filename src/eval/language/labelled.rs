//! Places whose class is known: points of the true surface, and pixels of unseen views.

use std::path::{Path, PathBuf};

use glam::Vec3;
use rayon::ThreadPool;
use rustc_hash::FxHashSet;

use crate::dataset::{self, Dataset, Format};
use crate::error::{Error, Result};
use crate::frame::LabelImage;
use crate::map::{Camera, Channels, MapView, RenderSettings, render};

/// Views of a folder that points of surfaces are taken from, at most, and their pixels: every second.
const VIEWS: usize = 64;
const SURFACE_STEP: usize = 2;
/// Of each cell of this size the first point counts, so that surfaces count by their area and not by
/// how often they were looked at.
const CELL_M: f32 = 0.025;
/// Points at most; of more, every n-th.
const POINTS: usize = 200_000;
/// Pixels of unseen views: every fourth.
const IMAGE_STEP: usize = 4;

/// Places and their classes, by number (see [`Names`]).
#[derive(Debug, Default)]
pub(super) struct Labelled {
    /// World metres.
    pub(super) points: Vec<Vec3>,
    /// Of each point, and then those of pixels at which the map shows nothing.
    pub(super) classes: Vec<u16>,
}

/// The names of the classes that occur, numbered in the order in which they were met. Folders may
/// number them differently.
#[derive(Debug, Default)]
pub(super) struct Names(Vec<String>);

impl Names {
    pub(super) fn all(&self) -> Vec<&str> {
        self.0.iter().map(String::as_str).collect()
    }

    fn number(&mut self, name: &str) -> u16 {
        let place = self.0.iter().position(|known| known == name).unwrap_or_else(|| {
            self.0.push(name.to_owned());
            self.0.len() - 1
        });
        place as u16
    }

    /// For each pixel the number of its class, if it has one.
    fn of(&mut self, labels: &LabelImage) -> Vec<Option<u16>> {
        let mut numbers = vec![None; labels.classes.len()];
        let number = |place: u16| {
            let class = labels.classes.get(usize::from(place))?;
            Some(*numbers[usize::from(place)].get_or_insert_with(|| self.number(&class.name)))
        };
        labels.places().into_iter().map(number).collect()
    }
}

/// Points of the true surface that labelled views of the folders see.
pub(super) fn surface(folders: &[PathBuf], names: &mut Names) -> Result<Labelled> {
    let (mut seen, mut found) = (FxHashSet::default(), Labelled::default());
    for folder in folders {
        let data = dataset::open(folder, Format::SevenScenes)?;
        for index in (0..data.len()).step_by(data.len().div_ceil(VIEWS)) {
            let Some(labels) = data.labels(index)? else { continue };
            let (classes, frame) = (names.of(&labels), data.load(index, false)?);
            for (u, v) in pixels(data.as_ref(), SURFACE_STEP) {
                let z = frame.depth.at(u, v);
                let class = classes[(v * labels.width + u) as usize];
                // At an edge the labels of a segmenter and depth seldom agree.
                let (Some(class), false) = (class, z <= 0.0 || frame.depth.is_edge(u, v)) else {
                    continue;
                };
                let point = frame.world_point(u, v, z);
                if seen.insert((point / CELL_M).floor().as_ivec3()) {
                    found.points.push(point);
                    found.classes.push(class);
                }
            }
        }
    }
    let step = found.points.len().div_ceil(POINTS).max(1);
    Ok(Labelled {
        points: found.points.into_iter().step_by(step).collect(),
        classes: found.classes.into_iter().step_by(step).collect(),
    })
}

/// The places that the map shows at labelled pixels of unseen views: where its surface is drawn, not
/// where the true one is.
pub(super) fn images(
    view: &MapView,
    novel: &Path,
    settings: &RenderSettings,
    pool: &ThreadPool,
    names: &mut Names,
) -> Result<Labelled> {
    let data = dataset::open(novel, Format::SevenScenes)?;
    let (mut found, mut hidden) = (Labelled::default(), Vec::new());
    for index in 0..data.len() {
        let Some(labels) = data.labels(index)? else { continue };
        let (classes, truth) = (names.of(&labels), data.load(index, false)?);
        let camera =
            Camera { world_from_camera: truth.world_from_camera, intrinsics: truth.intrinsics };
        camera.check()?;
        let channels = Channels { depth: true, ..Channels::NONE };
        let drawn = render(view, &camera, channels, settings, pool, &|| false)
            .ok_or_else(|| Error::Internal("a rendering was left, though nobody asked".into()))?;
        for (u, v) in pixels(data.as_ref(), IMAGE_STEP) {
            let pixel = (v * labels.width + u) as usize;
            match (classes[pixel], drawn.depth_m[pixel]) {
                (None, _) => {}
                (Some(class), z) if z > 0.0 => {
                    found.points.push(truth.world_point(u, v, z));
                    found.classes.push(class);
                }
                (Some(class), _) => hidden.push(class),
            }
        }
    }
    found.classes.extend(hidden);
    Ok(found)
}

/// Every n-th pixel in u and v.
fn pixels(data: &dyn Dataset, step: usize) -> impl Iterator<Item = (u32, u32)> + use<> {
    let k = data.intrinsics();
    let along = move |side: u32| (step as u32 / 2..side).step_by(step);
    along(k.height).flat_map(move |v| along(k.width).map(move |u| (u, v)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Class;

    #[test]
    fn classes_are_told_by_name() {
        let labels = |ids: &[u16], classes: &[(u16, &str)]| LabelImage {
            width: ids.len() as u32,
            height: 1,
            ids: ids.to_vec(),
            classes: classes
                .iter()
                .map(|(id, name)| Class { id: *id, name: (*name).into() })
                .collect(),
        };
        let mut names = Names::default();
        let first = names.of(&labels(&[7, 0, 2, 9], &[(2, "chair"), (5, "cup"), (7, "table")]));
        assert_eq!(first, [Some(0), None, Some(1), None]);
        let second = names.of(&labels(&[1, 2], &[(1, "bed"), (2, "table")]));
        assert_eq!(second, [Some(2), Some(0)]);
        assert_eq!(names.all(), ["table", "chair", "bed"], "a class that nothing has is no class");
    }
}
