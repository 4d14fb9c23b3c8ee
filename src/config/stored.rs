//! What becomes of the settings that a map was stored with.

use std::fmt::Debug;

use super::{BackendChoice, MapConfig, MapSettings};

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
            color_rays: self.radiance.rays_per_step,
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
    /// frame may take describes the machine, and follows `current`; everything else describes the
    /// map. Steps per frame follow only where both have the same profile, which decides their
    /// default.
    pub fn resumed(self, current: &Self) -> Self {
        let has_profile = self.profile == current.profile;
        let steps = if has_profile { current.steps_per_frame } else { self.steps_per_frame };
        Self {
            schedule: current.schedule,
            frame_budget_ms: current.frame_budget_ms,
            memory_mib: current.memory_mib,
            key_frame_mib: current.key_frame_mib,
            steps_per_frame: steps,
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

fn kept<T: PartialEq + Debug>(field: &'static str, stored: T, current: T) -> Option<Kept> {
    // Values are shown as the settings file writes them.
    let text = |value: &T| format!("{value:?}").trim_matches('"').to_lowercase();
    (stored != current).then(|| Kept { field, stored: text(&stored), current: text(&current) })
}

#[cfg(test)]
mod tests {
    use super::super::{MapSettings, Prior, Profile, Schedule};
    use super::*;

    fn config(change: impl FnOnce(&mut MapSettings)) -> MapConfig {
        let mut settings = MapSettings::default();
        change(&mut settings);
        MapConfig::from_settings(&settings).expect("valid settings")
    }

    #[test]
    fn settings_come_back() {
        let full = config(|s| (s.profile, s.steps, s.seed) = (Profile::Full, Some(9), 4));
        assert_eq!(MapConfig::from_settings(&full.settings()).expect("valid"), full);
    }

    #[test]
    fn what_describes_the_machine_follows_it() {
        let stored = config(|_| {});
        let current = config(|s| {
            s.schedule = Schedule::Adaptive;
            s.frame_budget_ms = 12.0;
            s.memory_mib = 100;
            s.steps = Some(3);
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
            s.memory_mib = 100;
        });
        let kept: Vec<String> = stored.kept(&current).iter().map(Kept::to_string).collect();
        let expected = [
            "profile lite (not full)",
            "prior closed (not learned)",
            "modalities sdf,occupancy,radiance,language (not sdf)",
            "r0_m 0.05 (not 0.1)",
            "seed 0 (not 3)",
        ];
        assert_eq!(kept, expected);
        let memory = |s: &mut MapSettings| (s.r0_m, s.memory_mib) = (0.05, 100);
        assert_eq!(stored.resumed(&current), config(memory));
    }
}
