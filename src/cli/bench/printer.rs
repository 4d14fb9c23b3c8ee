//! Where figures go: an aligned table as they come, or one JSON object each.

use std::io::Write;

use serde::Serialize;

use super::figure::{Figure, Target, Unit};
use crate::cli::map::processor;

/// Prints the figures of one bench.
pub(super) struct Printer<'a> {
    out: &'a mut dyn Write,
    bench: &'static str,
    json: bool,
    machine: String,
    /// The case that the last line of the table belongs to.
    case: Option<String>,
}

/// A figure as JSON has it.
#[derive(Serialize)]
struct Object<'a> {
    bench: &'static str,
    case: &'a str,
    measure: &'a str,
    value: f64,
    unit: Unit,
    #[serde(flatten)]
    target: Option<Target>,
    #[serde(skip_serializing_if = "Option::is_none")]
    met: Option<bool>,
    machine: &'a str,
}

impl<'a> Printer<'a> {
    pub(super) fn new(out: &'a mut dyn Write, bench: &'static str, json: bool) -> Self {
        Self { out, bench, json, machine: processor(), case: None }
    }

    pub(super) fn is_json(&self) -> bool {
        self.json
    }

    /// A line of a table that a bench lays out itself.
    pub(super) fn line(&mut self, line: &str) -> anyhow::Result<()> {
        Ok(writeln!(self.out, "{line}")?)
    }

    pub(super) fn figures(
        &mut self,
        figures: impl IntoIterator<Item = Figure>,
    ) -> anyhow::Result<()> {
        figures.into_iter().try_for_each(|figure| self.figure(&figure))
    }

    fn figure(&mut self, figure: &Figure) -> anyhow::Result<()> {
        let Figure { case, measure, value, unit, target } = figure;
        if self.json {
            let object = Object {
                bench: self.bench,
                case,
                measure,
                value: *value,
                unit: *unit,
                target: *target,
                met: target.map(|target| target.is_met_by(*value)),
                machine: &self.machine,
            };
            return Ok(writeln!(self.out, "{}", serde_json::to_string(&object)?)?);
        }
        if self.case.is_none() {
            writeln!(self.out, "{}; {}", self.machine, load())?;
        }
        if self.case.as_ref() != Some(case) {
            writeln!(self.out, "\n{case}")?;
            self.case = Some(case.clone());
        }
        let (name, shown) = (measure.replace('_', " "), unit.show(*value));
        match target {
            Some(target) => {
                writeln!(self.out, "  {name:<28}{shown:>18}   {}", target.show(*value, *unit))
            }
            None => writeln!(self.out, "  {name:<28}{shown:>18}"),
        }?;
        Ok(())
    }
}

/// What else runs on the machine, as far as it says so.
pub(super) fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    match text.split_whitespace().next() {
        Some(load) => format!("load {load} (this run is about one thread a core of it)"),
        None => "load unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn print(json: bool) -> String {
        let mut text = Vec::new();
        let mut printer = Printer::new(&mut text, "geometry", json);
        let near = Figure::new("full", "near_observed", 0.004, Unit::Metres);
        let far = Figure::new("full", "far_observed", f64::NAN, Unit::Metres);
        let judged = near.clone().against(Some(Target::at_most(0.0035)));
        printer.figures([judged, far, near]).expect("printed");
        String::from_utf8(text).expect("text")
    }

    #[test]
    fn objects_have_units_targets_and_verdicts() {
        let text = print(true);
        let objects: Vec<serde_json::Value> =
            text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        assert_eq!(objects.len(), 3);
        assert_eq!((&objects[0]["unit"], &objects[0]["value"]), (&"m".into(), &0.004.into()));
        assert_eq!(objects[0]["target"], 0.0035);
        assert_eq!((&objects[0]["bound"], &objects[0]["met"]), (&"at_most".into(), &false.into()));
        assert!(objects[1]["value"].is_null() && objects[1].get("met").is_none());
        assert!(objects[2].get("target").is_none() && objects[2].get("bound").is_none());
    }

    #[test]
    fn the_table_names_a_case_once() {
        let text = print(false);
        assert_eq!(text.lines().filter(|line| *line == "full").count(), 1);
        assert!(text.contains("4.00 mm   MISSED: at most 3.50 mm"), "{text}");
        assert!(text.lines().next().is_some_and(|line| line.contains("threads")), "{text}");
    }
}
