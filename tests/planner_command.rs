//! `orenx planner`: a map file and the server that loaded it answer the same.

use std::path::Path;

use orenx::numpy::{Archive, write_array};

use crate::server::start;
use crate::support::command::{done, refused};

const ROOM: &str = "synthetic:room:frames=60,width=96";

/// Numbers that differ from each other, within ±1.
fn number(i: usize) -> f32 {
    (i as f32 * 0.7311).sin()
}

fn save(path: &Path, shape: &[usize], values: &[f32]) -> String {
    let mut file = std::fs::File::create(path).unwrap();
    write_array(&mut file, shape, values).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Names of columns, and how many numbers each has.
type Columns = Vec<(&'static str, usize)>;

/// The inputs of every verb, and the arrays of its answer with their widths.
fn verbs(folder: &Path) -> Vec<(Vec<String>, Columns)> {
    let text = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
    let points: Vec<f32> =
        (0..600).map(|i| number(i) * 2.0 + f32::from(u8::from(i % 3 == 2))).collect();
    let spheres: Vec<f32> = points.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 0.15]).collect();
    let rays: Vec<f32> = (0..100)
        .flat_map(|i| [0.5, 0.4, 1.2, number(3 * i), number(3 * i + 1), number(3 * i + 2)])
        .collect();
    let poses: Vec<f32> = (0..40)
        .flat_map(|i| [number(i) * 2.0, number(i + 50) * 1.5, 1.2, 0.0, 0.0, 0.0, 1.0])
        .collect();
    let body = save(&folder.join("body.npy"), &[1, 4], &[0.0, 0.0, 0.0, 0.2]);
    let points = save(&folder.join("points.npy"), &[200, 3], &points);
    let spheres = save(&folder.join("spheres.npy"), &[200, 4], &spheres);
    let rays = save(&folder.join("rays.npy"), &[100, 6], &rays);
    let poses = save(&folder.join("poses.npy"), &[8, 5, 7], &poses);
    let numbers = |names: &[&'static str]| names.iter().map(|name| (*name, 1)).collect::<Vec<_>>();
    vec![
        (text(&["spheres", "--spheres", &spheres]), vec![("clearance", 1), ("gradient", 3)]),
        (
            text(&["trajectories", "--poses", &poses, "--spheres", &body, "--swept"]),
            numbers(&["min_clearance", "min_fraction", "hit_fraction"]),
        ),
        (
            text(&["rays", "--rays", &rays, "--range", "5"]),
            vec![("distance", 1), ("normal", 3), ("unknown_at", 1)],
        ),
        (
            text(&["nearest", "--points", &points, "--unknown", "1"]),
            vec![("surface", 3), ("distance", 1), ("unknown_distance", 1)],
        ),
        (text(&["grid", "--box", "-1,-1,0.5,1,1,0.6", "--voxel", "0.1"]), numbers(&["origin"])),
    ]
}

/// The bits of some arrays.
fn arrays(path: &Path, names: &[(&str, usize)]) -> Vec<Vec<u32>> {
    let file = std::fs::File::open(path).unwrap();
    let mut archive = Archive::new(file, "answers").unwrap();
    let mut read = |(name, width): &(&str, usize)| -> Vec<u32> {
        let numbers: Vec<f32> = archive.rows(name, *width).unwrap();
        assert!(!numbers.is_empty() && numbers.iter().any(|n| n.is_finite()), "{name}");
        numbers.iter().map(|n| n.to_bits()).collect()
    };
    names.iter().map(&mut read).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_answers_as_the_server_that_loaded_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("default")).unwrap();
    let map = folder.path().join("default/map.orenx").to_str().unwrap().to_owned();
    let path = map.clone();
    let mapped = move || done(&["map", ROOM, "--out", &path, "--stride", "6", "--steps", "2"]);
    tokio::task::spawn_blocking(mapped).await.unwrap();
    let server = start(|settings| settings.storage.path = folder.path().into()).await;
    let url = server.url.replace("http", "grpc");
    let at = folder.path().to_owned();
    let compared = tokio::task::spawn_blocking(move || {
        for (words, names) in verbs(&at) {
            let answers = |source: &str, out: &str| {
                let out = at.join(out);
                let mut line = vec!["planner", &words[0], source];
                line.extend(words[1..].iter().map(String::as_str));
                line.extend(["--out", out.to_str().unwrap()]);
                done(&line);
                (std::fs::read(&out).unwrap().len(), arrays(&out, &names))
            };
            assert_eq!(answers(&map, "file.npz"), answers(&url, "server.npz"), "{words:?}");
        }
        let grid = std::fs::File::open(at.join("file.npz")).unwrap();
        let mut grid = Archive::new(grid, "grid").unwrap();
        assert_eq!(grid.array("state").unwrap().shape(), [1, 20, 20]);
        assert_eq!(grid.array("color").unwrap().shape(), [1, 20, 20, 3]);
        let points = at.join("points.npy").to_str().unwrap().to_owned();
        let out = at.join("none.npz").to_str().unwrap().to_owned();
        let wrong = |words: &[&str], part: &str| {
            refused(&[words, &["--out", &out]].concat(), part);
            assert!(!Path::new(&out).exists());
        };
        wrong(&["planner", "spheres", &map, "--spheres", &points], "(N, 4)");
        wrong(&["planner", "rays", &map, "--rays", &points], "(N, 6)");
        wrong(&["planner", "grid", &map, "--voxel", "0"], "voxel_m");
        wrong(
            &["planner", "nearest", &map, "--points", &points, "--unknown", "9"],
            "max_unknown_m",
        );
        wrong(&["planner", "grid", "zenoh+tcp/x:1"], "gRPC");
    });
    compared.await.unwrap();
    server.stop().await.0.unwrap();
}
