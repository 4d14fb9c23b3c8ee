//! `orenx bench`: what this build reaches on this machine, beside what it is meant to reach.
//!
//! Errors do not depend on the machine. Times do: a ratio is measured within one run, its cases in
//! turn and paired, so that both meet the same machine; any other speed is printed with the
//! machine and its load.

mod ask;
mod clock;
mod corridor;
mod figure;
mod geometry;
mod language;
mod mapping;
mod planner;
mod printer;
mod query;
pub(super) mod recording;
mod render;
mod serve;

use std::io::{Write, stdout};

use clap::{Args, Subcommand};

use self::printer::Printer;

/// Measure this build: errors and speed, each beside its target; without a name, list what there is
#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(subcommand)]
    bench: Option<Bench>,
    /// One JSON object a figure, in SI units
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Bench {
    Geometry(geometry::GeometryArgs),
    Map(mapping::MappingArgs),
    Corridor(corridor::CorridorArgs),
    Query(query::QueryBenchArgs),
    Render(render::RenderBenchArgs),
    Ask(ask::AskBenchArgs),
    Language(language::LanguageArgs),
    Serve(serve::ServeBenchArgs),
    Planner(planner::PlannerBenchArgs),
}

impl BenchArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let mut stdout = stdout().lock();
        let Some(bench) = self.bench else { return list(&mut stdout, self.json) };
        bench.run(&mut Printer::new(&mut stdout, bench.name(), self.json))
    }
}

impl Bench {
    fn name(&self) -> &'static str {
        match self {
            Self::Geometry(_) => "geometry",
            Self::Map(_) => "map",
            Self::Corridor(_) => "corridor",
            Self::Query(_) => "query",
            Self::Render(_) => "render",
            Self::Ask(_) => "ask",
            Self::Language(_) => "language",
            Self::Serve(_) => "serve",
            Self::Planner(_) => "planner",
        }
    }

    fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        match self {
            Self::Geometry(arguments) => arguments.run(out),
            Self::Map(arguments) => arguments.run(out),
            Self::Corridor(arguments) => arguments.run(out),
            Self::Query(arguments) => arguments.run(out),
            Self::Render(arguments) => arguments.run(out),
            Self::Ask(arguments) => arguments.run(out),
            Self::Language(arguments) => arguments.run(out),
            Self::Serve(arguments) => arguments.run(out),
            Self::Planner(arguments) => arguments.run(out),
        }
    }
}

/// The benches by name, as the command line knows them.
fn list(out: &mut dyn Write, json: bool) -> anyhow::Result<()> {
    let command = Bench::augment_subcommands(clap::Command::new("bench"));
    for bench in command.get_subcommands() {
        let (name, about) = (bench.get_name(), bench.get_about().cloned().unwrap_or_default());
        if json {
            let line = serde_json::json!({ "bench": name, "about": about.to_string() });
            writeln!(out, "{line}")?;
        } else {
            writeln!(out, "{name:<10} {about}")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        bench: BenchArgs,
    }

    fn parse(line: &str) -> Result<BenchArgs, clap::Error> {
        Ok(Line::try_parse_from(line.split_whitespace())?.bench)
    }

    /// Runs a line of arguments; the objects that it prints.
    fn objects(line: &str) -> Vec<serde_json::Value> {
        let arguments = parse(line).expect(line);
        let bench = arguments.bench.expect("a name");
        let mut text = Vec::new();
        bench.run(&mut Printer::new(&mut text, bench.name(), true)).expect(line);
        let text = String::from_utf8(text).expect("text");
        text.lines().map(|line| serde_json::from_str(line).expect(line)).collect()
    }

    /// The values of one measure, one a case.
    fn values(objects: &[serde_json::Value], measure: &str) -> Vec<f64> {
        let of = |o: &serde_json::Value| o["measure"] == measure;
        objects.iter().filter(|o| of(o)).filter_map(|o| o["value"].as_f64()).collect()
    }

    fn have_the_shape(objects: &[serde_json::Value], bench: &str) {
        assert!(!objects.is_empty());
        for object in objects {
            assert_eq!(object["bench"], bench);
            for key in ["case", "measure", "unit", "machine"] {
                assert!(object[key].is_string(), "{key} of {object}");
            }
            assert!(object["value"].is_number(), "{object}");
            assert_eq!(object.get("target").is_some(), object.get("met").is_some(), "{object}");
        }
    }

    #[test]
    fn arguments_are_parsed_or_refused() {
        let geometry = parse("bench geometry --profile full --profile lite --r0 0.05 --json");
        let geometry = geometry.expect("good");
        assert!(geometry.json && matches!(geometry.bench, Some(Bench::Geometry(_))));
        assert!(parse("bench --json query").expect("json may come first").json);
        assert!(parse("bench").expect("no name lists them").bench.is_none());
        for line in ["bench attic", "bench geometry --r0 x", "bench corridor --times 1"] {
            assert!(parse(line).is_err(), "{line}");
        }
    }

    #[test]
    fn without_a_name_they_are_listed() {
        let mut text = Vec::new();
        list(&mut text, false).expect("listed");
        let text = String::from_utf8(text).expect("text");
        let names: Vec<&str> = text.lines().filter_map(|l| l.split_whitespace().next()).collect();
        let all = ["geometry", "map", "corridor", "query", "render", "ask", "language", "serve"];
        assert_eq!(names, [&all[..], &["planner"]].concat());
        assert!(text.lines().all(|line| line.len() > 30), "each with what it measures: {text}");
    }

    #[test]
    fn a_small_corridor_grows_and_gives_ratios() {
        let objects = objects("bench corridor --times 2 --width 48 --rounds 1");
        have_the_shape(&objects, "corridor");
        let [rows] = values(&objects, "map_size_ratio")[..] else { panic!("{objects:?}") };
        assert!(rows >= 2.0, "{rows}");
        assert_eq!(values(&objects, "frame_time_ratio").len(), 1);
        assert_eq!(values(&objects, "allocate_time_ratio").len(), 1);
    }

    #[test]
    fn a_small_query_gives_speeds_and_ratios() {
        let objects =
            objects("bench query --frames 2 --width 32 --steps 0 --rounds 1 --batch 100,200");
        have_the_shape(&objects, "query");
        // Profiles × threads × batches.
        assert_eq!(values(&objects, "points_per_second").len(), 8);
        assert_eq!(values(&objects, "points_per_processor_second").len(), 8);
        assert_eq!(values(&objects, "lite_against_full").len(), 2);
    }

    #[test]
    fn a_small_room_is_drawn_by_both_renderers() {
        let objects = objects(
            "bench render --frames 8 --width 48 --views 2 --rounds 1 --size 32x24 --backend cpu",
        );
        have_the_shape(&objects, "render");
        assert_eq!(values(&objects, "image_time").len(), 2, "one a renderer");
        assert_eq!(values(&objects, "depth_l1").len(), 2);
        assert_eq!(values(&objects, "psnr_against_ray").len(), 1);
        for line in
            ["bench render --size 32", "bench render --size 0x9", "bench render --size 9x9x"]
        {
            assert!(parse(line).is_err(), "{line}");
        }
    }

    #[test]
    fn a_small_room_is_drawn_on_a_gpu_as_on_the_cpu() {
        let line =
            "bench render --frames 8 --width 48 --views 2 --rounds 1 --size 48x40 --backend gpu";
        let objects = objects(line);
        have_the_shape(&objects, "render");
        assert_eq!(values(&objects, "image_time").len(), 3, "one a renderer");
        for measure in ["images_per_second", "draw_time", "map_upload", "epoch_upload"] {
            let [value] = values(&objects, measure)[..] else { panic!("{measure}: {objects:?}") };
            assert!(value > 0.0, "{measure}: {value}");
        }
        assert!(values(&objects, "psnr_against_cpu")[0] > 45.0, "{objects:?}");
        assert!(values(&objects, "depth_l1_against_cpu")[0] < 5e-5, "{objects:?}");
        assert!(values(&objects, "unknown_against_cpu")[0] < 2e-3, "{objects:?}");
    }

    #[test]
    fn a_small_house_is_asked_for_things() {
        let objects =
            objects("bench ask --frames 4 --width 64 --dimension 32 --patches 8 --repeat 2");
        have_the_shape(&objects, "ask");
        assert_eq!(values(&objects, "cost_of_language").len(), 1);
        assert!(values(&objects, "vertices")[0] > 500.0 && values(&objects, "atoms")[0] > 4.0);
        for measure in ["find", "points_10k", "image_heat"] {
            assert_eq!(values(&objects, measure).len(), 1, "{measure}");
        }
    }

    #[test]
    fn a_small_house_is_told_apart_by_codes_and_by_full_features() {
        let objects =
            objects("bench language --dimension 256 --frames 46 --views 6 --width 64 --json");
        have_the_shape(&objects, "language");
        let (maps, atoms) = (values(&objects, "map_3d"), values(&objects, "atoms"));
        assert_eq!((maps.len(), atoms.len()), (11, 11), "one a way to keep features");
        assert_eq!((atoms[0], atoms[2]), (256.0, 64.0), "all axes; as many atoms as there may be");
        assert!(maps.iter().all(|map| (0.0..=1.0).contains(map)), "{maps:?}");
        let cosines = values(&objects, "cosine");
        let [few, more, most, halves] = [2, 4, 6, 7].map(|row| cosines[row]);
        assert!(few < more && more <= most, "more atoms, more of a feature");
        assert!((most - halves).abs() < 1e-3, "halves are as good");
        assert!(cosines[8] < cosines[9] && cosines[9] < cosines[10], "so do more coefficients");
        let sizes = values(&objects, "bytes");
        assert!(sizes[2] < sizes[6] && sizes[7] < sizes[6] && sizes[8] < sizes[9], "{sizes:?}");
        let judged = objects.iter().filter(|o| o.get("met").is_some());
        let judged: Vec<&serde_json::Value> = judged.map(|o| &o["measure"]).collect();
        assert_eq!(judged, ["compression", "map_gain"], "the usual settings alone");
        assert_eq!(values(&objects, "overlapping_classes").len(), 1);
    }

    #[test]
    fn a_small_room_is_mapped_and_timed_by_stage() {
        let data = "synthetic:room:frames=3,width=32";
        let objects =
            objects(&format!("bench map --data {data} --room-frames 2 --width 32 --repeat 1"));
        have_the_shape(&objects, "map");
        assert_eq!(values(&objects, "frames_per_second").len(), 2);
        for stage in ["decode", "allocate", "publish"] {
            assert_eq!(values(&objects, &format!("{stage}_median")).len(), 2, "{stage}");
        }
        let judged: Vec<_> = objects.iter().filter(|o| o.get("met").is_some()).collect();
        assert_eq!(judged.len(), 1, "only the recording has a target: {judged:?}");
    }

    #[test]
    fn a_folder_that_is_missing_is_named() {
        let line = "bench geometry --data nowhere";
        let bench = parse(line).expect(line).bench.expect("a name");
        let mut text = Vec::new();
        let error = bench.run(&mut Printer::new(&mut text, bench.name(), true));
        assert!(error.expect_err(line).to_string().contains("nowhere"), "{line}");
    }
}
