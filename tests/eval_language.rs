//! `orenx eval` on a labelled house: classes at surfaces and in unseen views, and what it refuses.

use std::fs;
use std::path::{Path, PathBuf};

use orenx::dataset::synthetic::Synthetic;
use orenx::geometry::random::{normal, pcg4d};
use serde_json::Value;

use crate::support::command::{done, refused};
use crate::support::{encoder, recording};

/// A folder with a map of a part of the house, labelled views, and two encoders.
struct House(tempfile::TempDir);

impl House {
    fn new() -> Self {
        let house = Self(tempfile::tempdir().unwrap());
        let data = Synthetic::house(200).with_width(160);
        let classes = data.scene(0).classes().clone();
        let words: Vec<&str> = classes.iter().map(|class| class.name.as_str()).collect();
        encoder::write(&house.path("words"), &scattered(&words, 1));
        encoder::write(&house.path("others"), &scattered(&words, 2));
        recording::write(&data, &house.path("truth"), &[0, 10, 20, 30]);
        recording::write(&data, &house.path("truth/novel"), &[5, 13, 25]);
        house
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    fn encoder(&self, name: &str) -> String {
        format!("static:{}", self.name(name))
    }

    fn map(&self, name: &str, extra: &[&str]) -> String {
        let map = self.name(name);
        let data = "synthetic:house:frames=200,width=160";
        let few = ["map", data, "--out", &map, "--frames", "0..32", "--stride", "2"];
        done(&[&few[..], &["--steps", "0", "--modalities", "sdf,language"], extra].concat());
        map
    }

    /// The report of `orenx eval`, and what it printed.
    fn judge(&self, map: &str, extra: &[&str]) -> (Value, String) {
        let (truth, report) = (self.name("truth"), self.name("report.json"));
        let few = ["eval", map, "--truth", &truth, "--report", &report];
        let printed = done(&[&few[..], extra].concat());
        (serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap(), printed)
    }
}

/// Words that point anywhere; another `seed`, elsewhere.
fn scattered<'a>(words: &[&'a str], seed: u32) -> Vec<(&'a str, Vec<f32>)> {
    let number = |word: usize, i: u32| {
        let random = pcg4d([seed, word as u32, 0, i]);
        normal(random[0], random[1])
    };
    let row = |(i, word): (usize, &&'a str)| (*word, (0..96).map(|k| number(i, k)).collect());
    words.iter().enumerate().map(row).collect()
}

fn number(language: &Value, key: &str) -> f64 {
    language[key].as_f64().unwrap_or_else(|| panic!("{key} in {language}"))
}

/// Writes every label of a folder anew.
fn relabel(folder: &Path, id: impl Fn(u16) -> u16) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.to_str().unwrap().ends_with(".label.png") {
            let mut image = image::open(&path).unwrap().into_luma16();
            image.pixels_mut().for_each(|pixel| pixel.0[0] = id(pixel.0[0]));
            image.save(&path).unwrap();
        }
    }
}

#[test]
fn classes_of_a_labelled_house_are_judged() {
    let house = House::new();
    let words = house.encoder("words");
    let map = house.map("house.orenx", &["--encoder", &words]);
    let (report, printed) = house.judge(&map, &["--encoder", &words]);
    let language = &report["language"];
    // Sixteen small frames say nothing of a part of what they see from afar.
    for (key, least) in [
        ("miou_3d", 0.9),
        ("macc_3d", 0.94),
        ("map_3d", 0.95),
        ("known_share_3d", 0.7),
        ("miou_2d", 0.75),
        ("macc_2d", 0.84),
        ("map_2d", 0.8),
        ("known_share_2d", 0.7),
        ("cosine", 0.95),
    ] {
        let value = number(language, key);
        assert!((least..=1.0).contains(&value), "{key} is {value}: {language}");
    }
    let (classes, atoms) = (number(language, "classes"), number(language, "atoms"));
    assert!(classes >= 10.0 && (10.0..=29.0).contains(&atoms), "{language}");
    assert!(number(language, "bytes") > 10_000.0);
    assert!(printed.contains("mIoU [%]") && report.get("images").is_none(), "{printed}");

    // Who says that every class is another one finds hardly anything right.
    for folder in ["truth", "truth/novel"] {
        relabel(&house.path(folder), |id| if id == 0 { 0 } else { 1 + id % 29 });
    }
    let (report, _) = house.judge(&map, &["--encoder", &words]);
    assert!(number(&report["language"], "miou_3d") < 0.1, "{report}");
    assert!(number(&report["language"], "map_2d") < 0.3, "{report}");
}

#[test]
fn another_encoder_is_refused_and_none_judges_no_classes() {
    let house = House::new();
    let words = house.encoder("words");
    let map = house.map("house.orenx", &["--encoder", &words]);
    let truth = house.name("truth");
    let others = house.encoder("others");
    refused(&["eval", &map, "--truth", &truth, "--encoder", &others], "static:words");
    let (report, _) = house.judge(&map, &[]);
    assert!(report.get("language").is_none(), "{report}");
    // Neither is a map judged that knows no language.
    let plain = house.map("plain.orenx", &[]);
    let (report, _) = house.judge(&plain, &["--encoder", &words]);
    assert!(report.get("language").is_none(), "{report}");
    fs::write(house.path("truth/novel/labels.json"), "{}").unwrap();
    refused(&["eval", &map, "--truth", &truth, "--encoder", &words], "labels.json");
}
