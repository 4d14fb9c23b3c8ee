//! Settings of radiance: how densely colours lie, what they depend on, and how they are trained.

use serde::{Deserialize, Serialize};

use super::{MapSettings, Profile};
use crate::error::{Error, Result};
use crate::geometry::harmonics::MAX_DEGREE;

/// How an image is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Renderer {
    /// Voxel by voxel on tiles of pixels: fast.
    Tile,
    /// Ray by ray through the field itself: the reference.
    Ray,
}

/// Checked settings of radiance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RadianceConfig {
    /// log2 of the vertices of colour along an edge of a level-0 voxel.
    pub log2_side: u8,
    /// Degree of the spherical harmonics by which colours depend on the direction. Stored apart: maps
    /// from before colours did have none.
    #[serde(skip)]
    pub degree: u8,
    /// Every n-th pixel in u and v leaves its colour.
    pub stride: u32,
    /// Rays of a training step that compare colours.
    pub rays_per_step: u32,
    /// What draws them. Says how a map is trained, not what it is: it is not stored.
    #[serde(skip, default = "by_rays")]
    pub renderer: Renderer,
    /// Of the logits of vertices.
    pub learning_rate: f32,
    /// Of the mean difference of colours among the losses of the distance.
    pub weight: f32,
    /// Whether distances learn from colours.
    pub sharpens: bool,
}

/// Most rays of a step that compare colours.
const MAX_COLOR_RAYS: u32 = 1 << 16;

impl RadianceConfig {
    pub(super) fn new(settings: &MapSettings) -> Result<Self> {
        if !(0.001..=1.0).contains(&settings.color_spacing_m) {
            return Err(Error::invalid(
                "color_spacing_m",
                format!("{} must lie within 0.001..=1 m", settings.color_spacing_m),
            ));
        }
        if settings.color_rays > MAX_COLOR_RAYS {
            return Err(Error::invalid("color_rays", format!("at most {MAX_COLOR_RAYS}")));
        }
        if settings.color_degree > MAX_DEGREE {
            return Err(Error::invalid("color_degree", format!("at most {MAX_DEGREE}")));
        }
        let full = settings.profile == Profile::Full;
        Ok(Self {
            log2_side: (settings.r0_m / settings.color_spacing_m).log2().round().clamp(0.0, 3.0)
                as u8,
            degree: settings.color_degree,
            stride: if full { 2 } else { 4 },
            rays_per_step: settings.color_rays,
            renderer: settings.color_renderer,
            learning_rate: 0.01,
            weight: 10.0,
            sharpens: settings.color_sharpens,
        })
    }

    /// Checks what a damaged or forged file could say and code relies on.
    pub(super) fn check_stored(&self) -> Result<()> {
        if self.log2_side > 3
            || self.degree > MAX_DEGREE
            || self.stride == 0
            || self.rays_per_step > MAX_COLOR_RAYS
            || !self.learning_rate.is_finite()
            || !self.weight.is_finite()
        {
            return Err(Error::corrupt("settings", "of radiance lie outside of their limits"));
        }
        Ok(())
    }
}

fn by_rays() -> Renderer {
    Renderer::Ray
}

impl Default for RadianceConfig {
    /// That of a map without settings of its own for radiance.
    fn default() -> Self {
        Self {
            log2_side: 2,
            degree: 0,
            stride: 4,
            rays_per_step: 0,
            renderer: by_rays(),
            learning_rate: 0.01,
            weight: 10.0,
            sharpens: false,
        }
    }
}
