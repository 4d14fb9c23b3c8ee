//! `orenx bench serve` and `planner` against servers of their own. What they measure is not judged here.

use std::process::Command;

#[test]
fn a_small_load_is_measured_on_every_path() {
    let arguments = "bench serve --json --data synthetic:room:frames=6,width=48 --rounds 2 \
                     --cycle-ms 1 --pipeline-s 1 --soak-s 4 --width 64 --clients 9 --client-cycle-ms 20";
    let output = Command::new(env!("CARGO_BIN_EXE_orenx"))
        .args(arguments.split_whitespace())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let figures: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |measure: &str| figures.iter().filter(|f| f["measure"] == measure).collect::<Vec<_>>();
    let (medians, tails) = (of("median"), of("p99"));
    assert_eq!(medians.len(), 4, "{text}");
    for (median, tail) in medians.iter().zip(tails) {
        let ms = |figure: &serde_json::Value| figure["value"].as_f64().unwrap();
        assert!(0.0 < ms(median) && ms(median) <= ms(tail), "{median} {tail}");
        assert!(tail["target"].is_number() && tail["met"].is_boolean(), "{tail}");
    }
    let speed = of("points_per_second")[0];
    assert!(speed["value"].as_f64().unwrap() > 0.0, "{speed}");
    assert_eq!(of("visible_p95").len(), 1);
    assert!(text.contains("frames_lost_of_"), "{text}");
    let (answers, p99) = (of("answers"), of("p99"));
    assert_eq!((answers.len(), p99.len()), (9, 4 + 9), "one a verb of many clients: {text}");
    for (asked, refused) in answers.iter().zip(of("refused")) {
        assert!(asked["value"].as_f64() > Some(0.0), "{asked}");
        assert_eq!(refused["value"].as_f64(), Some(0.0), "{refused}");
    }
}

#[test]
fn the_loads_of_planners_are_timed_over_grpc_and_in_process() {
    let arguments = "bench planner --json --rounds 2 --cycle-ms 1 --frames 30 --width 64";
    let output = Command::new(env!("CARGO_BIN_EXE_orenx"))
        .args(arguments.split_whitespace())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let figures: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let medians = figures.iter().filter(|f| f["measure"] == "median");
    let judged = medians.clone().filter(|f| f["target"].is_number()).count();
    assert_eq!((medians.count(), judged), (8, 6), "{text}");
    assert!(figures.iter().all(|f| f["value"].as_f64().unwrap() > 0.0), "{text}");
}
