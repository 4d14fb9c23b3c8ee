//! Settings of language: what the dictionary learns by, and how codes are kept.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{MapSettings, Profile};
use crate::error::{Error, Result};

/// How published codes are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum CodeForm {
    /// All coefficients, as halves.
    F16,
    /// All coefficients, as floats.
    F32,
    /// The largest coefficients with the numbers of their atoms.
    #[value(name = "top_k")]
    TopK,
}

/// Where atoms come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum DictionaryKind {
    /// Learned from the frames.
    Online,
    /// None: codes are the features themselves.
    Full,
    /// Given as the rows of an `.npy` file, read once; they stay as they are.
    Given(PathBuf),
}

impl DictionaryKind {
    fn read(text: &str) -> Result<Self> {
        match text {
            "online" => return Ok(Self::Online),
            "full" => return Ok(Self::Full),
            _ => {}
        }
        let path = Path::new(text);
        if path.extension().is_none_or(|ending| ending != "npy") {
            let problem = format!("'{text}' is none of online, full and the path of an .npy file");
            return Err(Error::invalid("dictionary", problem));
        }
        Ok(Self::Given(path.into()))
    }

    /// As the settings file writes it.
    pub fn name(&self) -> String {
        match self {
            Self::Online => "online".into(),
            Self::Full => "full".into(),
            Self::Given(path) => path.display().to_string(),
        }
    }
}

/// Checked settings of language.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LanguageConfig {
    pub dictionary: DictionaryKind,
    /// Atoms at most.
    pub capacity: u32,
    pub threshold: f32,
    pub decay: f32,
    /// Features of a frame that the dictionary learns from, at most.
    pub samples: u32,
    /// log2 of the distance between coded vertices in edges of a level-0 voxel.
    pub log2_spacing: i8,
    /// Every n-th pixel in u and v leaves its feature.
    pub stride: u32,
    pub codes: CodeForm,
    /// Coefficients of a code under `top_k`.
    pub terms: u32,
}

/// Most atoms, so that an atom's number is an `i16` and codes stay small.
pub const MAX_ATOMS: u32 = 1024;
/// Bounds of `log2_spacing`.
const LOG2_SPACINGS: std::ops::RangeInclusive<i8> = -3..=3;

impl LanguageConfig {
    pub(super) fn new(settings: &MapSettings) -> Result<Self> {
        if !(0.001..=10.0).contains(&settings.code_spacing_m) {
            let problem = format!("{} must lie within 0.001..=10 m", settings.code_spacing_m);
            return Err(Error::invalid("code_spacing_m", problem));
        }
        let full = settings.profile == Profile::Full;
        let log2_spacing = (settings.code_spacing_m / settings.r0_m).log2().round() as i8;
        let config = Self {
            dictionary: DictionaryKind::read(&settings.dictionary)?,
            capacity: settings.dictionary_atoms,
            threshold: settings.dictionary_threshold,
            decay: settings.dictionary_decay,
            samples: if full { 2048 } else { 512 },
            log2_spacing: log2_spacing.clamp(*LOG2_SPACINGS.start(), *LOG2_SPACINGS.end()),
            stride: if full { 4 } else { 8 },
            codes: settings.codes,
            terms: settings.code_terms,
        };
        config.check()?;
        Ok(config)
    }

    /// The distance between coded vertices, m.
    pub fn spacing_m(&self, r0_m: f32) -> f32 {
        r0_m * f32::from(self.log2_spacing).exp2()
    }

    fn check(&self) -> Result<()> {
        if !(1..=MAX_ATOMS).contains(&self.capacity) {
            let problem = format!("{} must lie within 1..={MAX_ATOMS}", self.capacity);
            return Err(Error::invalid("dictionary_atoms", problem));
        }
        if !(1..=MAX_ATOMS).contains(&self.terms) {
            let problem = format!("{} must lie within 1..={MAX_ATOMS}", self.terms);
            return Err(Error::invalid("code_terms", problem));
        }
        for (field, x) in
            [("dictionary_threshold", self.threshold), ("dictionary_decay", self.decay)]
        {
            if !(x > 0.0 && x < 1.0) {
                return Err(Error::invalid(field, format!("{x} must lie between 0 and 1")));
            }
        }
        Ok(())
    }

    /// Checks what a damaged or forged file could say and code relies on.
    pub(super) fn check_stored(&self) -> Result<()> {
        let fits =
            LOG2_SPACINGS.contains(&self.log2_spacing) && self.stride > 0 && self.samples > 0;
        match self.check() {
            Ok(()) if fits => Ok(()),
            _ => Err(Error::corrupt("settings", "of language lie outside of their limits")),
        }
    }
}

impl Default for LanguageConfig {
    /// That of a map without settings of its own for language.
    fn default() -> Self {
        Self {
            dictionary: DictionaryKind::Online,
            capacity: 256,
            threshold: 0.002,
            decay: 0.9,
            samples: 512,
            log2_spacing: 0,
            stride: 8,
            codes: CodeForm::F16,
            terms: 16,
        }
    }
}
