//! What training keeps of a frame.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Mat3, Vec3};

use crate::frame::Frame;
use crate::geometry::MAX_COORDINATE_M;
use crate::octree::{cell_of, pack};

/// Edge length of the blocks that selection counts, m.
const BLOCK_M: f32 = 0.4;
/// Size of the cells of a [`Standpoint`]: of the origin, m, and of the optical axis, about 10°.
const STANDPOINT_M: f32 = 0.2;
const STANDPOINT_AXIS: f32 = 0.18;

/// Cells of a camera's origin and optical axis.
pub(super) type Standpoint = (IVec3, IVec3);

/// One sampled pixel.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Pixel {
    pub u: u16,
    pub v: u16,
    /// z-depth, m.
    pub z: f32,
}

/// What training keeps of a frame.
#[derive(Debug, Clone)]
pub struct KeyFrame {
    /// The robot that took it; `None` for one that is not told apart.
    pub robot: Option<u16>,
    /// Camera centre, world metres.
    pub origin: Vec3,
    pub world_from_camera: Mat3,
    /// 1/fx, 1/fy, cx, cy.
    pub camera: [f32; 4],
    /// Shared by all copies of the key frame: who keeps a copy elsewhere knows it by its place, and
    /// whether anybody still holds it.
    pub pixels: Arc<[Pixel]>,
    /// sRGB of each pixel, where colours are trained on; else empty.
    pub colors: Arc<[[u8; 3]]>,
    /// What the colours are multiplied by to be compared with the map's.
    pub gain: Vec3,
    /// Blocks that hold a pixel's end, sorted.
    pub(super) blocks: Vec<u64>,
    /// Level-0 voxels that hold a pixel's end, sorted; kept for the newest key frame alone.
    pub(super) voxels: Vec<u64>,
}

impl KeyFrame {
    /// Samples a frame of a robot on a regular grid of at most `max_pixels` pixels; with the gain of
    /// its colours if they are trained on.
    pub fn new(
        frame: &Frame,
        robot: Option<u16>,
        max_pixels: usize,
        r0_m: f32,
        gain: Option<Vec3>,
    ) -> Self {
        let k = &frame.intrinsics;
        let mut stride = 1usize;
        while (k.width as usize).div_ceil(stride) * (k.height as usize).div_ceil(stride)
            > max_pixels
        {
            stride += 1;
        }
        let mut key_frame = Self {
            robot,
            origin: frame.world_from_camera.position_f32(),
            world_from_camera: frame.world_from_camera.rotation_f32(),
            camera: [1.0 / k.fx as f32, 1.0 / k.fy as f32, k.cx as f32, k.cy as f32],
            pixels: Arc::default(),
            colors: Arc::default(),
            gain: gain.unwrap_or(Vec3::ONE),
            blocks: Vec::new(),
            voxels: Vec::new(),
        };
        let mut pixels = Vec::with_capacity(max_pixels);
        for v in (stride / 2..k.height as usize).step_by(stride) {
            for u in (stride / 2..k.width as usize).step_by(stride) {
                let z = frame.depth.at(u as u32, v as u32);
                if z > 0.0 {
                    pixels.push(Pixel { u: u as u16, v: v as u16, z });
                }
            }
        }
        if let Some(image) = frame.color.as_ref().filter(|_| gain.is_some()) {
            let color = |pixel: &Pixel| {
                let (u, v) = (u32::from(pixel.u), u32::from(pixel.v));
                (image.beside(u, v, k.width, k.height) * 255.0).round().to_array().map(|c| c as u8)
            };
            key_frame.colors = pixels.iter().map(color).collect();
        }
        key_frame.pixels = pixels.into();
        key_frame.blocks = key_frame.cells(BLOCK_M);
        key_frame.voxels = key_frame.cells(r0_m);
        key_frame
    }

    /// World direction of a pixel, with z = 1 in camera axes.
    #[inline]
    pub fn direction(&self, pixel: Pixel) -> Vec3 {
        let [ifx, ify, cx, cy] = self.camera;
        let (u, v) = (f32::from(pixel.u), f32::from(pixel.v));
        self.world_from_camera * Vec3::new((u - cx) * ifx, (v - cy) * ify, 1.0)
    }

    fn cells(&self, size_m: f32) -> Vec<u64> {
        let end = |&p: &Pixel| pack(cell_of(self.origin + self.direction(p) * p.z, 1.0 / size_m));
        let mut cells: Vec<u64> = self.pixels.iter().map(end).collect();
        cells.sort_unstable();
        cells.dedup();
        cells
    }

    /// Where it was taken from, coarsely: frames of one standpoint see about the same. Cells, and
    /// not distances to the last frame, so that a robot that creeps along leaves frames behind.
    pub(super) fn standpoint(&self) -> Standpoint {
        let at = (self.origin / STANDPOINT_M).floor().as_ivec3();
        let axis = (self.world_from_camera.z_axis / STANDPOINT_AXIS).round().as_ivec3();
        (at, axis)
    }

    /// |A ∩ B| / |A ∪ B| of the level-0 voxels of two frames.
    pub(super) fn overlap(&self, other: &Self) -> f32 {
        let (a, b) = (&self.voxels, &other.voxels);
        let (mut i, mut j, mut both) = (0, 0, 0usize);
        while i < a.len() && j < b.len() {
            match a[i].cmp(&b[j]) {
                std::cmp::Ordering::Less => i += 1,
                std::cmp::Ordering::Greater => j += 1,
                std::cmp::Ordering::Equal => {
                    both += 1;
                    i += 1;
                    j += 1;
                }
            }
        }
        both as f32 / (a.len() + b.len() - both).max(1) as f32
    }

    /// Whether its numbers are those of a camera and of what it saw.
    pub(super) fn is_finite(&self) -> bool {
        let reach = 2.0 * MAX_COORDINATE_M as f32;
        self.origin.abs().max_element() <= reach
            && self.origin.is_finite()
            && self.world_from_camera.is_finite()
            && self.camera.iter().all(|x| x.is_finite())
            && self.gain.is_finite()
            && self.pixels.iter().all(|pixel| (0.0..=reach).contains(&pixel.z))
    }

    pub(super) fn bytes(&self) -> usize {
        self.pixels.len() * size_of::<Pixel>()
            + self.colors.len() * 3
            + (self.blocks.len() + self.voxels.len()) * 8
    }
}
