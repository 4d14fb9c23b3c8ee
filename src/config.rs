//! Settings as a user writes them, and the checked numbers that the code runs on.
//!
//! [`MapSettings`] is raw: what the file, the environment and the flags say. [`MapConfig`] is
//! checked and complete: every profile default is filled in, and it travels inside a checkpoint.

mod access;
mod bus;
mod encoder;
mod language;
mod layers;
mod log;
mod radiance;
mod ros2;
mod secret;
mod server;
mod storage;
mod stored;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

pub use access::{
    AccessConfig, AuthSettings, KeyConfig, KeySettings, KeySource, LimitSettings, Role, TlsConfig,
    TlsSettings, check_key, is_loopback,
};
pub use bus::{
    BusConfig, BusMode, BusSettings, FrameLimits, SliceConfig, SliceSettings, check_chunk,
};
pub use encoder::{EncoderKind, EncoderSettings};
pub use language::{CodeForm, DictionaryKind, LanguageConfig, MAX_ATOMS};
pub use log::{LogFormat, LogSettings};
pub use radiance::{RadianceConfig, Renderer};
pub use ros2::{Bridge, Ros2Config, Ros2Outputs, Ros2Settings};
pub use secret::Secret;
pub use server::{DEFAULT_FILE, GpuSettings, ServerConfig, ServerSettings, Settings};
pub use storage::{JournalMode, KeepConfig, StorageSettings};
pub use stored::Kept;

/// How much work a frame may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// A small decoder, 4 cm surfels and few rays: keeps up with a camera on two cores.
    Lite,
    /// The paper's numbers: 20 480 rays and a 17-64-64-1 decoder.
    Full,
}

/// How the work of a frame is bounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Schedule {
    /// A fixed number of steps and rays: the same input gives the same map, bit for bit.
    Fixed,
    /// Rays and steps fit a time budget, so that the map keeps up with any stream.
    Adaptive,
}

/// Where the explicit part of the distance field comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Prior {
    /// Written in closed form from fused surfels; training learns the rest.
    Closed,
    /// Zero at the start and trained, as in the paper.
    Learned,
}

/// Which backend trains the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum BackendChoice {
    Auto,
    Cpu,
    Gpu,
}

/// A choice as the settings file and the flags write it.
pub fn name_of(choice: impl clap::ValueEnum) -> String {
    choice.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// A map's settings as written by a user; everything that is absent follows the profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MapSettings {
    pub profile: Profile,
    pub schedule: Schedule,
    pub prior: Prior,
    pub backend: BackendChoice,
    /// Empty: every modality that exists.
    pub modalities: Vec<String>,
    pub r0_m: f32,
    /// Training steps per frame; `None` follows the profile, 0 means no training.
    pub steps: Option<u32>,
    pub seed: u32,
    /// Budget of one frame under `adaptive`, ms, publishing included.
    pub frame_budget_ms: f32,
    /// Bound of the map's memory, MiB. At the bound new voxels are refused and counted.
    pub memory_mib: u32,
    /// Distance between vertices of colour, m; r0_m divided by the nearest of 1, 2, 4 and 8.
    pub color_spacing_m: f32,
    /// Degree of the spherical harmonics by which a colour depends on where it is seen from; 0: on
    /// nothing.
    pub color_degree: u8,
    /// Rays of a training step whose colours are compared with the camera's.
    pub color_rays: u32,
    /// What draws the colours that are compared.
    pub color_renderer: Renderer,
    /// Whether distances learn from these comparisons.
    pub color_sharpens: bool,
    /// `online`, `full`, or the path of atoms in an `.npy` file.
    pub dictionary: String,
    /// Atoms of the dictionary at most.
    pub dictionary_atoms: u32,
    /// A direction with more than this share of all energy becomes an atom; `None`: what lets the
    /// last atom be found late.
    pub dictionary_threshold: Option<f32>,
    /// What is left of a frame's say in what the next atoms are, after the next frame.
    pub dictionary_decay: f32,
    /// Distance between coded vertices, m; r0_m times the nearest of 1/8 to 8.
    pub code_spacing_m: f32,
    /// How published codes are kept.
    pub codes: CodeForm,
    /// Coefficients of a code under `top_k`.
    pub code_terms: u32,
}

impl Default for MapSettings {
    fn default() -> Self {
        Self {
            profile: Profile::Lite,
            schedule: Schedule::Fixed,
            prior: Prior::Closed,
            backend: BackendChoice::Auto,
            modalities: Vec::new(),
            r0_m: 0.1,
            steps: None,
            seed: 0,
            frame_budget_ms: 25.0,
            memory_mib: 4096,
            color_spacing_m: 0.025,
            color_degree: 0,
            color_rays: 0,
            color_renderer: Renderer::Ray,
            color_sharpens: true,
            dictionary: "online".into(),
            dictionary_atoms: 256,
            dictionary_threshold: None,
            dictionary_decay: 0.9,
            code_spacing_m: 0.1,
            codes: CodeForm::F16,
            code_terms: 16,
        }
    }
}

/// Edge lengths that level-0 voxels may have, m.
const R0_M: std::ops::RangeInclusive<f32> = 0.01..=1.0;

/// Checked settings of one map, complete in numbers. Stored in every checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapConfig {
    pub profile: Profile,
    pub schedule: Schedule,
    pub prior: Prior,
    pub modalities: Vec<String>,
    pub seed: u32,
    pub memory_mib: u32,
    pub frame_budget_ms: f32,

    /// Edge length of a level-0 voxel, m.
    pub r0_m: f32,
    /// The finest level of signed distance and occupancy; below 0 only where the prior errs.
    pub finest_level: i8,
    /// A leaf is split while its prior errs by more than this at the centre or a child centre, m.
    pub split_error_m: f32,

    /// Edge length of a surfel cell, m.
    pub surfel_size_m: f32,
    /// Every n-th pixel in u and v becomes a surfel observation.
    pub surfel_stride: u32,
    /// Every n-th pixel in u and v carves free space.
    pub carve_stride: u32,
    /// Distances are exact up to here; beyond, an answer says "at least", m.
    pub max_distance_m: f32,

    pub rays_per_step: u32,
    pub steps_per_frame: u32,
    /// Share of the samples that pay the Eikonal loss.
    pub eikonal_share: f32,
    /// Hidden widths of the residual decoder.
    pub hidden: Vec<u32>,
    pub learning_rate: f32,
    pub occupancy_learning_rate: f32,
    pub decoder_learning_rate: f32,

    pub window: u32,
    pub key_frame_iou: f32,
    pub key_frame_pixels: u32,
    pub key_frame_mib: u32,

    /// Stored apart: maps from before there were colours have none.
    #[serde(skip)]
    pub radiance: RadianceConfig,
    /// Stored apart, as that of radiance.
    #[serde(skip)]
    pub language: LanguageConfig,
}

/// The modalities that exist, in column order.
pub const MODALITIES: [&str; 4] = ["sdf", "occupancy", "radiance", "language"];

impl MapConfig {
    /// Checks settings and fills in what the profile says.
    pub fn from_settings(settings: &MapSettings) -> Result<Self> {
        if !R0_M.contains(&settings.r0_m) {
            return Err(Error::invalid(
                "r0_m",
                format!("{} must lie within 0.01..=1 m", settings.r0_m),
            ));
        }
        if settings.steps.is_some_and(|s| s > 1000) {
            return Err(Error::invalid("steps", "at most 1000 a frame"));
        }
        if !(1.0..=10_000.0).contains(&settings.frame_budget_ms) {
            return Err(Error::invalid("frame_budget_ms", "must lie within 1..=10000"));
        }
        if !(64..=1 << 20).contains(&settings.memory_mib) {
            return Err(Error::invalid("memory_mib", "must lie within 64..=1048576"));
        }
        let full = settings.profile == Profile::Full;
        Ok(Self {
            profile: settings.profile,
            schedule: settings.schedule,
            prior: settings.prior,
            modalities: checked_modalities(&settings.modalities)?,
            seed: settings.seed,
            memory_mib: settings.memory_mib,
            frame_budget_ms: settings.frame_budget_ms,
            r0_m: settings.r0_m,
            finest_level: if full { -1 } else { 0 },
            split_error_m: 0.005,
            surfel_size_m: if full { 0.02 } else { 0.04 },
            surfel_stride: if full { 2 } else { 4 },
            carve_stride: 8,
            max_distance_m: 2.0,
            rays_per_step: if full { 20_480 } else { 2048 },
            steps_per_frame: settings.steps.unwrap_or(if full { 4 } else { 1 }),
            eikonal_share: if full { 1.0 } else { 0.25 },
            hidden: if full { vec![64, 64] } else { vec![32] },
            learning_rate: if settings.prior == Prior::Closed { 5e-4 } else { 5e-3 },
            occupancy_learning_rate: 1e-2,
            decoder_learning_rate: 1e-3,
            window: 8,
            key_frame_iou: 0.85,
            key_frame_pixels: 16_384,
            key_frame_mib: (settings.memory_mib / 4).min(256),
            radiance: RadianceConfig::new(settings)?,
            language: LanguageConfig::new(settings)?,
        })
    }

    /// Checks what a damaged or forged file could say and code relies on.
    pub fn checked(self) -> Result<Self> {
        if !R0_M.contains(&self.r0_m) {
            return Err(Error::corrupt(
                "settings",
                "the size of voxels lies outside of its limits",
            ));
        }
        self.check_numbers()?;
        self.radiance.check_stored()?;
        self.language.check_stored()?;
        Ok(self)
    }

    /// Whether a modality is part of this map.
    pub fn has(&self, modality: &str) -> bool {
        self.modalities.iter().any(|m| m == modality)
    }
}

fn checked_modalities(names: &[String]) -> Result<Vec<String>> {
    if names.is_empty() {
        return Ok(MODALITIES.iter().map(|m| (*m).to_owned()).collect());
    }
    for name in names {
        if !MODALITIES.contains(&name.as_str()) {
            return Err(Error::invalid(
                "modalities",
                format!("unknown modality '{name}'; there are {}", MODALITIES.join(", ")),
            ));
        }
    }
    if !names.iter().any(|n| n == "sdf") {
        return Err(Error::invalid("modalities", "sdf is the base of every map"));
    }
    let known = MODALITIES.iter().filter(|m| names.iter().any(|n| n == *m));
    Ok(known.map(|m| (*m).to_owned()).collect())
}
