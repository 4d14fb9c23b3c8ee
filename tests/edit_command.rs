//! `orenx edit`, and `--map` of what asks a server: what one of its maps was told is there, in that map
//! alone, until it is cleared.

use std::path::Path;

use glam::Vec3;
use orenx::map::TriangleMesh;
use orenx::numpy::write_array;

use crate::server::start;
use crate::support::command::{done, refused};

const ROOM: &str = "synthetic:room:frames=4,width=96";

/// The numbers of a line, in order.
fn counts(line: &str) -> Vec<u64> {
    let words = line.split(|c: char| !c.is_ascii_digit()).filter(|word| !word.is_empty());
    words.map(|word| word.parse().unwrap()).collect()
}

/// A pyramid around (4, 4, 1) as a PLY file.
fn pyramid(path: &Path) -> String {
    let corners = [[3.5, 3.5, 0.5], [4.5, 3.5, 0.5], [4.0, 4.5, 0.5], [4.0, 4.0, 1.6]];
    let mesh = TriangleMesh {
        vertices: corners.map(Vec3::from).to_vec(),
        normals: Vec::new(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    };
    mesh.write_ply(&mut std::fs::File::create(path).unwrap()).unwrap();
    path.to_str().unwrap().to_owned()
}

fn edit_one_map(folder: &Path, grpc: &str, http: &str) {
    let ask = |at: &str, url: &str, map: &str| {
        done(&["query", url, "--point", at, "--map", map])
            .split("state ")
            .nth(1)
            .map(|rest| rest.split_whitespace().next().unwrap().to_owned())
            .unwrap()
    };
    let states = |at: &str| {
        let [there, again] = [grpc, http].map(|url| ask(at, url, "yard"));
        assert_eq!(there, again);
        assert_eq!(ask(at, grpc, "default"), "unknown");
        there
    };
    let edit = |words: &[&str]| done(&[&["edit", grpc], words, &["--map", "yard"]].concat());

    assert_eq!(states("4,4,1"), "unknown");
    let mesh = pyramid(&folder.join("pyramid.ply"));
    let line = edit(&["stamp", "--mesh", &mesh, "--color", "1,0.5,0"]);
    let [epoch, removed, added, forgotten, told] = counts(&line)[..] else { panic!("{line}") };
    assert!(line.starts_with("map 'yard' from epoch ") && epoch > 0, "{line}");
    assert!(removed == 0 && added > 100 && forgotten == 0 && told > 100, "{line}");
    assert_eq!(states("4,4,1"), "occupied");

    let grid = folder.join("grid.npz").to_str().unwrap().to_owned();
    let planner = ["planner", "grid", grpc, "--voxel", "0.1", "--out", &grid, "--map", "yard"];
    let [x, y, z] = counts(&done(&planner))[..] else { panic!("a grid") };
    assert!(x.min(y) > 9 && x.max(y).max(z) < 30, "the box of the yard: {x} {y} {z}");
    let view = folder.join("view").to_str().unwrap().to_owned();
    done(&["render", http, "--orbit", "1", "--size", "64x48", "--out", &view, "--map", "yard"]);

    let points = folder.join("points.npy");
    let mut file = std::fs::File::create(&points).unwrap();
    write_array(&mut file, &[3, 3], &[4.0f32, 4.0, 1.0, 4.0, 4.0, 0.6, 40.0, 4.0, 1.0]).unwrap();
    let (points, out) = (points.to_str().unwrap(), folder.join("answers.npz"));
    let out = out.to_str().unwrap();
    let line = done(&["query", grpc, "--points", points, "--out", out, "--map", "yard"]);
    assert_eq!(line, format!("{out}: 3 points, 2 known\n"));

    edit(&["stamp", "--free", "--box", "7.5,-0.5,0.5,6.5,0.5,1.5"]);
    assert_eq!(states("7,0,1"), "free");
    edit(&["stamp", "--sphere", "-4,-4,1,0.5", "--robot", "gardener"]);
    assert_eq!(states("-4,-4,1"), "occupied");
    let line = edit(&["clear", "--robot", "gardener"]);
    assert!(counts(&line)[1] > 100, "{line}");
    assert_eq!((states("-4,-4,1"), states("4,4,1")), ("unknown".into(), "occupied".into()));
    edit(&["clear", "--box", "6,-1,0,8,1,2"]);
    assert_eq!(states("7,0,1"), "unknown");
    edit(&["clear", "--sphere", "4,4,1,2"]);
    assert_eq!(states("4,4,1"), "unknown");

    // Told by the clock of the frames, which come 1/30 s apart.
    done(&["stream", ROOM, grpc, "--map", "yard"]);
    let line = edit(&["clear", "--older-than", "0.5"]);
    assert_eq!(counts(&line)[1], 0, "{line}");
    let line = edit(&["clear", "--older-than", "0.04"]);
    assert!(counts(&line)[1] > 100, "{line}");
}

fn refuse(folder: &Path, grpc: &str) {
    for (words, part) in [
        (&["clear"][..], "required"),
        (&["clear", "--sphere", "0,0,1"], "4 numbers"),
        (&["clear", "--sphere", "0,0,0,0"], "sphere.radius_m"),
        (&["clear", "--robot", "nobody"], "robot 'nobody'"),
        (&["clear", "--older-than", "-1"], "--older-than"),
        (&["stamp"], "required"),
        (&["stamp", "--box", "0,0,0,1,1,0"], "box.size_m"),
        (&["stamp", "--sphere", "0,0,0,1", "--color", "2,0,0"], "color"),
        (&["stamp", "--mesh", "gone.ply"], "gone.ply"),
        (&["stamp", "--sphere", "0,0,0,1", "--map", "nowhere"], "nowhere"),
    ] {
        refused(&[&["edit", grpc], words].concat(), part);
    }
    let map = folder.join("one.orenx").to_str().unwrap().to_owned();
    done(&["map", ROOM, "--out", &map, "--steps", "0"]);
    refused(&["query", &map, "--point", "0,0,1", "--map", "yard"], "map: is for servers");
    refused(&["query", grpc, "--point", "0,0,1", "--map", "nowhere"], "nowhere");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_one_map_was_told_is_in_it_alone_until_it_is_cleared() {
    let server = start(|_| {}).await;
    server.client.create_map("yard", []).await.unwrap();
    let (grpc, http) = (server.url.replace("http", "grpc"), format!("http://{}", server.http));
    let called = move || {
        let folder = tempfile::tempdir().unwrap();
        edit_one_map(folder.path(), &grpc, &http);
        refuse(folder.path(), &grpc);
    };
    tokio::task::spawn_blocking(called).await.unwrap();
    server.stop().await.0.unwrap();
}
