//! Images of a view, drawn on the CPU by any reader: colour, depth, normals, opacity, and where the
//! map does not know.
//!
//! Light is taken by voxels near a surface, of level 0 and below: what a coarse voxel says near zero
//! is interpolation. Surfaces are seen from their front: a ray that begins behind one takes no notice
//! of it until it has come out, so that a camera outside of a room, or in a wall, looks into the
//! room.

mod camera;
mod gpu;
mod heat;
mod near;
mod patch;
mod ray;
mod relief;
#[cfg(test)]
mod tests;
mod tile;
mod unknown;

use glam::Vec3;
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

use self::camera::Rays;
use super::language::Scorer;
use super::view::MapView;
use crate::config::Renderer;
use crate::error::{Error, Result};

pub use camera::{Camera, MAX_SIDE};
pub use gpu::{Painted, Painter, Subject};

/// Where in a voxel a ray takes its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SamplePosition {
    /// Where the signed distance is zero; where it only comes near, at the middle of the light that
    /// is taken there.
    ZeroCrossing,
    /// Halfway through the voxel, for comparison.
    Midpoint,
}

/// How images are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderSettings {
    pub renderer: Renderer,
    pub sample: SamplePosition,
    /// s of the density, 1/m: surfaces are soft over a few 1/s.
    pub sharpness: f32,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self::USUAL
    }
}

impl RenderSettings {
    /// What images are drawn with where nothing is said.
    pub const USUAL: Self =
        Self { renderer: Renderer::Tile, sample: SamplePosition::ZeroCrossing, sharpness: 200.0 };

    /// Fails on a sharpness that is no surface's.
    pub fn check(&self) -> Result<()> {
        if !(20.0..=2000.0).contains(&self.sharpness) {
            let problem = format!("{} must be within 20..=2000 1/m", self.sharpness);
            return Err(Error::invalid("sharpness", problem));
        }
        Ok(())
    }
}

/// Which images are wanted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Channels {
    pub color: bool,
    pub depth: bool,
    pub normal: bool,
    pub opacity: bool,
    pub unknown: bool,
    /// Where a question comes with a text.
    pub heat: bool,
}

impl Channels {
    pub const NONE: Self = Self {
        color: false,
        depth: false,
        normal: false,
        opacity: false,
        unknown: false,
        heat: false,
    };
    /// All that needs no text.
    pub const ALL: Self =
        Self { color: true, depth: true, normal: true, opacity: true, unknown: true, heat: false };
}

/// What an image is made of; each is row-major, as long as the image has pixels, or empty where it
/// was not asked for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rendering {
    pub width: u32,
    pub height: u32,
    /// sRGB in 0..=1; black where nothing was hit or the surface has no colour.
    pub color: Vec<Vec3>,
    /// z-depth of the surface, m; 0 where there is none.
    pub depth_m: Vec<f32>,
    /// Unit normal towards the camera's side, world axes; zero where there is none.
    pub normal: Vec<Vec3>,
    /// The share of the light that the ray lost on its way.
    pub opacity: Vec<f32>,
    /// 1 where the ray left observed space before it met a surface, or met none.
    pub unknown: Vec<u8>,
    /// How well the text fits ([`MapView::text_scores`]); NaN where there is no surface, or none that
    /// was seen with features.
    pub heat: Vec<f32>,
}

/// What every tile of an image is drawn from.
struct Job<'a> {
    view: &'a MapView,
    rays: Rays,
    channels: Channels,
    settings: RenderSettings,
}

/// Draws a view on `pool`; camera and settings must have passed their checks. `None` if
/// `interrupted`, which is asked before every tile.
pub fn render(
    view: &MapView,
    camera: &Camera,
    channels: Channels,
    settings: &RenderSettings,
    pool: &ThreadPool,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Option<Rendering> {
    render_with(view, camera, channels, settings, None, pool, interrupted)
}

/// [`render`] with a text, made by [`MapView::scorer`] of this view.
pub fn render_with(
    view: &MapView,
    camera: &Camera,
    channels: Channels,
    settings: &RenderSettings,
    text: Option<&Scorer>,
    pool: &ThreadPool,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Option<Rendering> {
    let text = text.filter(|_| channels.heat);
    // Heat is that of the surface.
    let drawn = Channels { depth: channels.depth || text.is_some(), ..channels };
    let job = Job { view, rays: camera.rays(), channels: drawn, settings: *settings };
    let mut rendering = match settings.renderer {
        Renderer::Tile => tile::draw(&job, pool, interrupted),
        Renderer::Ray => patch::assemble(&job, pool, interrupted, &|area| ray::draw(&job, area)),
    }?;
    if let Some(text) = text {
        rendering.heat = heat::scores(&job, &rendering.depth_m, text, pool, interrupted)?;
    }
    if !channels.depth {
        rendering.depth_m = Vec::new();
    }
    Some(rendering)
}
