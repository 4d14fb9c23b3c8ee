//! The quality path: every pixel's ray, voxel by voxel, through the field as queries answer it.
//!
//! The rays of a patch advance side by side, one piece of a voxel a round, so that their points are
//! decoded together.

use glam::Vec3;

use super::near::Near;
use super::patch::{Area, Paint, Patch, Spot};
use super::relief::Told;
use super::unknown::Outlook;
use super::{Job, RenderSettings, SamplePosition};
use crate::map::view::Store;
use crate::modality::density::{FAR, LEAST_LIGHT, middle, passes, place_of};
use crate::modality::interpolation::Place;
use crate::modality::read::{Sample, evaluate_samples};
use crate::octree::{NO_BLOCK, Segment, Traversal};

/// A voxel is passed in pieces of at most this share of its edge: the field bends within a voxel.
const PIECE: f32 = 0.5;
/// A sample that takes less of the light is not looked up.
const LEAST_WEIGHT: f32 = 1e-3;
/// Steps of the search for a zero crossing.
const REFINEMENTS: usize = 3;

/// A ray on its way.
struct Walk<'a> {
    direction: Vec3,
    voxels: Traversal<'a, Store>,
    /// The voxel in hand.
    segment: Segment,
    /// The next piece begins here, ...
    t: f32,
    /// ... with this distance, m, which is not a number where nobody has asked yet.
    f: f32,
    /// Pieces that are left of the voxel in hand.
    pieces: u32,
    /// It came from free space.
    in_front: bool,
    /// The share of the light that is left.
    light: f32,
    outlook: Outlook,
    is_done: bool,
}

/// A part of a ray that takes light.
struct Share {
    pixel: u16,
    weight: f32,
    /// More than half of the light is left before it, and less after.
    is_surface: bool,
    segment: Segment,
    /// Where it lies within these bounds, and the distances there.
    t: f32,
    bounds: [(f32, f32); 2],
}

/// Draws one patch.
pub(super) fn draw(job: &Job<'_>, area: Area) -> Patch {
    let store = &job.view.store;
    let mut patch = Patch::new(area.pixels(), job.channels);
    let mut walks: Vec<Walk<'_>> = (0..area.pixels())
        .map(|pixel| {
            let (u, v) = area.place(pixel);
            Walk::new(store, job.rays.eye, job.rays.direction(u, v))
        })
        .collect();
    let mut shares = Vec::new();
    let mut round = Round::new(job);
    while round.advance(&mut walks, &mut shares) {}
    if job.settings.sample == SamplePosition::ZeroCrossing {
        round.refine(&walks, &mut shares);
    }
    round.fill(&walks, &shares, &mut patch);
    patch
}

impl<'a> Walk<'a> {
    fn new(store: &'a Store, eye: Vec3, direction: Vec3) -> Self {
        Self {
            direction,
            voxels: Traversal::new(store, eye, direction, 0.0..f32::INFINITY),
            segment: Segment { node: 0, log2_size: 0, low: [0; 3], t_in: 0.0, t_out: 0.0 },
            t: 0.0,
            f: f32::NAN,
            pieces: 0,
            in_front: false,
            light: 1.0,
            outlook: Outlook::default(),
            is_done: false,
        }
    }
}

/// What the rounds of a patch work with.
struct Round<'a> {
    job: &'a Job<'a>,
    store: &'a Store,
    near: Near<'a>,
    /// What is asked in a round, and the answers.
    samples: Vec<Sample>,
    distances: Vec<f32>,
    /// What the relief has told of each.
    told: Vec<Told>,
}

impl<'a> Round<'a> {
    fn new(job: &'a Job<'a>) -> Self {
        let near = Near::new(job.view, job.settings.sharpness);
        Self {
            job,
            store: near.store,
            near,
            samples: Vec::new(),
            distances: Vec::new(),
            told: Vec::new(),
        }
    }

    /// Takes every ray one piece further; false if none had any left.
    fn advance(&mut self, walks: &mut [Walk<'a>], shares: &mut Vec<Share>) -> bool {
        self.samples.clear();
        self.told.clear();
        for walk in walks.iter_mut().filter(|walk| !walk.is_done) {
            if walk.pieces == 0 && !self.next_voxel(walk) {
                walk.is_done = true;
                continue;
            }
            if walk.f.is_nan() {
                self.ask(walk.direction, &walk.segment, walk.t);
            }
            self.ask(walk.direction, &walk.segment, walk.piece_end());
        }
        self.answer();
        let mut answers = self.distances.iter().copied();
        let mut next = || answers.next().unwrap_or(f32::NAN);
        let sharpness = self.job.settings.sharpness;
        for (pixel, walk) in walks.iter_mut().enumerate().filter(|(_, walk)| !walk.is_done) {
            if walk.f.is_nan() {
                walk.f = next();
                // The field jumped: a surface that lies between two voxels is met at once.
                if walk.in_front {
                    walk.f = walk.f.max(FAR / sharpness);
                }
            }
            shares.extend(walk.step(pixel as u16, next(), &self.job.settings));
        }
        !self.samples.is_empty()
    }

    /// Takes a ray to the next voxel that may take light.
    fn next_voxel(&self, walk: &mut Walk<'a>) -> bool {
        let eye = self.job.rays.eye;
        let mut skipped = None;
        for segment in walk.voxels.by_ref() {
            if self.job.channels.unknown && walk.light > 0.5 {
                let speed = walk.direction.length();
                walk.outlook.go((segment.t_in - walk.t.max(0.0)) * speed, false);
                walk.outlook.pass(self.store, &segment, eye, walk.direction);
            }
            if self.near.takes_light(segment.node, segment.log2_size) {
                if segment.t_in != walk.segment.t_out || walk.f.is_nan() {
                    walk.f = f32::NAN;
                    walk.in_front = skipped.is_some_and(|last: Segment| {
                        last.t_out == segment.t_in && self.near.is_free(last.node)
                    });
                }
                let size = self.size_m(&segment);
                let length = (segment.t_out - segment.t_in) * walk.direction.length();
                let has_relief = self.store.node(segment.node).block != NO_BLOCK;
                let size = if has_relief { size.min(self.store.band.spacing_m()) } else { size };
                walk.pieces = (length / (PIECE * size)).ceil().max(1.0) as u32;
                (walk.segment, walk.t) = (segment, segment.t_in);
                return true;
            }
            (walk.t, walk.f, skipped) = (segment.t_out, f32::NAN, Some(segment));
        }
        false
    }

    fn size_m(&self, segment: &Segment) -> f32 {
        self.near.size_m(segment.log2_size)
    }

    fn low_m(&self, segment: &Segment) -> Vec3 {
        Vec3::from(segment.low.map(|c| c as f32)) * self.store.unit_m
    }

    fn sample(&self, direction: Vec3, segment: &Segment, t: f32) -> Sample {
        let offset_m = (self.job.rays.eye + direction * t - self.low_m(segment)).to_array();
        Sample { node: segment.node, place: Place { offset_m, size_m: self.size_m(segment) } }
    }

    fn told(&self, direction: Vec3, segment: &Segment, t: f32) -> Told {
        let voxel = (segment.node, self.low_m(segment), self.size_m(segment));
        Told::at(self.store, voxel, self.job.rays.eye + direction * t).unwrap_or_default()
    }

    fn ask(&mut self, direction: Vec3, segment: &Segment, t: f32) {
        self.samples.push(self.sample(direction, segment, t));
        self.told.push(self.told(direction, segment, t));
    }

    fn answer(&mut self) {
        self.distances.resize(self.samples.len(), 0.0);
        let decoders = &self.job.view.decoders;
        evaluate_samples(self.store, decoders, &self.samples, &mut self.distances, &mut []);
        for (distance, told) in self.distances.iter_mut().zip(&self.told) {
            *distance = told.distance(*distance);
        }
    }

    /// Finds zero crossings in the field itself, by false position with the weights of Illinois.
    fn refine(&mut self, walks: &[Walk<'_>], shares: &mut [Share]) {
        let crosses = |share: &&mut Share| share.bounds[0].1 > 0.0 && share.bounds[1].1 <= 0.0;
        for _ in 0..REFINEMENTS {
            self.samples.clear();
            self.told.clear();
            for share in shares.iter_mut().filter(crosses) {
                self.ask(walks[usize::from(share.pixel)].direction, &share.segment, share.t);
            }
            self.answer();
            for (share, &f) in shares.iter_mut().filter(crosses).zip(&self.distances) {
                let side = usize::from(f <= 0.0);
                share.bounds[side] = (share.t, f);
                share.bounds[1 - side].1 *= 0.5;
                let [(a, f_a), (b, f_b)] = share.bounds;
                share.t = a + (b - a) * (f_a / (f_a - f_b)).clamp(0.0, 1.0);
            }
        }
    }

    /// Writes what the rays found.
    fn fill(&mut self, walks: &[Walk<'_>], shares: &[Share], patch: &mut Patch) {
        for (opacity, walk) in patch.opacity.iter_mut().zip(walks) {
            *opacity = 1.0 - walk.light;
        }
        let surfaces = || shares.iter().filter(|share| share.is_surface);
        for share in surfaces() {
            let pixel = usize::from(share.pixel);
            if let Some(depth) = patch.depth_m.get_mut(pixel) {
                *depth = share.t;
            }
            if let Some(unknown) = patch.unknown.get_mut(pixel) {
                *unknown = u8::from(walks[pixel].outlook.left);
            }
        }
        if !patch.color.is_empty() {
            let mut paints = vec![Paint::default(); walks.len()];
            for share in shares {
                let pixel = usize::from(share.pixel);
                let spot = Spot {
                    direction: walks[pixel].direction,
                    t: share.t,
                    node: share.segment.node,
                    low_m: self.low_m(&share.segment),
                    size_m: self.size_m(&share.segment),
                };
                paints[pixel].add(self.store, self.job.rays.eye, &spot, share.weight);
            }
            for ((color, paint), walk) in patch.color.iter_mut().zip(paints).zip(walks) {
                *color = paint.color(1.0 - walk.light);
            }
        }
        if patch.normal.is_empty() {
            return;
        }
        self.samples.clear();
        self.told.clear();
        for share in surfaces() {
            self.ask(walks[usize::from(share.pixel)].direction, &share.segment, share.t);
        }
        let n = self.samples.len();
        let (mut distances, mut gradients) = (vec![0.0; n], vec![Vec3::ZERO; n]);
        let decoders = &self.job.view.decoders;
        evaluate_samples(self.store, decoders, &self.samples, &mut distances, &mut gradients);
        let found = self.told.iter().zip(distances).zip(gradients);
        for (share, ((told, distance), gradient)) in surfaces().zip(found) {
            let gradient = told.gradient(distance, gradient);
            let pixel = usize::from(share.pixel);
            let normal = gradient.normalize_or_zero();
            let towards = normal.dot(walks[pixel].direction) <= 0.0;
            patch.normal[pixel] = if towards { normal } else { -normal };
        }
    }
}

impl Walk<'_> {
    fn piece_end(&self) -> f32 {
        if self.pieces == 1 {
            return self.segment.t_out;
        }
        self.t + (self.segment.t_out - self.t) / self.pieces as f32
    }

    /// Passes a piece at whose end the distance is `f`; what it takes.
    fn step(&mut self, pixel: u16, f: f32, settings: &RenderSettings) -> Option<Share> {
        let bounds = [(self.t, self.f), (self.piece_end(), f)];
        (self.t, self.f) = bounds[1];
        self.pieces -= 1;
        self.in_front |= bounds[0].1 > 0.0;
        if !self.in_front {
            return None;
        }
        let before = self.light;
        self.light *= passes(bounds[0].1, f, settings.sharpness);
        self.is_done = self.light < LEAST_LIGHT;
        let weight = before - self.light;
        let is_surface = before > 0.5 && self.light <= 0.5;
        let [(a, f_a), (b, f_b)] = bounds;
        let t = match settings.sample {
            // At the surface, not in the mist before it.
            SamplePosition::ZeroCrossing if is_surface => {
                a + (b - a) * place_of(0.5 / before, f_a, f_b, settings.sharpness)
            }
            SamplePosition::ZeroCrossing => a + (b - a) * middle(f_a, f_b, settings.sharpness),
            SamplePosition::Midpoint => 0.5 * (self.segment.t_in + self.segment.t_out),
        };
        let segment = self.segment;
        (is_surface || weight > LEAST_WEIGHT).then_some(Share {
            pixel,
            weight,
            is_surface,
            segment,
            t,
            bounds,
        })
    }
}
