//! A wall that was seen everywhere has a surface everywhere.

use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_4, TAU};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use orenx::config::{MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::{Renderer, Scene, SceneBuilder, Synthetic};
use orenx::geometry::{Aabb, Intrinsics, Pose};
use orenx::map::{MapView, Mapper, MeshFormat, TriangleMesh, WholeMesh, extract_mesh, query_pool};

/// An empty room; its walls lie in planes of the lattice if `low` is a point of it.
fn shell(low: Vec3) -> Scene {
    SceneBuilder::new(Aabb { min: low, max: low + Vec3::new(3.0, 2.4, 2.2) }).build()
}

/// Looks around twice from the middle.
fn map_of(scene: &Scene, r0_m: f32) -> Arc<MapView> {
    let settings = MapSettings { steps: Some(0), r0_m, ..MapSettings::default() };
    let mut mapper = Mapper::new(MapConfig::from_settings(&settings).unwrap()).unwrap();
    let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 79.5, cy: 59.5, width: 160, height: 120 };
    let (first, draw) = (Synthetic::room(1).load(0, false).unwrap(), Renderer::default());
    let middle = (0.5 * (scene.room().min + scene.room().max)).as_dvec3();
    for i in 0..48i32 {
        let (yaw, pitch) = (TAU * f64::from(i) / 8.0 + 0.1, FRAC_PI_4 * f64::from(i / 8 % 3 - 1));
        let gaze = DVec3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), 1.3 * pitch.sin());
        let eye = middle + DVec3::new(0.3 * yaw.sin(), 0.2, if i < 24 { 0.2 } else { -0.3 });
        let world_from_camera = Pose::looking_at(eye, eye + gaze, DVec3::Z);
        let depth = draw.depth(scene, &intrinsics, &world_from_camera, 10.0);
        let (seq, stamp_ns) = (i as u64, i64::from(i + 1) * 33_333_333);
        let frame = orenx::frame::Frame {
            seq,
            stamp_ns,
            world_from_camera,
            intrinsics,
            depth,
            ..first.clone()
        };
        mapper.integrate(&frame).unwrap();
    }
    mapper.publish()
}

/// Edges with a triangle on one side alone.
fn open_edges(mesh: &TriangleMesh) -> Vec<Vec3> {
    let edges = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let all: BTreeSet<(u32, u32)> = mesh.triangles.iter().flat_map(edges).collect();
    let open = all.iter().filter(|(a, b)| !all.contains(&(*b, *a)));
    open.map(|(a, b)| 0.5 * (mesh.vertices[*a as usize] + mesh.vertices[*b as usize])).collect()
}

/// Whether a point of one wall is away from all others. Where walls meet they are seen at a slant, a few
/// pixels wide.
fn is_well_inside(room: &Aabb, point: Vec3) -> bool {
    let mut away = (point - room.min).abs().min((room.max - point).abs()).to_array();
    away.sort_by(f32::total_cmp);
    away[1] > 0.15
}

fn whole(view: &Arc<MapView>, resolution_m: f32) -> TriangleMesh {
    let whole = WholeMesh::new(view.clone(), resolution_m).unwrap();
    let parts = (0..whole.parts()).map(|i| whole.part(i).unwrap()).collect();
    TriangleMesh::read_ply(&WholeMesh::file(parts, MeshFormat::Ply)[..], "mesh.ply").unwrap()
}

#[test]
fn a_room_seen_from_inside_is_closed_at_every_resolution() {
    let pool = query_pool(2).unwrap();
    // Walls in planes of the lattice, off them, and with cells larger than what is known of a wall.
    for (low, r0_m) in [
        (Vec3::new(-1.5, -1.2, 0.0), 0.1),
        (Vec3::new(-1.463, -1.219, 0.071), 0.1),
        (Vec3::new(-1.6, -1.2, 0.0), 0.2),
    ] {
        let scene = shell(low);
        let view = map_of(&scene, r0_m);
        for resolution_m in [r0_m, r0_m / 2.0, r0_m / 4.0] {
            let all = extract_mesh(&*view, &view.surface_leaves(), resolution_m, &pool).unwrap();
            let pieces = whole(&view, resolution_m);
            for (mesh, of) in [(all, "leaves"), (pieces, "pieces")] {
                let what = format!("{low}, r0 {r0_m} at {resolution_m}, of {of}");
                let open = open_edges(&mesh);
                let hole = open.iter().find(|at| is_well_inside(&scene.room(), **at));
                assert!(hole.is_none(), "{what}: a hole at {hole:?}");
                assert!(mesh.triangles.len() > 3000 && open.len() * 500 < mesh.triangles.len());
            }
        }
    }
}
