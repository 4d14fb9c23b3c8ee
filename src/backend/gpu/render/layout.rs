//! What host and shaders of images share, in the host's words; a test holds it against the shaders.

use bytemuck::{Pod, Zeroable};

/// A map as it is drawn; `Scene` in shaders/lib/scene.wgsl says what it holds.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Scene {
    pub(super) nodes: u32,
    pub(super) rows: u32,
    pub(super) room: u32,
    pub(super) surface_log2: u32,
    pub(super) light_m: f32,
    pub(super) cell_m: f32,
    pub(super) band_scale: f32,
    pub(super) band_log2: u32,
    pub(super) inputs: u32,
    pub(super) first: u32,
    pub(super) second: u32,
    pub(super) scale: f32,
    pub(super) cube_room: u32,
    pub(super) fine_log2: u32,
    pub(super) largest_log2: u32,
    pub(super) cell_log2: u32,
    pub(super) harmonics: u32,
}

/// A node as its pool holds it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Node {
    pub(super) low: [i32; 3],
    pub(super) size: u32,
    pub(super) brick: u32,
    pub(super) block: u32,
    pub(super) padding: [u32; 2],
}

/// A cube as kernels list it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Cube {
    pub(super) low: [i32; 3],
    pub(super) log2_size: u32,
    pub(super) host_low: [i32; 3],
    pub(super) host_log2: u32,
    pub(super) block: u32,
    pub(super) leaf: u32,
    pub(super) padding: [u32; 2],
}

/// A camera and its image; `View` in shaders/lib/view.wgsl says what it holds.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct View {
    pub(super) eye: [f32; 3],
    pub(super) sharpness: f32,
    pub(super) x_axis: [f32; 3],
    pub(super) width: u32,
    pub(super) y_axis: [f32; 3],
    pub(super) height: u32,
    pub(super) z_axis: [f32; 3],
    pub(super) columns: u32,
    pub(super) camera: [f32; 4],
    pub(super) eye_cell: [i32; 3],
    pub(super) tiles: u32,
    pub(super) cubes: u32,
    pub(super) room: u32,
    pub(super) midpoint: u32,
    pub(super) color_at: u32,
    pub(super) normal_at: u32,
    pub(super) depth_at: u32,
    pub(super) opacity_at: u32,
    pub(super) unit_m: f32,
}
