//! What a view knows of language: text against codes, at points, over the whole map, and as things
//! that can be gone to. Codes and atoms are of one epoch.

mod boxes;
mod find;
mod scorer;
mod viewpoint;

use glam::Vec3;

use super::query::Fields;
use super::view::MapView;
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::octree::Lookup;

pub use boxes::OrientedBox;
pub use find::{FindSettings, Findings, Match, Places};
pub use scorer::Scorer;
pub use viewpoint::Viewpoint;

/// How much a map has learned of language.
#[derive(Debug, Clone, PartialEq)]
pub struct LanguageCounts {
    /// What features and texts must come from.
    pub contract: Contract,
    /// Atoms of the dictionary.
    pub atoms: usize,
    /// Vertices that were seen with features.
    pub vertices: usize,
    /// Bytes of their codes and of the atoms, as they are published.
    pub bytes: u64,
}

impl MapView {
    /// What features and texts must come from; `None` before the first frame with features.
    pub fn contract(&self) -> Option<&Contract> {
        self.store.codes.learned().map(|(contract, _)| contract)
    }

    /// What the map has learned of language; `None` before the first frame with features. Walks over
    /// all codes.
    pub fn language(&self) -> Option<LanguageCounts> {
        let (contract, dictionary) = self.store.codes.learned()?;
        Some(LanguageCounts {
            contract: contract.clone(),
            atoms: dictionary.len(),
            vertices: self.store.codes.vertices().count(),
            bytes: self.store.codes.bytes() + dictionary.bytes() as u64,
        })
    }

    /// Texts as this view's codes are asked for them: embeddings of the map's encoder, of any length
    /// but 0. Errors call them `prompts[i]` and `negatives[i]`.
    pub fn scorer(&self, prompts: &[Vec<f32>], negatives: &[Vec<f32>]) -> Result<Scorer> {
        let (_, dictionary) = self.store.codes.learned().ok_or_else(|| {
            Error::FailedPrecondition("no frame with features or labels has come yet".into())
        })?;
        Scorer::new(dictionary, prompts, negatives)
    }

    /// How well the best prompt fits each point (world metres): its relevancy within 0..=1 if there
    /// are negatives (paper eq:relevancy), else its cosine; NaN away from surfaces that were seen
    /// with features.
    pub fn text_scores(&self, points: &[Vec3], scorer: &Scorer) -> Vec<f32> {
        let fields = Fields { text_score: true, ..Fields::NONE };
        self.query_with(points, fields, Some(scorer)).text_score
    }

    /// The prompt of the largest cosine at each point and that cosine; -1 and NaN where there is no
    /// code.
    pub fn classify(&self, points: &[Vec3], classes: &Scorer) -> (Vec<i32>, Vec<f32>) {
        let (mut best, mut scores) = (vec![-1; points.len()], vec![f32::NAN; points.len()]);
        self.visit_codes(points, |i, code| {
            let cosines = classes.prompts(code).enumerate();
            if let Some((class, score)) = cosines.max_by(|a, b| a.1.total_cmp(&b.1)) {
                (best[i], scores[i]) = (class as i32, score);
            }
        });
        (best, scores)
    }

    /// The cosine of each prompt at each point, point by point; NaN where there is no code.
    pub fn class_scores(&self, points: &[Vec3], classes: &Scorer) -> Vec<f32> {
        let mut all = vec![f32::NAN; points.len() * classes.len()];
        self.visit_codes(points, |i, code| {
            let row = &mut all[i * classes.len()..(i + 1) * classes.len()];
            row.iter_mut().zip(classes.prompts(code)).for_each(|(to, score)| *to = score);
        });
        all
    }

    /// The decoded feature at each point, one after another; NaN where there is no code. Empty before
    /// the first frame with features.
    pub fn features(&self, points: &[Vec3]) -> Vec<f32> {
        let Some((contract, dictionary)) = self.store.codes.learned() else { return Vec::new() };
        let dimension = contract.dimension;
        let mut all = vec![f32::NAN; points.len() * dimension];
        self.visit_codes(points, |i, code| {
            all[i * dimension..(i + 1) * dimension].copy_from_slice(&dictionary.decode(code));
        });
        all
    }

    /// Atoms of the dictionary: the number of coefficients of a code.
    pub fn atoms(&self) -> usize {
        self.store.codes.learned().map_or(0, |(_, dictionary)| dictionary.len())
    }

    /// How far from a surface codes are what was seen of it, m: the diagonal of a cell. Farther away
    /// they are of something that is gone.
    pub(super) fn code_reach_m(&self) -> f32 {
        3f32.sqrt() * self.store.codes.scale().spacing_m()
    }

    /// Calls `visit` for each point that has a code, with that.
    fn visit_codes(&self, points: &[Vec3], mut visit: impl FnMut(usize, &[f32])) {
        let Some(lookup) = Lookup::new(&self.store) else { return };
        let distance = self.query(points, Fields::DISTANCE).distance;
        let (reach, mut code) = (self.code_reach_m(), vec![0.0; self.atoms()]);
        for (i, (point, distance)) in points.iter().zip(distance).enumerate() {
            if distance.abs() <= reach
                && let found = lookup.find(*point)
                && found.is_some()
                && self.store.code(found.node, *point, &mut code)
            {
                visit(i, &code);
            }
        }
    }
}
