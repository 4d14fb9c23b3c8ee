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
/// Threshold times atoms at most where the settings do not say: 0.002 at 256, as in algorithms.md §9.
/// With the same 0.002 the first rooms take all places of a smaller dictionary: in a house, 64 atoms
/// had an mAP of 36 %, and 72 % at 0.008.
const THRESHOLD_ATOMS: f32 = 0.512;
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
            threshold: settings
                .dictionary_threshold
                .unwrap_or(THRESHOLD_ATOMS / settings.dictionary_atoms.max(1) as f32),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn config(change: impl FnOnce(&mut MapSettings)) -> Result<LanguageConfig> {
        let mut settings = MapSettings::default();
        change(&mut settings);
        LanguageConfig::new(&settings)
    }

    #[test]
    fn a_smaller_dictionary_is_choosier_unless_told() {
        let threshold = |atoms, given| {
            config(|s| (s.dictionary_atoms, s.dictionary_threshold) = (atoms, given))
                .expect("good")
                .threshold
        };
        assert_eq!((threshold(256, None), threshold(64, None)), (0.002, 0.008));
        assert_eq!(threshold(64, Some(0.01)), 0.01);
        assert_eq!(config(|_| ()).expect("good"), LanguageConfig::default());
    }

    #[test]
    fn spacings_follow_the_voxels_and_limits_are_named() {
        for (spacing, log2) in [(0.1, 0), (0.05, -1), (0.21, 1), (5.0, 3), (0.001, -3)] {
            let config = config(|s| s.code_spacing_m = spacing).expect("good");
            assert_eq!(config.log2_spacing, log2, "{spacing}");
        }
        type Change = fn(&mut MapSettings);
        let cases: [(Change, &str); 6] = [
            (|s| s.code_spacing_m = f32::NAN, "code_spacing_m"),
            (|s| s.dictionary_atoms = 0, "dictionary_atoms"),
            (|s| s.dictionary_atoms = 1025, "dictionary_atoms"),
            (|s| s.dictionary_threshold = Some(1.0), "dictionary_threshold"),
            (|s| s.dictionary_decay = f32::NAN, "dictionary_decay"),
            (|s| s.code_terms = 0, "code_terms"),
        ];
        for (change, field) in cases {
            assert_eq!(config(change).expect_err(field).field(), Some(field));
        }
    }
}
