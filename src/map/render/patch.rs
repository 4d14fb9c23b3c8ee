//! An image in square patches, each drawn by one thread.

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::{Channels, Job, Rendering};
use crate::map::view::Store;
use crate::octree::Lookup;

/// Side of a patch, pixels.
pub(super) const SIDE: u32 = 16;

/// How far from a voxel's border a colour is read, in edges of the voxel.
pub(super) const RIM: f32 = 1e-4;
/// How far around its place a pixel looks for a colour, m.
pub(super) const BESIDE_M: f32 = 0.1;
/// A sample that takes less of the light does not look beside itself for a colour.
pub(super) const BESIDE_WEIGHT: f32 = 0.2;

/// A patch's place in the image, pixels; smaller than [`SIDE`] at the right and the lower border.
#[derive(Debug, Clone, Copy)]
pub(super) struct Area {
    pub left: u32,
    pub top: u32,
    pub width: u32,
    pub height: u32,
}

impl Area {
    pub(super) fn pixels(&self) -> usize {
        (self.width * self.height) as usize
    }

    /// Column and row in the image of a pixel of the patch.
    pub(super) fn place(&self, pixel: usize) -> (u32, u32) {
        (self.left + pixel as u32 % self.width, self.top + pixel as u32 / self.width)
    }
}

/// What a patch shows: columns as those of [`Rendering`], row by row.
pub(super) struct Patch {
    pub color: Vec<Vec3>,
    pub depth_m: Vec<f32>,
    pub normal: Vec<Vec3>,
    pub opacity: Vec<f32>,
    pub unknown: Vec<u8>,
}

impl Patch {
    /// Nothing was hit.
    pub(super) fn new(pixels: usize, channels: Channels) -> Self {
        let wanted = |on: bool| if on { pixels } else { 0 };
        Self {
            color: vec![Vec3::ZERO; wanted(channels.color)],
            depth_m: vec![0.0; wanted(channels.depth)],
            normal: vec![Vec3::ZERO; wanted(channels.normal)],
            opacity: vec![0.0; wanted(channels.opacity)],
            unknown: vec![1; wanted(channels.unknown)],
        }
    }
}

/// A place on a ray, in a voxel.
pub(super) struct Spot {
    pub direction: Vec3,
    pub t: f32,
    pub node: u32,
    /// Low corner and edge length of the voxel, m.
    pub low_m: Vec3,
    pub size_m: f32,
}

/// What colours a pixel's ray met.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Paint {
    sum: Vec3,
    weight: f32,
}

impl Paint {
    /// Adds the colour at a place of a ray from `eye`, if there is one.
    pub(super) fn add(&mut self, store: &Store, eye: Vec3, spot: &Spot, weight: f32) {
        // A point on the voxel's border is its own, whatever rounding says: blocks of colour are
        // found by voxel.
        let rim = Vec3::splat(RIM * spot.size_m);
        let at = eye + spot.direction * spot.t;
        let inside = at.clamp(spot.low_m + rim, spot.low_m + spot.size_m - rim);
        let color = store.color_along(spot.node, inside, spot.direction);
        self.take(store, (at, spot.direction), color, weight);
    }

    /// Takes the colour at a place of a ray with this direction; where there is none, one beside it.
    pub(super) fn take(
        &mut self,
        store: &Store,
        (at, direction): (Vec3, Vec3),
        color: Option<Vec3>,
        weight: f32,
    ) {
        // A search is worth it only where it would show.
        let search = || if weight > BESIDE_WEIGHT { beside(store, at, direction) } else { None };
        if let Some(color) = color.or_else(search) {
            self.sum += color * weight;
            self.weight += weight;
        }
    }

    /// The colour of a pixel, if its ray lost more than half of its light.
    pub(super) fn color(self, opacity: f32) -> Vec3 {
        if opacity > 0.5 && self.weight > 0.0 { self.sum / self.weight } else { Vec3::ZERO }
    }
}

/// The nearest colour along a ray, or along an axis: the surface of the map is not quite where frames
/// saw it, and some of it none saw.
#[cold]
fn beside(store: &Store, at: Vec3, direction: Vec3) -> Option<Vec3> {
    let spacing = store.band.spacing_m();
    let steps = (BESIDE_M / spacing).ceil() as i32;
    let lookup = Lookup::new(store)?;
    let ways = [direction.normalize_or_zero(), Vec3::X, Vec3::Y, Vec3::Z];
    let places =
        (1..=steps).flat_map(|n| ways.into_iter().flat_map(move |way| [(n, way), (-n, way)]));
    places.map(|(n, way)| at + way * (spacing * n as f32)).find_map(|point| {
        let voxel = lookup.find(point);
        if voxel.is_some() { store.color_along(voxel.node, point, direction) } else { None }
    })
}

/// Draws all patches on `pool` and puts them together; `None` if interrupted.
pub(super) fn assemble(
    job: &Job<'_>,
    pool: &ThreadPool,
    interrupted: &(dyn Fn() -> bool + Sync),
    draw: &(dyn Fn(Area) -> Patch + Sync),
) -> Option<Rendering> {
    let (width, height) = (job.rays.intrinsics.width, job.rays.intrinsics.height);
    let mut areas = Vec::new();
    for top in (0..height).step_by(SIDE as usize) {
        for left in (0..width).step_by(SIDE as usize) {
            let (width, height) = (SIDE.min(width - left), SIDE.min(height - top));
            areas.push(Area { left, top, width, height });
        }
    }
    let draw = |area: &Area| (!interrupted()).then(|| draw(*area));
    let patches: Option<Vec<Patch>> =
        pool.install(|| areas.par_iter().with_min_len(4).map(draw).collect());
    let patches = patches?;
    let pixels = job.rays.intrinsics.pixels();
    let place = |area: &Area, row: u32| {
        let from = (row * area.width) as usize;
        let to = (area.top + row) as usize * width as usize + area.left as usize;
        (from, to)
    };
    Some(Rendering {
        width,
        height,
        color: paste(pixels, &areas, &patches, |p| &p.color, place),
        depth_m: paste(pixels, &areas, &patches, |p| &p.depth_m, place),
        normal: paste(pixels, &areas, &patches, |p| &p.normal, place),
        opacity: paste(pixels, &areas, &patches, |p| &p.opacity, place),
        unknown: paste(pixels, &areas, &patches, |p| &p.unknown, place),
        heat: Vec::new(),
    })
}

/// One column of the image.
fn paste<T: Copy + Default>(
    pixels: usize,
    areas: &[Area],
    patches: &[Patch],
    column: impl Fn(&Patch) -> &[T],
    place: impl Fn(&Area, u32) -> (usize, usize),
) -> Vec<T> {
    if patches.first().is_none_or(|patch| column(patch).is_empty()) {
        return Vec::new();
    }
    let mut image = vec![T::default(); pixels];
    for (area, patch) in areas.iter().zip(patches) {
        for row in 0..area.height {
            let (from, to) = place(area, row);
            let width = area.width as usize;
            image[to..to + width].copy_from_slice(&column(patch)[from..from + width]);
        }
    }
    image
}
