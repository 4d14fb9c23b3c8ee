//! `orenx ask` and `orenx classify`, on a map of the synthetic room whose things have names.

use std::path::{Path, PathBuf};

use glam::Vec3;
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::numpy::{Archive, write_array};
use serde_json::Value;
use tempfile::TempDir;

use crate::server::{language::with_encoder, start};
use crate::support::command::{done, refused};
use crate::support::encoder::{room_words, words};

const ROOM: &str = "synthetic:room:frames=100,width=160";

/// A map of the room, and the encoder that its features came from.
struct Asked {
    folder: TempDir,
    words: TempDir,
}

impl Asked {
    fn new() -> Self {
        let asked = Self { folder: tempfile::tempdir().unwrap(), words: room_words() };
        std::fs::create_dir(asked.path("default")).unwrap();
        let (map, encoder) = (asked.name("default/map.orenx"), asked.encoder());
        done(&["map", ROOM, "--out", &map, "--stride", "4", "--steps", "0", "--encoder", &encoder]);
        asked
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    fn encoder(&self) -> String {
        format!("static:{}", self.words.path().display())
    }
}

/// Points of the surfaces that some frames show, and the classes of them.
fn seen() -> (Vec<Vec3>, Vec<String>) {
    let room = Synthetic::room(100).with_width(160);
    let (mut points, mut names) = (Vec::new(), Vec::new());
    for index in [0, 20, 40, 60, 80] {
        let frame = room.load(index, false).unwrap();
        let labels = room.labels(index).unwrap().unwrap();
        let places = labels.places();
        for v in (2..frame.depth.height - 2).step_by(5) {
            for u in (2..frame.depth.width - 2).step_by(5) {
                let at = (v * frame.depth.width + u) as usize;
                let z = frame.depth.at(u, v);
                if z > 0.0 && !frame.depth.is_edge(u, v) {
                    points.push(frame.world_point(u, v, z));
                    names.push(labels.classes[usize::from(places[at])].name.clone());
                }
            }
        }
    }
    (points, names)
}

fn vector(value: &Value) -> Vec3 {
    let numbers: Vec<f32> =
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect();
    Vec3::from_slice(&numbers)
}

fn size_of(path: &Path) -> (u32, u32) {
    let image = image::open(path).unwrap();
    (image.width(), image.height())
}

fn asked_for_a_seat(asked: &Asked) {
    let (map, encoder) = (asked.name("default/map.orenx"), asked.encoder());
    let (heat, top) = (asked.name("heat.png"), asked.name("top.png"));
    let json: Value = serde_json::from_str(&done(&[
        "ask",
        &map,
        "seat",
        "--encoder",
        &encoder,
        "--json",
        "--top",
        "3",
        "--heat",
        &heat,
        "--top-view",
        &top,
        "--size",
        "160x120",
    ]))
    .unwrap();
    let matches = json["matches"].as_array().unwrap();
    assert!((1..=3).contains(&matches.len()), "{json}");
    assert!(json["milliseconds"].as_f64().unwrap() > 0.0);
    let best = &matches[0];
    let (points, names) = seen();
    let chair: Vec<Vec3> =
        points.iter().zip(&names).filter(|(_, n)| *n == "chair").map(|(p, _)| *p).collect();
    let middle = chair.iter().sum::<Vec3>() / chair.len() as f32;
    let found = vector(&best["centroid_m"]);
    assert!(found.distance(middle) < 0.4, "a chair at {middle}: {best}");
    assert!(vector(&best["extent_m"]).max_element() < 1.5, "{best}");
    assert!(best["score"].as_f64().unwrap() > 0.9 && best["voxels"].as_u64().unwrap() >= 4);
    for image in ["heat.png", "top.png"] {
        assert_eq!(size_of(&asked.path(image)), (160, 120));
        let rgb = image::open(asked.path(image)).unwrap().into_rgb8();
        let warm = rgb.pixels().filter(|p| i32::from(p[0]) > i32::from(p[2]) + 90).count();
        assert!((10..160 * 60).contains(&warm), "{image}: {warm} warm pixels");
    }
    let text = done(&["ask", &map, "seat", "--encoder", &encoder]);
    assert!(text.contains(" found in ") && text.contains("\n  1  "), "{text}");
    let none = ["ask", &map, "seat", "--encoder", &encoder, "--min-score", "1"];
    assert!(done(&none).starts_with("0 found in"));
    let cosines = done(&["ask", &map, "seat", "--encoder", &encoder, "--no-negatives", "--json"]);
    let cosines: Value = serde_json::from_str(&cosines).unwrap();
    let cosine = cosines["matches"][0]["score"].as_f64().unwrap();
    assert!((cosine - 0.98).abs() < 0.02, "the cosine of a seat and a chair is 0.98: {cosine}");
}

fn classified(asked: &Asked) {
    let (map, encoder) = (asked.name("default/map.orenx"), asked.encoder());
    let (points, names) = seen();
    let classes = ["table", "chair", "bed", "wardrobe", "wall", "floor", "couch"];
    std::fs::write(asked.path("classes.txt"), classes.join("\n")).unwrap();
    let mut file = Vec::new();
    let flat: &[f32] = bytemuck::cast_slice(&points);
    write_array(&mut file, &[points.len(), 3], flat).unwrap();
    std::fs::write(asked.path("points.npy"), file).unwrap();
    let out = asked.name("classes.npz");
    done(&[
        "classify",
        &map,
        "--points",
        &asked.name("points.npy"),
        "--classes",
        &asked.name("classes.txt"),
        "--out",
        &out,
        "--encoder",
        &encoder,
    ]);
    let file = std::fs::File::open(&out).unwrap();
    let mut archive = Archive::new(file, "classes.npz").unwrap();
    let class: Vec<i32> = archive.array("class").unwrap().into_values().unwrap();
    let score: Vec<f32> = archive.array("score").unwrap().into_values().unwrap();
    assert_eq!((class.len(), score.len()), (points.len(), points.len()));
    assert!(class.iter().zip(&score).all(|(c, s)| (*c < 0) == s.is_nan()));
    let truth = names.iter().map(|name| classes.iter().position(|class| class == name));
    let listed: Vec<(i32, usize)> =
        class.iter().zip(truth).filter_map(|(c, t)| Some((*c, t?))).collect();
    // Where small images left a code at all.
    let known = listed.iter().filter(|(c, _)| *c >= 0).count();
    let right = listed.iter().filter(|(c, t)| *c == *t as i32).count();
    let all = listed.len();
    assert!(known * 2 > all && right * 10 > known * 8, "{right} of {known} of {all}");
}

#[test]
fn what_is_asked_for_in_words_is_found_drawn_and_classified() {
    let asked = Asked::new();
    asked_for_a_seat(&asked);
    classified(&asked);
}

#[test]
fn what_cannot_be_asked_says_what_to_do() {
    let asked = Asked::new();
    let (map, encoder) = (asked.name("default/map.orenx"), asked.encoder());
    refused(&["ask", &map, "seat"], "static:FOLDER or onnx:FOLDER");
    refused(&["ask", &map, "seat"], "'static:words:");
    let other = words();
    let other = format!("static:{}", other.path().display());
    refused(&["ask", &map, "seat", "--encoder", &other], "8 numbers of the encoder");
    refused(&["ask", &map, "nowhere", "--encoder", &encoder], "prompts[0]: has no word");
    refused(&["ask", &map, "seat", "--encoder", "clip:x"], "static:FOLDER");
    refused(&["ask", &map, "seat", "--encoder", &encoder, "--min-score", "2"], "min_score: 2");
    let plain = asked.name("plain.orenx");
    done(&["map", ROOM, "--out", &plain, "--frames", "0..2", "--steps", "0"]);
    refused(&["ask", &plain, "seat", "--encoder", &encoder], "has no language");
    std::fs::write(asked.path("classes.txt"), "\n").unwrap();
    let points = asked.name("points.npy");
    refused(
        &[
            "classify",
            &map,
            "--points",
            &points,
            "--classes",
            &asked.name("classes.txt"),
            "--out",
            &asked.name("x.npz"),
            "--encoder",
            &encoder,
        ],
        "line 1 is empty",
    );
}

/// A server that holds the file says the same, in its own words and in those of the caller.
#[tokio::test(flavor = "multi_thread")]
async fn a_server_says_what_its_file_says() {
    let asked = Asked::new();
    let (map, encoder) = (asked.name("default/map.orenx"), asked.encoder());
    let server = start(|settings| {
        with_encoder(settings, asked.words.path());
        settings.storage.path = asked.folder.path().into();
    })
    .await;
    let urls = [server.url.replace("http", "grpc"), format!("http://{}", server.http)];
    let heat = asked.name("heat.png");
    let compared = tokio::task::spawn_blocking(move || {
        let matches = |arguments: &[&str]| -> Value {
            let mut json: Value = serde_json::from_str(&done(arguments)).unwrap();
            let matches = json["matches"].as_array_mut().unwrap();
            // JSON rounds numbers of double precision in their last digit.
            matches.iter_mut().for_each(|found| found["best_view"] = Value::Null);
            json["matches"].clone()
        };
        let ask = |map: &str, more: &[&str]| {
            let drawn = ["ask", map, "seat", "--json", "--heat", &heat, "--size", "80x60"];
            let matches = matches(&[&drawn, more].concat());
            (matches, image::open(&heat).unwrap().into_rgb8().into_raw())
        };
        let of_file = ask(&map, &["--encoder", &encoder]);
        assert!(!of_file.0.as_array().unwrap().is_empty());
        for url in &urls {
            assert_eq!(ask(url, &[]), of_file, "{url}");
            assert_eq!(ask(url, &["--encoder", &encoder]), of_file, "{url}");
        }
    });
    compared.await.unwrap();
    server.stop().await.0.unwrap();
}
