//! Things in the whole map: connected vertices that fit a text.

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::boxes::OrientedBox;
use super::scorer::Scorer;
use super::viewpoint;
use crate::geometry::{Aabb, Pose};
use crate::map::query::Fields;
use crate::map::view::MapView;
use crate::octree::{LIMIT, pack};

/// A thing ends where the score has fallen by this share of what its best place has above most of the
/// map: about halfway to what stands beside it. How far scores spread depends on the encoder.
const DROP_SHARE: f32 = 0.4;
/// Fewer vertices are no thing: a point of a surface has eight around it.
const MIN_VERTICES: usize = 4;
/// Vertices that are scored between two looks at whether to stop.
const SCORED: usize = 2048;

/// Which things are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FindSettings {
    /// Vertices outside do not count, world metres.
    pub region: Option<Aabb>,
    /// Vertices of a smaller score do not count.
    pub min_score: f32,
    /// Things at most.
    pub top_k: usize,
    /// Whether the places themselves are wanted too.
    pub places: bool,
}

/// What fits a text in a whole map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Findings {
    /// Best first.
    pub matches: Vec<Match>,
    /// If they were wanted: every place that counts, whether it belongs to a match or not.
    pub places: Places,
}

/// Vertices of codes, and how well they fit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Places {
    /// World metres.
    pub points: Vec<Vec3>,
    /// One a point.
    pub scores: Vec<f32>,
}

/// A thing that fits a text.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// Its place in the answer, from 0.
    pub id: u32,
    /// The mean score of the better half of its vertices.
    pub score: f32,
    /// World metres.
    pub centroid: Vec3,
    pub obb: OrientedBox,
    /// The sides of the box along the world's axes, m.
    pub extent: Vec3,
    /// Its vertices.
    pub voxels: u32,
    /// The camera that showed it best, of those that the map remembers.
    pub best_view: Option<Pose>,
}

/// A vertex that fits.
struct Fit {
    lattice: [i32; 3],
    score: f32,
}

impl Fit {
    fn point(&self, spacing_m: f32) -> Vec3 {
        place(self.lattice, spacing_m)
    }
}

/// Where a vertex is, world metres.
fn place(lattice: [i32; 3], spacing_m: f32) -> Vec3 {
    Vec3::from(lattice.map(|c| c as f32)) * spacing_m
}

impl MapView {
    /// The vertices that score at least `min_score`, and the connected groups of them, best first;
    /// `None` if `interrupted`.
    pub fn find(
        &self,
        scorer: &Scorer,
        settings: &FindSettings,
        interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Option<Findings> {
        let spacing = self.store.codes.scale().spacing_m();
        let (fits, usual) = self.fitting(scorer, settings, interrupted)?;
        let mut things: Vec<(f32, Vec<u32>)> = grow(&fits, settings.min_score, usual)
            .into_iter()
            .filter(|thing| thing.len() >= MIN_VERTICES)
            .map(|thing| (score(&fits, &thing), thing))
            .collect();
        // Equally good ones in the order of their vertices, so that the answer is always the same.
        things.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        things.truncate(settings.top_k);
        let mut matches = Vec::with_capacity(things.len());
        for (id, (score, thing)) in things.into_iter().enumerate() {
            if interrupted() {
                return None;
            }
            let points: Vec<Vec3> =
                thing.iter().map(|i| fits[*i as usize].point(spacing)).collect();
            let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
            points.iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p)));
            matches.push(Match {
                id: id as u32,
                score,
                centroid: points.iter().sum::<Vec3>() / points.len() as f32,
                obb: OrientedBox::around(&points, spacing),
                extent: high - low + spacing,
                voxels: points.len() as u32,
                best_view: viewpoint::best(self, &points),
            });
        }
        let wanted = if settings.places { &fits[..] } else { &[] };
        let places = Places {
            points: wanted.iter().map(|fit| fit.point(spacing)).collect(),
            scores: wanted.iter().map(|fit| fit.score).collect(),
        };
        Some(Findings { matches, places })
    }

    /// The vertices that fit, near surfaces that are still there, and the median score of all.
    fn fitting(
        &self,
        scorer: &Scorer,
        settings: &FindSettings,
        interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Option<(Vec<Fit>, f32)> {
        let spacing = self.store.codes.scale().spacing_m();
        let mut code = vec![0.0; self.atoms()];
        let (mut fits, mut points, mut scores) = (Vec::new(), Vec::new(), Vec::new());
        for (i, vertex) in self.store.codes.vertices().enumerate() {
            if i % SCORED == 0 && interrupted() {
                return None;
            }
            let point = place(vertex.lattice, spacing);
            if settings.region.is_some_and(|region| !region.contains(point)) {
                continue;
            }
            vertex.read(&mut code);
            let score = scorer.score(&code);
            scores.push(score);
            if score >= settings.min_score {
                fits.push(Fit { lattice: vertex.lattice, score });
                points.push(point);
            }
        }
        let reach = self.code_reach_m();
        let distance = self.query(&points, Fields::DISTANCE).distance;
        // Behind a surface nobody knows how far it is.
        let mut near = distance.into_iter().map(|d| d.is_nan() || d.abs() <= reach);
        fits.retain(|_| near.next().unwrap_or(false));
        let middle = scores.len() / 2;
        let usual = match scores.is_empty() {
            true => settings.min_score,
            false => *scores.select_nth_unstable_by(middle, f32::total_cmp).1,
        };
        Some((fits, usual))
    }
}

/// Groups of connected vertices, each grown from its best one down to a share of what that has above
/// `usual`. Vertices that touch a group and fit less are its rim, a mixture with what stands beside it,
/// and belong to no group.
fn grow(fits: &[Fit], min_score: f32, usual: f32) -> Vec<Vec<u32>> {
    let at: FxHashMap<u64, u32> =
        fits.iter().enumerate().map(|(i, fit)| (pack(fit.lattice), i as u32)).collect();
    let score = |i: u32| fits[i as usize].score;
    let mut order: Vec<u32> = (0..fits.len() as u32).collect();
    order.sort_by(|a, b| score(*b).total_cmp(&score(*a)).then(a.cmp(b)));
    let mut taken = vec![false; fits.len()];
    let mut groups = Vec::new();
    for seed in order {
        if std::mem::replace(&mut taken[seed as usize], true) {
            continue;
        }
        let above = (score(seed) - usual).max(0.0);
        let least = min_score.max(score(seed) - DROP_SHARE * above);
        let mut group = vec![seed];
        let mut next = 0;
        while let Some(&i) = group.get(next) {
            next += 1;
            for cell in around(fits[i as usize].lattice) {
                if let Some(&n) = at.get(&pack(cell))
                    && !std::mem::replace(&mut taken[n as usize], true)
                    && score(n) >= least
                {
                    group.push(n);
                }
            }
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

/// The 26 neighbours of a vertex, as far as the lattice goes.
fn around(center: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    let neighbour =
        move |n: i32| std::array::from_fn(|axis| center[axis] + n / 3i32.pow(axis as u32) % 3 - 1);
    let inside = |cell: &[i32; 3]| cell.iter().all(|c| (-LIMIT..LIMIT).contains(c));
    (0..27).filter(|n| *n != 13).map(neighbour).filter(inside)
}

/// The mean score of the better half.
fn score(fits: &[Fit], group: &[u32]) -> f32 {
    let mut scores: Vec<f32> = group.iter().map(|i| fits[*i as usize].score).collect();
    scores.sort_by(|a, b| b.total_cmp(a));
    scores.truncate(group.len().div_ceil(2));
    scores.iter().sum::<f32>() / scores.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(scores: &[f32]) -> Vec<Fit> {
        let fit = |(x, score): (usize, &f32)| Fit { lattice: [x as i32, 0, 5], score: *score };
        scores.iter().enumerate().map(fit).filter(|fit| fit.score > 0.0).collect()
    }

    #[test]
    fn groups_end_where_scores_fall_and_rims_are_none() {
        let fits = line(&[0.9, 0.88, 0.85, 0.6, 0.8, 0.85, 0.0, 0.7, 0.7]);
        // From 0.9 down to 0.78, then from 0.85 down to 0.75; the valley at 3 touches the first.
        let groups = grow(&fits, 0.5, 0.6);
        assert_eq!(groups, [vec![0, 1, 2], vec![4, 5], vec![6, 7]]);
        let groups = grow(&fits, 0.5, 0.1);
        assert_eq!(groups, [vec![0, 1, 2, 3, 4, 5], vec![6, 7]]);
        assert_eq!(score(&fits, &[0, 1, 2]), (0.9 + 0.88) / 2.0);
        assert!(grow(&[], 0.5, 0.1).is_empty());
    }

    #[test]
    fn of_two_things_that_touch_both_are_found() {
        let fits = line(&[0.9, 0.9, 0.9, 0.9, 0.7, 0.7, 0.7, 0.7]);
        assert_eq!(grow(&fits, 0.5, 0.5), [vec![0, 1, 2, 3], vec![5, 6, 7]]);
        // However low they score, if the rest scores lower still.
        let low = line(&[0.18, 0.18, 0.08, 0.07, 0.01]);
        assert_eq!(grow(&low, 0.0, 0.01), [vec![0, 1], vec![3]]);
    }
}
