//! `orenx bench serve` against a server of its own. What it measures is not judged here.

use std::process::Command;

#[test]
fn a_small_load_is_measured_on_every_path() {
    let arguments = "bench serve --json --data synthetic:room:frames=6,width=48 --rounds 2 \
                     --cycle-ms 1 --pipeline-s 1 --soak-s 0";
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
    assert_eq!((medians.len(), tails.len()), (4, 4), "{text}");
    for (median, tail) in medians.iter().zip(tails) {
        let ms = |figure: &serde_json::Value| figure["value"].as_f64().unwrap();
        assert!(0.0 < ms(median) && ms(median) <= ms(tail), "{median} {tail}");
        assert!(tail["target"].is_number() && tail["met"].is_boolean(), "{tail}");
    }
    let speed = of("points_per_second")[0];
    assert!(speed["value"].as_f64().unwrap() > 0.0, "{speed}");
    assert_eq!(of("visible_p95").len(), 1);
    assert!(text.contains("frames_lost_of_"), "{text}");
}
