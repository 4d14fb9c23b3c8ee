//! What becomes of the settings that a map was stored with.

use std::fmt::Debug;

use super::{BackendChoice, MODALITIES, MapConfig, MapSettings, RadianceConfig};
use crate::error::{Error, Result};

/// A setting that a stored map keeps although the current settings say otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kept {
    /// The setting's key.
    pub field: &'static str,
    /// What the map was made with.
    pub stored: String,
    /// What the current settings say.
    pub current: String,
}

impl std::fmt::Display for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {} (not {})", self.field, self.stored, self.current)
    }
}

impl MapConfig {
    /// The settings that give this configuration.
    pub fn settings(&self) -> MapSettings {
        MapSettings {
            profile: self.profile,
            schedule: self.schedule,
            prior: self.prior,
            backend: BackendChoice::Auto,
            modalities: self.modalities.clone(),
            r0_m: self.r0_m,
            steps: Some(self.steps_per_frame),
            seed: self.seed,
            frame_budget_ms: self.frame_budget_ms,
            memory_mib: self.memory_mib,
            color_spacing_m: self.r0_m / (1u32 << self.radiance.log2_side) as f32,
            color_degree: self.radiance.degree,
            color_rays: self.radiance.rays_per_step,
            color_renderer: self.radiance.renderer,
            color_sharpens: self.radiance.sharpens,
            dictionary: self.language.dictionary.name(),
            dictionary_atoms: self.language.capacity,
            dictionary_threshold: Some(self.language.threshold),
            dictionary_decay: self.language.decay,
            code_spacing_m: self.language.spacing_m(self.r0_m),
            codes: self.language.codes,
            code_terms: self.language.terms,
        }
    }

    /// The settings of a stored map that is opened under `current` ones. How much work and memory a
    /// frame may take describes the machine, and follows `current`, as does how colours are trained;
    /// everything else describes the map. Steps per frame follow only where both have the same profile,
    /// which decides their default.
    pub fn resumed(self, current: &Self) -> Self {
        let has_profile = self.profile == current.profile;
        let steps = if has_profile { current.steps_per_frame } else { self.steps_per_frame };
        let radiance = RadianceConfig {
            rays_per_step: current.radiance.rays_per_step,
            renderer: current.radiance.renderer,
            sharpens: current.radiance.sharpens,
            ..self.radiance
        };
        Self {
            schedule: current.schedule,
            frame_budget_ms: current.frame_budget_ms,
            memory_mib: current.memory_mib,
            key_frame_mib: current.key_frame_mib,
            steps_per_frame: steps,
            radiance,
            ..self
        }
    }

    /// What a stored map keeps in [`MapConfig::resumed`] although `current` says otherwise.
    pub fn kept(&self, current: &Self) -> Vec<Kept> {
        let spacing = |config: &Self| config.settings().color_spacing_m;
        let code_spacing = |config: &Self| config.language.spacing_m(config.r0_m);
        [
            kept("profile", self.profile, current.profile),
            kept("prior", self.prior, current.prior),
            kept("modalities", self.modalities.join(","), current.modalities.join(",")),
            kept("r0_m", self.r0_m, current.r0_m),
            kept("color_spacing_m", spacing(self), spacing(current)),
            kept("color_degree", self.radiance.degree, current.radiance.degree),
            kept("dictionary", self.language.dictionary.name(), current.language.dictionary.name()),
            kept("dictionary_atoms", self.language.capacity, current.language.capacity),
            kept("code_spacing_m", code_spacing(self), code_spacing(current)),
            kept("codes", self.language.codes, current.language.codes),
            kept("seed", self.seed, current.seed),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

impl MapConfig {
    /// Refuses stored numbers that no settings give and that code relies on: by what is divided, how
    /// much is allocated, and how far is searched. The widths of decoders are checked where they are
    /// made.
    pub(super) fn check_numbers(&self) -> Result<()> {
        let whole = [
            ("memory_mib", self.memory_mib, 1..=1 << 20),
            ("surfel_stride", self.surfel_stride, 1..=1024),
            ("carve_stride", self.carve_stride, 1..=1024),
            ("rays_per_step", self.rays_per_step, 1..=1 << 16),
            ("steps_per_frame", self.steps_per_frame, 0..=1000),
            ("window", self.window, 1..=1024),
            ("key_frame_pixels", self.key_frame_pixels, 1..=1 << 20),
            ("key_frame_mib", self.key_frame_mib, 0..=1 << 20),
        ];
        let real = [
            ("frame_budget_ms", self.frame_budget_ms, 1.0..=10_000.0),
            ("split_error_m", self.split_error_m, 1e-4..=1.0),
            ("surfel_size_m", self.surfel_size_m, 1e-3..=1.0),
            ("max_distance_m", self.max_distance_m, 0.1..=100.0),
            ("eikonal_share", self.eikonal_share, 0.0..=1.0),
            ("learning_rate", self.learning_rate, 0.0..=1.0),
            ("occupancy_learning_rate", self.occupancy_learning_rate, 0.0..=1.0),
            ("decoder_learning_rate", self.decoder_learning_rate, 0.0..=1.0),
            ("key_frame_iou", self.key_frame_iou, 0.0..=2.0),
        ];
        let wrong = |name: &str, value: &dyn std::fmt::Display| {
            let problem = format!("{name} of {value} lies outside of its limits");
            Err(Error::corrupt("settings", problem))
        };
        if let Some((name, value, _)) = whole.into_iter().find(|(_, n, range)| !range.contains(n)) {
            return wrong(name, &value);
        }
        if let Some((name, value, _)) = real.into_iter().find(|(_, x, range)| !range.contains(x)) {
            return wrong(name, &value);
        }
        if !(-4..=0).contains(&self.finest_level) {
            return wrong("finest_level", &self.finest_level);
        }
        match self.modalities.iter().find(|name| !MODALITIES.contains(&name.as_str())) {
            Some(name) => wrong("modality", &name.chars().take(64).collect::<String>()),
            None => Ok(()),
        }
    }
}

fn kept<T: PartialEq + Debug>(field: &'static str, stored: T, current: T) -> Option<Kept> {
    // Values are shown as the settings file writes them.
    let text = |value: &T| format!("{value:?}").trim_matches('"').to_lowercase();
    (stored != current).then(|| Kept { field, stored: text(&stored), current: text(&current) })
}

#[cfg(test)]
mod tests {
    use super::super::{MapSettings, Prior, Profile, RadianceConfig, Renderer, Schedule};
    use super::*;

    fn config(change: impl FnOnce(&mut MapSettings)) -> MapConfig {
        let mut settings = MapSettings::default();
        change(&mut settings);
        MapConfig::from_settings(&settings).expect("valid settings")
    }

    #[test]
    fn settings_come_back() {
        let full = config(|s| (s.profile, s.steps, s.seed) = (Profile::Full, Some(9), 4));
        let full = MapConfig { radiance: RadianceConfig { degree: 3, ..full.radiance }, ..full };
        assert_eq!(MapConfig::from_settings(&full.settings()).expect("valid"), full);
    }

    #[test]
    fn numbers_that_no_settings_give_are_refused_by_name() {
        for settings in [
            MapSettings::default(),
            MapSettings { profile: Profile::Full, ..MapSettings::default() },
        ] {
            let config = MapConfig::from_settings(&settings).expect("valid settings");
            assert_eq!(config.clone().checked().expect("our own"), config);
        }
        type Spoil = fn(&mut MapConfig);
        let cases: [(&str, Spoil); 10] = [
            ("surfel_stride of 0", |c| c.surfel_stride = 0),
            ("carve_stride of 0", |c| c.carve_stride = 0),
            ("key_frame_pixels of 0", |c| c.key_frame_pixels = 0),
            ("rays_per_step of 4294967295", |c| c.rays_per_step = u32::MAX),
            ("surfel_size_m of NaN", |c| c.surfel_size_m = f32::NAN),
            ("max_distance_m of inf", |c| c.max_distance_m = f32::INFINITY),
            ("finest_level of -5", |c| c.finest_level = -5),
            ("memory_mib of 0", |c| c.memory_mib = 0),
            ("of radiance", |c| c.radiance.degree = 4),
            ("modality of smell", |c| c.modalities.push("smell".into())),
        ];
        for (words, spoil) in cases {
            let mut config = config(|_| {});
            spoil(&mut config);
            let error = config.checked().expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn what_describes_the_machine_follows_it() {
        let stored = config(|_| {});
        let current = config(|s| {
            s.schedule = Schedule::Adaptive;
            s.frame_budget_ms = 12.0;
            s.memory_mib = 100;
            s.steps = Some(3);
            s.color_rays = 512;
            s.color_renderer = Renderer::Tile;
            s.color_sharpens = false;
        });
        assert!(stored.kept(&current).is_empty());
        assert_eq!(stored.resumed(&current), current);
    }

    #[test]
    fn what_describes_the_map_stays_and_is_named() {
        let stored = config(|s| s.r0_m = 0.05);
        let current = config(|s| {
            s.profile = Profile::Full;
            s.prior = Prior::Learned;
            s.modalities = vec!["sdf".into()];
            s.seed = 3;
            s.color_degree = 2;
            s.memory_mib = 100;
        });
        let kept: Vec<String> = stored.kept(&current).iter().map(Kept::to_string).collect();
        let expected = [
            "profile lite (not full)",
            "prior closed (not learned)",
            "modalities sdf,occupancy,radiance,language (not sdf)",
            "r0_m 0.05 (not 0.1)",
            "color_degree 0 (not 2)",
            "seed 0 (not 3)",
        ];
        assert_eq!(kept, expected);
        let memory = |s: &mut MapSettings| (s.r0_m, s.memory_mib) = (0.05, 100);
        assert_eq!(stored.resumed(&current), config(memory));
    }
}
