//! Features as vision-language encoders give them (paper Fig. 4): in a cone around a mean that all
//! share, 35° to 80° wide; those of a class in a cone of their own, which overlaps most others.
//!
//! A feature is the mean, its class, and something times a nuisance: how the place looks, how this view
//! shows it, and noise. Texts point towards their classes a little, and mostly elsewhere, as those of
//! real encoders do. The numbers were chosen so that angles and overlap are about the paper's, and full
//! features far from perfect.

use std::ops::Range;

use glam::Vec3;

use crate::geometry::random::{normal, pcg4d, unit};

/// Lengths of the parts.
const MEAN: f32 = 0.8;
const CLASS: Range<f32> = 0.5..1.5;
/// What three classes in a row have in common.
const KIND: f32 = 0.4;
const NOISE: f32 = 0.5;
const PLACE: f32 = 0.45;
const VIEW: f32 = 0.4;
/// How much all of the nuisance counts, by patch.
const AMOUNT: Range<f32> = 0.2..1.4;
const NUISANCES: u32 = 300;
const NUISANCE: f32 = 0.25;
/// Nuisances of equal strength, before they get weaker.
const STRONG: f32 = 40.0;
/// Of texts: what all share, their own, and their class.
const TEXT: f32 = 1.0;
const TEXT_OWN: f32 = 1.5;
const TEXT_CLASS: f32 = 0.22;
const TEXT_KIND: f32 = 0.13;
/// Places that are closer together look alike.
const PLACE_M: f32 = 0.3;
/// What is seen of a view in one piece, pixels.
const PATCH: u32 = 32;

/// Keep streams of random numbers apart.
const DIRECTION: u32 = 0x6469_7265;
const AT_PLACE: u32 = 0x706c_6163;
const IN_VIEW: u32 = 0x7669_6577;
const AMOUNTS: u32 = 0x616d_6f75;
const GRAIN: u32 = 0x6772_6169;

/// Where features of classes point.
pub(super) struct Cone {
    dimension: usize,
    /// The mean included.
    classes: Vec<Vec<f32>>,
    texts: Vec<Vec<f32>>,
    nuisances: Vec<Vec<f32>>,
}

/// A pixel and what it shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    /// The number of the class.
    pub(super) class: u16,
    pub(super) point: Vec3,
    pub(super) view: u32,
    pub(super) pixel: [u32; 2],
}

impl Cone {
    pub(super) fn new(dimension: usize, classes: usize) -> Self {
        let mut next = 0;
        let mut direction = |norm: f32| {
            next += 1;
            let mut vector = normals([next, dimension as u32, DIRECTION], dimension);
            let scale = norm / length(&vector);
            vector.iter_mut().for_each(|x| *x *= scale);
            vector
        };
        let (mean, text) = (direction(MEAN), direction(TEXT));
        let kinds: Vec<Vec<f32>> = (0..classes.div_ceil(3)).map(|_| direction(1.0)).collect();
        let mut cone = Self { dimension, classes: vec![], texts: vec![], nuisances: vec![] };
        for class in 0..classes {
            let (own, kind) = (direction(1.0), &kinds[class / 3]);
            let strength = unit(pcg4d([class as u32, dimension as u32, AMOUNTS, 1])[0]);
            let strength = CLASS.start + (CLASS.end - CLASS.start) * strength;
            cone.classes.push(sum(&[(1.0, &mean), (strength, &own), (KIND, kind)]));
            let gap = direction(TEXT_OWN);
            let parts = [(1.0, &text), (1.0, &gap), (TEXT_CLASS, &own), (TEXT_KIND, kind)];
            cone.texts.push(sum(&parts));
        }
        let strength = |k: u32| NUISANCE / (1.0 + k as f32 / STRONG).sqrt();
        cone.nuisances = (0..NUISANCES).map(|k| direction(strength(k))).collect();
        cone
    }

    /// What a text encoder makes of the classes' names.
    pub(super) fn texts(&self) -> &[Vec<f32>] {
        &self.texts
    }

    /// What an image encoder makes of a pixel.
    pub(super) fn feature(&self, sight: &Sight) -> Vec<f32> {
        let [x, y, z] = (sight.point / PLACE_M).floor().as_ivec3().to_array().map(|c| c as u32);
        let place = normals([x, y, z ^ AT_PLACE], self.nuisances.len());
        let [u, v] = sight.pixel;
        let patch = (v / PATCH) << 16 | (u / PATCH);
        let view = normals([sight.view, patch, IN_VIEW], self.nuisances.len());
        let amount = unit(pcg4d([sight.view, patch, AMOUNTS, 0])[0]);
        let amount = AMOUNT.start + (AMOUNT.end - AMOUNT.start) * amount;
        let mut feature = normals([sight.view, v << 16 | u, GRAIN], self.dimension);
        let grain = amount * NOISE / (self.dimension as f32).sqrt();
        feature.iter_mut().for_each(|x| *x *= grain);
        add(&mut feature, 1.0, &self.classes[usize::from(sight.class)]);
        for ((nuisance, place), view) in self.nuisances.iter().zip(place).zip(view) {
            add(&mut feature, amount * (PLACE * place + VIEW * view), nuisance);
        }
        feature
    }
}

/// Standard normal numbers of a stream.
fn normals([a, b, c]: [u32; 3], count: usize) -> Vec<f32> {
    let pair = |i: u32| {
        let words = pcg4d([a, b, c, i]);
        [normal(words[0], words[1]), normal(words[2], words[3])]
    };
    (0..count.div_ceil(2) as u32).flat_map(pair).take(count).collect()
}

fn sum(parts: &[(f32, &Vec<f32>)]) -> Vec<f32> {
    let mut total = vec![0.0; parts.first().map_or(0, |part| part.1.len())];
    parts.iter().for_each(|(scale, part)| add(&mut total, *scale, part));
    total
}

fn add(to: &mut [f32], scale: f32, from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(to, x)| *to += scale * x);
}

/// The cosine of the angle between two vectors.
pub(super) fn cosine(a: &[f32], b: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    f64::from(dot(a, b) / (dot(a, a) * dot(b, b)).sqrt())
}

/// What the paper's Fig. 4 shows of features.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Angles between features and their mean that 5, 50 and 95 % stay below, rad.
    pub(super) angles_rad: [f64; 3],
    /// Pairs of classes whose median radii together exceed the angle between their centres.
    pub(super) overlapping: f64,
}

impl Shape {
    /// Of features and their classes.
    pub(super) fn of(features: &[Vec<f32>], classes: &[u16]) -> Self {
        let centre = |of: &dyn Fn(usize) -> bool| {
            let mut sum = vec![0.0; features.first().map_or(0, Vec::len)];
            for (_, feature) in features.iter().enumerate().filter(|(i, _)| of(*i)) {
                add(&mut sum, 1.0 / length(feature), feature);
            }
            sum
        };
        let angles = |to: &[f32], of: &dyn Fn(usize) -> bool| {
            let members = features.iter().enumerate().filter(|(i, _)| of(*i));
            let mut angles: Vec<f64> =
                members.map(|(_, feature)| cosine(feature, to).clamp(-1.0, 1.0).acos()).collect();
            angles.sort_unstable_by(f64::total_cmp);
            angles
        };
        let at = |angles: &[f64], share: f64| {
            let place = (share * angles.len() as f64) as usize;
            angles.get(place.min(angles.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
        };
        let all = angles(&centre(&|_| true), &|_| true);
        let mut present: Vec<u16> = classes.to_vec();
        present.sort_unstable();
        present.dedup();
        let cones: Vec<(Vec<f32>, f64)> = present
            .iter()
            .map(|class| {
                let own = |i: usize| classes[i] == *class;
                let centre = centre(&own);
                let radius = at(&angles(&centre, &own), 0.5);
                (centre, radius)
            })
            .collect();
        let (mut pairs, mut overlapping) = (0, 0);
        for (i, (a, radius_a)) in cones.iter().enumerate() {
            for (b, radius_b) in &cones[..i] {
                pairs += 1;
                let between = cosine(a, b).clamp(-1.0, 1.0).acos();
                overlapping += u32::from(radius_a + radius_b > between);
            }
        }
        Self {
            angles_rad: [0.05, 0.5, 0.95].map(|share| at(&all, share)),
            overlapping: f64::from(overlapping) / f64::from(pairs),
        }
    }
}

fn length(feature: &[f32]) -> f32 {
    feature.iter().map(|x| x * x).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_cones_that_overlap_around_a_mean() {
        let cone = Cone::new(512, 20);
        let sights = |i: u32| Sight {
            class: (i % 20) as u16,
            point: Vec3::new((i % 31) as f32, (i % 17) as f32, 0.5),
            view: i / 100,
            pixel: [(i * 37) % 640, (i * 91) % 480],
        };
        let sights: Vec<Sight> = (0..1500).map(sights).collect();
        let features: Vec<Vec<f32>> = sights.iter().map(|sight| cone.feature(sight)).collect();
        let classes: Vec<u16> = sights.iter().map(|sight| sight.class).collect();
        let Shape { angles_rad: [least, middle, most], overlapping } =
            Shape::of(&features, &classes);
        let degrees = [least, middle, most].map(f64::to_degrees);
        assert!(degrees[0] > 30.0 && degrees[2] < 80.0, "{degrees:?}");
        assert!((50.0..70.0).contains(&degrees[1]), "{degrees:?}");
        assert!((0.6..1.0).contains(&overlapping), "{overlapping}");
    }

    #[test]
    fn a_place_looks_alike_from_everywhere_and_a_view_alike_everywhere() {
        let cone = Cone::new(128, 3);
        let sight = Sight { class: 1, point: Vec3::ONE, view: 4, pixel: [8, 9] };
        let of = |change: &dyn Fn(&mut Sight)| {
            let mut other = sight;
            change(&mut other);
            cosine(&cone.feature(&sight), &cone.feature(&other))
        };
        assert!(of(&|_| ()) > 0.9999, "the same is the same");
        let same_patch = of(&|s| s.pixel = [9, 9]);
        let (view, both) = (of(&|s| s.view = 5), of(&|s| (s.view, s.point.x) = (5, 9.0)));
        assert!(same_patch > view && view > both, "{same_patch} {view} {both}");
        assert!(of(&|s| s.class = 2) < same_patch);
    }
}
