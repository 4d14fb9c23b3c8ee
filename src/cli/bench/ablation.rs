//! `orenx bench ablation`: what the closed form gives, what training adds to it, and what training
//! reaches without it, on clean depth and on noisy depth.
//!
//! The two trained maps take the same number of steps on the same number of rays. Without training
//! there is nothing left to do with the time; the table shows how much that is.

use clap::Args;

use super::figure::{Figure, Unit};
use super::geometry::name;
use super::printer::{Printer, load};
use super::recording::{Recording, RecordingArgs};
use crate::cli::eval::judge;
use crate::cli::map::processor;
use crate::config::{MapSettings, Prior, Profile};
use crate::dataset::Noise;
use crate::error::Error;
use crate::eval::{FieldErrors, Truth};

/// What training adds to the closed form, and is without it, on clean and noisy depth (office)
#[derive(Debug, Args)]
pub(super) struct AblationArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    #[arg(long, value_enum, default_value = "lite")]
    profile: Profile,
    /// Training steps a frame of both trained maps; the profile decides by default
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Only this noise, beside clean depth; may be repeated
    #[arg(long, value_name = "MODEL:S")]
    noise: Vec<Noise>,
}

/// The paper's levels (tab:noise_robustness), m and m per m.
const NOISE: [Noise; 6] = [
    Noise::Gaussian(0.01),
    Noise::Gaussian(0.02),
    Noise::Gaussian(0.05),
    Noise::Axial(0.0011),
    Noise::Axial(0.0023),
    Noise::Axial(0.0057),
];

/// How a map starts and whether it trains.
#[derive(Debug, Clone, Copy)]
struct Variant {
    name: &'static str,
    prior: Prior,
    trains: bool,
}

const VARIANTS: [Variant; 3] = [
    Variant { name: "closed form", prior: Prior::Closed, trains: false },
    Variant { name: "closed form, trained", prior: Prior::Closed, trains: true },
    Variant { name: "zero, trained", prior: Prior::Learned, trains: true },
];

impl AblationArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let folder = self.recording.folder("office")?;
        let recording = self.recording.open(&folder)?;
        // Meshes are not compared, and take longer than the rest.
        let truth = Truth { surface: None, ..Truth::load(&folder)? };
        if !out.is_json() {
            let of = format!("{}, {}; {}", name(self.profile), processor(), load());
            out.line(&format!("{}: {of}\n\n{HEAD}", recording.data.name()))?;
        }
        let levels = if self.noise.is_empty() { &NOISE[..] } else { &self.noise };
        for noise in [None].into_iter().chain(levels.iter().copied().map(Some)) {
            for variant in VARIANTS {
                let made = self.make(&recording, &truth, variant, noise)?;
                if out.is_json() {
                    out.figures(made.figures())?;
                } else {
                    out.line(&made.markdown())?;
                }
            }
        }
        Ok(())
    }

    fn make(
        &self,
        recording: &Recording,
        truth: &Truth,
        variant: Variant,
        noise: Option<Noise>,
    ) -> anyhow::Result<Made> {
        let settings = MapSettings {
            profile: self.profile,
            prior: variant.prior,
            steps: if variant.trains { self.steps } else { Some(0) },
            ..MapSettings::default()
        };
        let (mut mapper, tally) = recording.map(&settings, noise)?;
        let field = judge(&*mapper.publish_all()?, truth)?.geometry.and_then(|g| g.field);
        let field =
            field.ok_or_else(|| Error::invalid("data", "the recording has no gt_sdf.npz"))?;
        let noise = noise.map_or_else(|| "none".to_owned(), |noise| noise.to_string());
        let (steps, seconds) = (mapper.stats().steps, tally.seconds);
        Ok(Made { variant: variant.name, noise, field, steps, seconds })
    }
}

/// A map that was judged.
struct Made {
    variant: &'static str,
    noise: String,
    field: FieldErrors,
    steps: u64,
    seconds: f64,
}

const HEAD: &str = "\
| noise | start | near mm | far mm | sign near % | known near % | known far % | steps | s |
|---|---|---:|---:|---:|---:|---:|---:|---:|";

impl Made {
    fn markdown(&self) -> String {
        let (mae, known) = (&self.field.sdf_mae_m, &self.field.known_share);
        format!(
            "| {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {} | {:.1} |",
            self.noise,
            self.variant,
            mae.near_observed * 1e3,
            mae.far_observed * 1e3,
            self.field.sign_accuracy_near * 1e2,
            known.near_observed * 1e2,
            known.far_observed * 1e2,
            self.steps,
            self.seconds
        )
    }

    fn figures(&self) -> Vec<Figure> {
        let case = format!("{}, noise {}", self.variant, self.noise);
        let figure = |measure: &str, value, unit| Figure::new(&case, measure, value, unit);
        let (mae, known) = (&self.field.sdf_mae_m, &self.field.known_share);
        vec![
            figure("sdf_mae_near_observed", mae.near_observed, Unit::Metres),
            figure("sdf_mae_far_observed", mae.far_observed, Unit::Metres),
            figure("sign_accuracy_near", self.field.sign_accuracy_near, Unit::Share),
            figure("known_share_near_observed", known.near_observed, Unit::Share),
            figure("known_share_far_observed", known.far_observed, Unit::Share),
            figure("steps", self.steps as f64, Unit::Count),
            figure("seconds", self.seconds, Unit::Seconds),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::Ranges;

    #[test]
    fn a_row_of_the_table_has_a_cell_for_each_head() {
        let ranges = |near_observed, far_observed| Ranges {
            near: 0.0,
            near_observed,
            far: 0.0,
            far_observed,
            all: 0.0,
            all_observed: 0.0,
        };
        let field = FieldErrors {
            sdf_mae_m: ranges(0.0035, 0.0061),
            sdf_p95_m: ranges(0.0, 0.0),
            gradient_mae_rad: ranges(0.0, 0.0),
            sign_accuracy_near: 0.975,
            sign_accuracy_near_observed: 0.98,
            known_share: ranges(0.99, 1.0),
        };
        let noise = NOISE[3].to_string();
        let made = Made { variant: VARIANTS[0].name, noise, field, steps: 0, seconds: 2.0 };
        let line = made.markdown();
        assert_eq!(
            line,
            "| axial:0.0011 | closed form | 3.50 | 6.10 | 97.50 | 99.00 | 100.00 | 0 | 2.0 |"
        );
        let cells = |line: &str| line.matches('|').count();
        assert!(HEAD.lines().all(|head| cells(head) == cells(&line)));
        assert_eq!(made.figures()[1].value, 0.0061);
    }
}
