//! Cubes on a tile of pixels, in SIMD over the pixels of a row.

use super::super::patch::{Area, SIDE};
use super::super::{Job, RenderSettings, SamplePosition};
use super::cubes::{Cube, Cubes};
use crate::geometry::simd::{InstructionSet, Kernel, LINE, Lanes};
use crate::modality::density::{FAR, LEAST_LIGHT, REACH, middle, place_of};

/// Pixels of a tile. A row is one line of numbers.
const PIXELS: usize = (SIDE * SIDE) as usize;
const ROW: usize = SIDE as usize;
const _: () = assert!(ROW == LINE, "a row of a tile fills whole vectors");

/// Cubes that meet within this length of a ray touch.
pub(in crate::map::render) const TOUCH: f32 = 1e-4;
/// The least |direction| along an axis, so that its inverse is a number.
pub(in crate::map::render) const LEAST_DIRECTION: f32 = 1e-9;
/// A sample that takes less of the light is not looked up.
pub(in crate::map::render) const LEAST_WEIGHT: f32 = 5e-3;
/// Steps of the search for a zero crossing.
pub(in crate::map::render) const REFINEMENTS: usize = 2;

/// A part of a pixel's ray that takes light.
pub(super) struct Share {
    /// Within the tile, whose rows have [`SIDE`] pixels.
    pub pixel: u8,
    pub cube: u32,
    pub t: f32,
    pub weight: f32,
    /// More than half of the light is left before it, and less after.
    pub is_surface: bool,
}

/// What the rays of a tile met.
pub(super) struct Cast {
    /// Directions of the pixels' rays, with z = 1 in camera axes.
    pub directions: [Lane; 3],
    /// What is left of the light.
    pub light: Lane,
    /// Front to back for each pixel.
    pub shares: Vec<Share>,
}

/// A number for each pixel of a tile.
#[repr(C, align(64))]
pub(super) struct Lane(pub [f32; PIXELS]);

impl Lane {
    const fn of(x: f32) -> Self {
        Self([x; PIXELS])
    }
}

/// Casts the rays of a tile at its cubes.
pub(super) fn cast(
    set: InstructionSet,
    job: &Job<'_>,
    area: Area,
    cubes: &Cubes,
    list: &[u32],
) -> Cast {
    let mut tile = Tile {
        area,
        settings: job.settings,
        cubes,
        list,
        inverse: [Lane::of(1.0), Lane::of(1.0), Lane::of(1.0)],
        t: Lane::of(-1.0),
        f: Lane::of(0.0),
        front: Lane::of(0.0),
        cast: Cast {
            directions: [Lane::of(0.0), Lane::of(0.0), Lane::of(0.0)],
            // Pixels beyond the image's border have none.
            light: Lane::of(0.0),
            shares: Vec::with_capacity(2 * area.pixels()),
        },
    };
    for row in 0..area.height {
        for column in 0..area.width {
            let direction = job.rays.direction(area.left + column, area.top + row);
            let pixel = (row * SIDE + column) as usize;
            tile.cast.light.0[pixel] = 1.0;
            for axis in 0..3 {
                let d = direction[axis];
                tile.cast.directions[axis].0[pixel] = d;
                tile.inverse[axis].0[pixel] = 1.0 / d.abs().max(LEAST_DIRECTION).copysign(d);
            }
        }
    }
    set.run(&mut tile);
    tile.cast
}

/// A tile while it is drawn.
struct Tile<'a> {
    area: Area,
    settings: RenderSettings,
    cubes: &'a Cubes,
    list: &'a [u32],
    inverse: [Lane; 3],
    /// Where the ray left the last cube, and the distance there.
    t: Lane,
    f: Lane,
    /// 1 where the ray came out of free space into the last cube.
    front: Lane,
    cast: Cast,
}

impl Kernel for &mut Tile<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut lit = [true; ROW];
        for &id in self.list {
            let rect = self.cubes.cubes[id as usize].rect;
            let top = rect.top.saturating_sub(self.area.top);
            let bottom = (rect.bottom - self.area.top).min(self.area.height - 1);
            let left = rect.left.saturating_sub(self.area.left) as usize;
            let right = (rect.right - self.area.left) as usize;
            let rows = lit.iter_mut().enumerate().take(bottom as usize + 1).skip(top as usize);
            for (row, lit) in rows {
                if !*lit {
                    continue;
                }
                let mut darker = false;
                for column in (0..ROW).step_by(L::N) {
                    if column <= right && column + L::N > left {
                        darker |= self.pass::<L>(id, row * ROW + column);
                    }
                }
                if darker {
                    *lit = self.is_lit::<L>(row);
                }
            }
            if !lit[..self.area.height as usize].contains(&true) {
                break;
            }
        }
    }
}

impl Tile<'_> {
    #[inline(always)]
    fn is_lit<L: Lanes>(&self, row: usize) -> bool {
        let mut any = false;
        for column in (0..ROW).step_by(L::N) {
            let light = L::load(&self.cast.light.0, row * ROW + column);
            any |= (light - L::splat(LEAST_LIGHT)).any_positive();
        }
        any
    }

    /// Where the pixels from `at` on enter and leave a cube.
    #[inline(always)]
    fn span<L: Lanes>(&self, cube: &Cube, at: usize) -> (L, L) {
        let (mut t_in, mut t_out) = (L::splat(0.0), L::splat(f32::MAX));
        for axis in 0..3 {
            let inverse = L::load(&self.inverse[axis].0, at);
            let (a, b) = (L::splat(cube.low[axis]) * inverse, L::splat(cube.high[axis]) * inverse);
            t_in = t_in.max(a.min(b));
            t_out = t_out.min(a.max(b));
        }
        (t_in, t_out)
    }

    /// Takes the pixels from `at` on through a cube; whether any of them lost light.
    #[inline(always)]
    fn pass<L: Lanes>(&mut self, id: u32, at: usize) -> bool {
        let cube = &self.cubes.cubes[id as usize];
        let (t_in, t_out) = self.span::<L>(cube, at);
        let light = L::load(&self.cast.light.0, at);
        let meets = (t_out - t_in).min(light - L::splat(LEAST_LIGHT));
        if !meets.any_positive() {
            return false;
        }
        let field = Field::<L>::new(self.cubes, cube, &self.cast.directions, at);
        // What touches the last cube goes on with its distance: no light is lost between voxels.
        let (last, zero) = (L::load(&self.t.0, at), L::splat(0.0));
        let gap = t_in - last;
        let touches = L::splat(TOUCH) - gap.max(zero - gap);
        let mut f_in = L::load(&self.f.0, at);
        if meets.min(zero - touches).any_positive() {
            f_in = touches.choose(f_in, field.at(t_in));
        }
        let front = f_in.choose(L::splat(1.0), touches.choose(L::load(&self.front.0, at), zero));
        let t_mid = (t_in + t_out) * L::splat(0.5);
        let (f_mid, f_out) = (field.at(t_mid), field.at(t_out));
        meets.choose(t_out, last).store(&mut self.t.0, at);
        meets.choose(f_out, L::load(&self.f.0, at)).store(&mut self.f.0, at);
        meets.choose(front, L::load(&self.front.0, at)).store(&mut self.front.0, at);

        let s = self.settings.sharpness;
        let takes = meets.min(front).min(L::splat(FAR / s) - f_in.min(f_mid).min(f_out));
        if !takes.any_positive() {
            return false;
        }
        let (one, dim) = (L::splat(1.0), dimness(f_mid, s));
        let passed = dimness(f_in, s).divide(dim).min(one) * dim.divide(dimness(f_out, s)).min(one);
        let after = takes.choose(light * passed, light);
        after.store(&mut self.cast.light.0, at);
        let shows = (light - after - L::splat(LEAST_WEIGHT)).max(falls_to_half(light, after));
        if shows.any_positive() {
            let piece = Piece { t: [t_in, t_mid, t_out], f: [f_in, f_mid, f_out] };
            let (t, crosses) = piece.crossing(&field);
            self.record([t_in, t_out, f_in, f_out, t, crosses, light, after], id, at);
        }
        true
    }

    /// Notes which of the pixels from `at` on lost light in a cube, and where.
    #[inline(always)]
    fn record<L: Lanes>(&mut self, columns: [L; 8], id: u32, at: usize) {
        let mut numbers = [[0.0f32; LINE]; 8];
        for (numbers, column) in numbers.iter_mut().zip(columns) {
            column.store(numbers, 0);
        }
        let [t_in, t_out, f_in, f_out, t, crosses, light, after] = numbers;
        for i in 0..L::N {
            let weight = light[i] - after[i];
            let is_surface = light[i] > 0.5 && after[i] <= 0.5;
            if weight <= LEAST_WEIGHT && !is_surface {
                continue;
            }
            let settings = &self.settings;
            let t = if settings.sample == SamplePosition::Midpoint {
                0.5 * (t_in[i] + t_out[i])
            } else if crosses[i] > 0.0 {
                t[i]
            } else if is_surface {
                let share = place_of(0.5 / light[i], f_in[i], f_out[i], settings.sharpness);
                t_in[i] + (t_out[i] - t_in[i]) * share
            } else {
                t_in[i] + (t_out[i] - t_in[i]) * middle(f_in[i], f_out[i], settings.sharpness)
            };
            let pixel = (at + i) as u8;
            self.cast.shares.push(Share { pixel, cube: id, t, weight, is_surface });
        }
    }
}

/// 1 / Φ ([`crate::modality::density`]): light falls from one distance to another as 1 / Φ grows.
#[inline(always)]
fn dimness<L: Lanes>(f: L, sharpness: f32) -> L {
    let x = (f * L::splat(-sharpness)).min(L::splat(REACH)).max(L::splat(-REACH));
    x.exp() + L::splat(1.0)
}

/// > 0 where more than half of the light is left before, and not after.
#[inline(always)]
fn falls_to_half<L: Lanes>(before: L, after: L) -> L {
    let half = L::splat(0.5);
    (before - half).min(half - after + L::splat(f32::MIN_POSITIVE))
}

/// The distance in a cube along the rays of some pixels.
struct Field<'a, L> {
    shape: Shape<'a>,
    /// Across the host from 0 to 1: `start + slope * t`.
    slope: [L; 3],
    start: [L; 3],
}

/// What says the distance in a cube.
enum Shape<'a> {
    Cell(&'a [f32; 8]),
    Leaf(&'a [[f32; 4]; 8]),
}

impl<'a, L: Lanes> Field<'a, L> {
    #[inline(always)]
    fn new(cubes: &'a Cubes, cube: &'a Cube, directions: &[Lane; 3], at: usize) -> Self {
        let (low, size) = cubes.host(cube);
        let shape = match &cube.cell {
            Some(cell) => Shape::Cell(&cell.0),
            None => Shape::Leaf(&cubes.leaves[cube.leaf as usize].corners),
        };
        let scale = 1.0 / size;
        let start = low * -scale;
        let (x, y, z) = (&directions[0].0, &directions[1].0, &directions[2].0);
        let scale = L::splat(scale);
        Self {
            shape,
            slope: [L::load(x, at) * scale, L::load(y, at) * scale, L::load(z, at) * scale],
            start: [L::splat(start.x), L::splat(start.y), L::splat(start.z)],
        }
    }

    #[inline(always)]
    fn at(&self, t: L) -> L {
        let x = self.slope[0].mul_add(t, self.start[0]);
        let y = self.slope[1].mul_add(t, self.start[1]);
        let z = self.slope[2].mul_add(t, self.start[2]);
        match self.shape {
            Shape::Cell(cell) => in_cell(cell, x, y, z),
            Shape::Leaf(corners) => in_leaf(corners, x, y, z),
        }
    }
}

/// The distance that a cell of the relief says, with x, y, z from 0 to 1 across it.
#[inline(always)]
fn in_cell<L: Lanes>(c: &[f32; 8], x: L, y: L, z: L) -> L {
    let low = linear(c[2], c[3], x).mul_add(y, linear(c[0], c[1], x));
    let high = linear(c[6], c[7], x).mul_add(y, linear(c[4], c[5], x));
    high.mul_add(z, low)
}

/// `a + b x`.
#[inline(always)]
fn linear<L: Lanes>(a: f32, b: f32, x: L) -> L {
    L::splat(b).mul_add(x, L::splat(a))
}

/// The distance that a leaf says, with x, y, z from 0 to 1 across it.
#[inline(always)]
fn in_leaf<L: Lanes>(corners: &[[f32; 4]; 8], x: L, y: L, z: L) -> L {
    let mut along_z = [x; 2];
    for (k, along_z) in along_z.iter_mut().enumerate() {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| &corners[4 * k + i]);
        let low = mix(at_corner(a, x, y, z), at_corner(b, x, y, z), x);
        let high = mix(at_corner(c, x, y, z), at_corner(d, x, y, z), x);
        *along_z = mix(low, high, y);
    }
    mix(along_z[0], along_z[1], z)
}

/// What a corner of a leaf says of a place.
#[inline(always)]
fn at_corner<L: Lanes>([c, by_x, by_y, by_z]: &[f32; 4], x: L, y: L, z: L) -> L {
    let sum = linear(*c, *by_x, x);
    L::splat(*by_z).mul_add(z, L::splat(*by_y).mul_add(y, sum))
}

/// `low` at t = 0, `high` at t = 1.
#[inline(always)]
fn mix<L: Lanes>(low: L, high: L, t: L) -> L {
    t.mul_add(high - low, low)
}

/// > 0 where a distance `a` above zero is followed by one of zero or below.
#[inline(always)]
fn falls<L: Lanes>(a: L, b: L) -> L {
    a.min(L::splat(f32::MIN_POSITIVE) - b)
}

/// Places along rays within one cube, and the distances there.
struct Piece<L> {
    t: [L; 3],
    f: [L; 3],
}

impl<L: Lanes> Piece<L> {
    /// Where the distance falls through zero for the first time, and > 0 where it does: by false
    /// position with the weights of Illinois.
    #[inline(always)]
    fn crossing(&self, field: &Field<'_, L>) -> (L, L) {
        let (zero, half) = (L::splat(0.0), L::splat(0.5));
        let (first, second) = (falls(self.f[0], self.f[1]), falls(self.f[1], self.f[2]));
        let crosses = first.max(second);
        let (mut a, mut b) =
            (first.choose(self.t[0], self.t[1]), first.choose(self.t[1], self.t[2]));
        let (mut f_a, mut f_b) =
            (first.choose(self.f[0], self.f[1]), first.choose(self.f[1], self.f[2]));
        let mut t = mix(a, b, f_a.divide(f_a - f_b));
        if crosses.any_positive() {
            for _ in 0..REFINEMENTS {
                let f = field.at(t);
                (a, b) = (f.choose(t, a), f.choose(b, t));
                (f_a, f_b) = (f.choose(f, f_a * half), f.choose(f_b * half, f));
                // A distance of exactly zero at both ends has no slope to follow.
                let fall = (f_a - f_b).max(L::splat(f32::MIN_POSITIVE));
                t = mix(a, b, f_a.divide(fall).max(zero).min(L::splat(1.0)));
            }
        }
        (t, crosses)
    }
}
