//! An image on the GPU: its buffers, its passes, and its way back.

use glam::{Mat3, Vec3};

use super::super::device::Gpu;
use super::super::layout::NONE;
use super::super::passes::{Clock, Passes};
use super::super::pool::Pool;
use super::scene::GpuScene;
use super::{GpuRenderer, TILE, layout};
use crate::error::{Error, Result};
use crate::geometry::Intrinsics;
use crate::octree::cell_of;

/// Most workgroups of a pass; they loop.
const GROUPS: u32 = 1 << 14;
/// Pairs of a cube and a tile that there is room for at first.
const LEAST_PAIRS: u64 = 1 << 16;

/// What an image is taken of.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Camera centre, world metres, and camera axes to world axes.
    pub eye: Vec3,
    pub rotation: Mat3,
    pub intrinsics: Intrinsics,
    /// s of the density, 1/m: that of the scene's list.
    pub sharpness: f32,
    /// Whether colours are taken halfway through a voxel.
    pub midpoint: bool,
    pub wanted: Wanted,
}

/// Which planes are wanted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wanted {
    pub color: bool,
    pub depth: bool,
    pub normal: bool,
    pub opacity: bool,
    pub unknown: bool,
}

/// An image's planes, row by row; empty where one was not wanted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Planes {
    pub color: Vec<Vec3>,
    /// z-depth, m; 0 where there is no surface.
    pub depth_m: Vec<f32>,
    pub normal: Vec<Vec3>,
    pub opacity: Vec<f32>,
    pub unknown: Vec<u8>,
}

/// Time of each pass by the GPU's own clock, ms; empty where it has none.
pub type Times = Vec<(&'static str, f32)>;

/// Buffers of the image in hand; they grow with the largest one so far.
#[derive(Debug)]
pub(super) struct Canvas {
    view: wgpu::Buffer,
    spans: Pool,
    counts: Pool,
    starts: Pool,
    entries: Pool,
    image: Pool,
    mask: Pool,
    /// What the host reads.
    results: Option<wgpu::Buffer>,
}

/// Where planes lie in an image, in numbers.
#[derive(Debug, Clone, Copy)]
struct Places {
    color: u32,
    normal: u32,
    depth: u32,
    opacity: u32,
    /// Numbers that are read back, and all of them.
    read: u64,
    all: u64,
}

impl Places {
    fn new(pixels: u64, wanted: Wanted) -> Self {
        let mut end = 0;
        let mut place = |is_wanted: bool, width: u64| {
            let at = if is_wanted { end as u32 } else { NONE };
            end += if is_wanted { width * pixels } else { 0 };
            at
        };
        let (color, normal) = (place(wanted.color, 3), place(wanted.normal, 3));
        let opacity = place(wanted.opacity, 1);
        let mut depth = place(wanted.depth, 1);
        let read = end;
        if wanted.unknown && !wanted.depth {
            // The mask asks for it.
            (depth, end) = (end as u32, end + pixels);
        }
        Self { color, normal, depth, opacity, read, all: end }
    }
}

impl Canvas {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let mut entries = Pool::new(gpu, "pairs of cubes and tiles", 8)?;
        entries.grow(gpu, LEAST_PAIRS)?;
        Ok(Self {
            view: gpu.buffer("view", size_of::<layout::View>() as u64)?,
            spans: Pool::new(gpu, "spans", 16)?,
            counts: Pool::new(gpu, "cubes by tile", 4)?,
            starts: Pool::new(gpu, "starts of tiles", 4)?,
            entries,
            image: Pool::new(gpu, "image", 4)?,
            mask: Pool::new(gpu, "mask", 4)?,
            results: None,
        })
    }

    fn reserve(&mut self, gpu: &Gpu, cubes: u32, grid: &Grid, places: &Places) -> Result<()> {
        let tiles = u64::from(grid.tiles());
        self.spans.grow_ahead(gpu, cubes.into())?;
        self.counts.grow_ahead(gpu, tiles)?;
        self.starts.grow_ahead(gpu, tiles + 1)?;
        self.image.grow(gpu, places.all)?;
        self.mask.grow(gpu, grid.mask_words().into())
    }

    /// A buffer of at least so many bytes that the host reads.
    fn results(&mut self, gpu: &Gpu, bytes: u64) -> Result<wgpu::Buffer> {
        if self.results.as_ref().is_none_or(|buffer| buffer.size() < bytes) {
            self.results = None;
            self.results = Some(gpu.read_buffer("an image's results", bytes)?);
        }
        self.results.clone().ok_or_else(|| Error::Internal("no buffer for results".into()))
    }

    fn buffers(&self) -> [(&'static str, wgpu::BindingResource<'_>); 7] {
        [
            ("view", self.view.as_entire_binding()),
            ("spans", self.spans.binding()),
            ("counts", self.counts.binding()),
            ("starts", self.starts.binding()),
            ("entries", self.entries.binding()),
            ("image", self.image.binding()),
            ("mask", self.mask.binding()),
        ]
    }
}

/// An image's tiles, and the blocks of its mask.
#[derive(Debug, Clone, Copy)]
struct Grid {
    columns: u32,
    rows: u32,
    blocks: [u32; 2],
}

impl Grid {
    fn new(k: &Intrinsics, block: u32) -> Self {
        let along = |side: u32| side.div_ceil(block);
        Self {
            columns: k.width.div_ceil(TILE),
            rows: k.height.div_ceil(TILE),
            blocks: [along(k.width), along(k.height)],
        }
    }

    fn tiles(&self) -> u32 {
        self.columns * self.rows
    }

    fn mask_words(&self) -> u32 {
        self.blocks[0] * self.blocks[1]
    }
}

impl GpuRenderer {
    /// Draws an image of a settled scene and brings it back.
    pub fn draw(&mut self, scene: &GpuScene, shot: &Shot) -> Result<(Planes, Times)> {
        let (grid, places) = self.prepare(scene, shot)?;
        loop {
            let mut passes = Passes::new(&self.gpu, self.clock.clone());
            self.record(&mut passes, scene, shot, &grid)?;
            let results = self.bring_back(passes, shot, &grid, &places)?;
            let room = self.canvas.entries.capacity();
            if results.pairs <= room {
                return Ok((results.planes, results.times));
            }
            // Some found no room: an image that lacks cubes is no image.
            self.canvas.entries.grow_ahead(&self.gpu, results.pairs)?;
            self.set_view(scene, shot, &grid, &places)?;
        }
    }

    /// Draws an image `times` times and leaves it where it is; waits until it is done.
    pub fn draw_only(&mut self, scene: &GpuScene, shot: &Shot, times: u32) -> Result<()> {
        let (grid, _) = self.prepare(scene, shot)?;
        for _ in 0..times {
            let mut passes = Passes::new(&self.gpu, None);
            self.record(&mut passes, scene, shot, &grid)?;
            self.gpu.queue.submit([passes.encoder.finish()]);
        }
        self.gpu.wait()
    }

    fn prepare(&mut self, scene: &GpuScene, shot: &Shot) -> Result<(Grid, Places)> {
        let k = &shot.intrinsics;
        let (grid, places) =
            (Grid::new(k, self.rules.block), Places::new(k.pixels() as u64, shot.wanted));
        let cubes = scene.list.map_or(0, |(_, cubes)| cubes);
        self.canvas.reserve(&self.gpu, cubes, &grid, &places)?;
        self.set_view(scene, shot, &grid, &places)?;
        Ok((grid, places))
    }

    fn set_view(&self, scene: &GpuScene, shot: &Shot, grid: &Grid, places: &Places) -> Result<()> {
        let (Some(extent), Some((_, cubes))) = (&scene.extent, scene.list) else {
            return Err(Error::Internal("a scene is drawn before it is settled".into()));
        };
        let k = &shot.intrinsics;
        let unit_m = extent.unit_m / (1u32 << extent.cube_lattice().0) as f32;
        let view = layout::View {
            eye: shot.eye.to_array(),
            sharpness: shot.sharpness,
            x_axis: shot.rotation.x_axis.to_array(),
            width: k.width,
            y_axis: shot.rotation.y_axis.to_array(),
            height: k.height,
            z_axis: shot.rotation.z_axis.to_array(),
            columns: grid.columns,
            camera: [k.fx, k.fy, k.cx, k.cy].map(|x| x as f32),
            eye_cell: cell_of(shot.eye, 1.0 / unit_m),
            tiles: grid.tiles(),
            cubes,
            room: self.canvas.entries.capacity() as u32,
            midpoint: shot.midpoint.into(),
            color_at: places.color,
            normal_at: places.normal,
            depth_at: places.depth,
            opacity_at: places.opacity,
            unit_m,
        };
        self.gpu.write(&self.canvas.view, &[view]);
        Ok(())
    }

    /// Records the passes of an image.
    fn record(
        &self,
        passes: &mut Passes,
        scene: &GpuScene,
        shot: &Shot,
        grid: &Grid,
    ) -> Result<()> {
        let cubes = scene.list.map_or(0, |(_, cubes)| cubes);
        let mut buffers = scene.buffers();
        buffers.extend(self.canvas.buffers());
        passes.encoder.clear_buffer(&self.canvas.counts.buffer, 0, None);
        let groups = |items: u32| items.div_ceil(64).min(GROUPS);
        let bind = |name| self.kernel(name)?.bind(&self.gpu, &buffers);
        bind("render/cull")?.dispatch(passes, groups(cubes));
        bind("render/scan")?.dispatch(passes, 1);
        bind("render/scatter")?.dispatch(passes, groups(cubes));
        bind("render/draw")?.dispatch_plane(passes, [grid.columns, grid.rows]);
        if shot.wanted.unknown {
            bind("render/unknown")?.dispatch(passes, groups(grid.mask_words()));
        }
        Ok(())
    }

    /// Submits an image and waits for it.
    fn bring_back(
        &mut self,
        mut passes: Passes,
        shot: &Shot,
        grid: &Grid,
        places: &Places,
    ) -> Result<Results> {
        let mask_words = if shot.wanted.unknown { u64::from(grid.mask_words()) } else { 0 };
        let times_at = (4 * (places.read + mask_words + 1)).next_multiple_of(256);
        let bytes = times_at + Clock::BYTES;
        let buffer = self.canvas.results(&self.gpu, bytes)?;
        let mut at = 0;
        let mut copy = |from: &Pool, first: u64, words: u64| {
            if words > 0 {
                let encoder = &mut passes.encoder;
                encoder.copy_buffer_to_buffer(
                    &from.buffer,
                    4 * first,
                    &buffer,
                    at,
                    Some(4 * words),
                );
                at += 4 * words;
            }
        };
        copy(&self.canvas.image, 0, places.read);
        copy(&self.canvas.mask, 0, mask_words);
        copy(&self.canvas.starts, grid.tiles().into(), 1);
        passes.resolve(&buffer, times_at);
        let Passes { encoder, names, .. } = passes;
        self.gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, ..bytes, |_| {});
        self.gpu.wait()?;
        let lost = |e: wgpu::MapRangeError| Error::DeviceLost(format!("{}: {e}", self.adapter()));
        let bytes = buffer.get_mapped_range(..bytes).map_err(lost)?;
        let (words, times) = bytes.split_at(times_at as usize);
        let words: &[u32] = bytemuck::cast_slice(words);
        let (image, rest) = words.split_at(places.read as usize);
        let (mask, rest) = rest.split_at(mask_words as usize);
        let planes = Planes::new(shot, grid, places, (image, mask), self.rules.block);
        let times = self.clock.as_ref().map_or_else(Vec::new, |c| c.read(&names, times));
        let pairs = rest.first().copied().unwrap_or(0).into();
        drop(bytes);
        buffer.unmap();
        Ok(Results { planes, pairs, times })
    }
}

#[cfg(test)]
impl GpuRenderer {
    /// What a device that is lost does.
    pub(crate) fn break_down(&self, why: &str) {
        self.gpu.break_down(why);
    }

    /// Most cubes of a tile of the last image.
    pub(crate) fn most_cubes_of_a_tile(&self) -> u32 {
        let starts = &self.canvas.starts;
        let starts = self.gpu.read::<u32>(&starts.buffer, starts.capacity() as usize);
        let starts = starts.expect("a device");
        starts.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).max().unwrap_or(0)
    }
}

/// What came back of an image.
struct Results {
    planes: Planes,
    /// Pairs of a cube and a tile that there were.
    pairs: u64,
    times: Times,
}

impl Planes {
    fn new(
        shot: &Shot,
        grid: &Grid,
        places: &Places,
        (image, mask): (&[u32], &[u32]),
        block: u32,
    ) -> Self {
        let pixels = shot.intrinsics.pixels();
        let scalars = |is_wanted: bool, at: u32| -> Vec<f32> {
            let range = at as usize..at as usize + pixels;
            if is_wanted { bytemuck::cast_slice(&image[range]).to_vec() } else { Vec::new() }
        };
        let vectors = |at: u32| -> Vec<Vec3> {
            if at == NONE {
                return Vec::new();
            }
            bytemuck::cast_slice(&image[at as usize..at as usize + 3 * pixels]).to_vec()
        };
        let (width, side) = (shot.intrinsics.width, block);
        let bit = |i: usize| {
            let (u, v) = (i as u32 % width, i as u32 / width);
            let word = mask[(v / side * grid.blocks[0] + u / side) as usize];
            (word >> (v % side * side + u % side) & 1) as u8
        };
        Self {
            color: vectors(places.color),
            depth_m: scalars(shot.wanted.depth, places.depth),
            normal: vectors(places.normal),
            opacity: scalars(shot.wanted.opacity, places.opacity),
            unknown: if shot.wanted.unknown { (0..pixels).map(bit).collect() } else { Vec::new() },
        }
    }
}
