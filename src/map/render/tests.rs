//! Images of closed forms, whose depth and normals are known.

mod on_gpu;

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::*;
use crate::config::{MapConfig, MapSettings, Profile};
use crate::geometry::{Intrinsics, Pose};
use crate::map::pages::PageTable;
use crate::map::query_pool;
use crate::map::view::{BrickPage, NODES, Node, ROWS, Store};
use crate::modality::{Decoders, Row, occupancy, sdf};
use crate::octree::{Explicit, NO_BLOCK, NO_NODE, NO_ROW, NodeSource, Topology, cell_of};
use crate::surface::Lattice;

const R0_M: f32 = 0.1;

/// A view of a closed form: voxels of level 0 within 0.25 m of its surface, exact at their corners,
/// and all of them observed.
fn view_of(half_m: f32, field: impl Fn(Vec3) -> Explicit) -> MapView {
    view_in(Profile::Lite, half_m, field)
}

/// The same; in the profile `full` some voxels have some of their children.
fn view_in(profile: Profile, half_m: f32, field: impl Fn(Vec3) -> Explicit) -> MapView {
    let settings = MapSettings { profile, ..MapSettings::default() };
    let config = MapConfig::from_settings(&settings).expect("good");
    let lattice = Lattice::new(&config);
    let mut topology = Topology::new(lattice.unit_m, lattice.brick);
    let cells = (half_m / R0_M) as i32;
    for z in -cells..cells {
        for y in -cells..cells {
            for x in -cells..cells {
                let centre = (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * R0_M;
                // Larger voxels elsewhere, as space that was seen free has.
                let log2 = lattice.r0 + u8::from(field(centre)[0].abs() > 0.25);
                let cell = cell_of(centre, 1.0 / lattice.unit_m);
                topology.insert(cell, log2).expect("fits");
                if (x * 7 + y * 5 + z * 3).rem_euclid(4) == 0 {
                    topology.insert(cell, log2 - lattice.r0).expect("fits");
                }
            }
        }
    }
    let mut store = Store::new(&config);
    store.root = topology.root();
    store.node_slots = topology.node_slots();
    store.nodes.grow(topology.node_slots().div_ceil(NODES));
    for node in 0..topology.node_slots() {
        let page = store.nodes.write(node / NODES);
        let id = node as u32;
        page.children[node % NODES] = topology.children(id);
        let corners = *topology.corners(id);
        page.nodes[node % NODES] = Node {
            corners,
            brick: if corners[0] == NO_ROW { NO_NODE } else { 0 },
            block: NO_BLOCK,
            code_block: NO_BLOCK,
            low: topology.low_corner(id),
            log2_size: topology.log2_size(id),
        };
    }
    store.rows.grow(topology.rows().div_ceil(ROWS));
    for (row, at) in topology.positions().iter().enumerate() {
        store.rows.write(row / ROWS).rows[row % ROWS] =
            Row { explicit: field(*at), ..Row::default() };
    }
    let mut bricks = PageTable::<BrickPage>::default();
    bricks.grow(1);
    bricks.write(0).known[0] = [u64::MAX; 8];
    store.bricks = bricks;
    let decoders = Decoders {
        sdf: sdf::decoder(&config.hidden, 0).expect("a decoder"),
        occupancy: occupancy::decoder(0).expect("a decoder"),
    };
    let (config, decoders) = (Arc::new(config), Arc::new(decoders));
    MapView { epoch: 1, newest_stamp_ns: 0, config, decoders, store, viewpoints: Arc::default() }
}

fn camera(eye: DVec3, target: DVec3, width: u32, height: u32) -> Camera {
    let centre = |side: u32| (f64::from(side) - 1.0) * 0.5;
    let (cx, cy) = (centre(width), centre(height));
    let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx, cy, width, height };
    let camera = Camera { world_from_camera: Pose::looking_at(eye, target, DVec3::Z), intrinsics };
    camera.check().expect("good");
    camera
}

fn settings(renderer: Renderer) -> RenderSettings {
    RenderSettings { renderer, ..RenderSettings::default() }
}

const RENDERERS: [Renderer; 2] = [Renderer::Tile, Renderer::Ray];

fn draw(view: &MapView, camera: &Camera, renderer: Renderer) -> Rendering {
    let pool = query_pool(2).expect("threads");
    let never = || false;
    render(view, camera, Channels::ALL, &settings(renderer), &pool, &never).expect("not stopped")
}

/// Calls `check` with depth and normal of each pixel, and its ray.
fn each(image: &Rendering, camera: &Camera, mut check: impl FnMut(f32, Vec3, Vec3, usize)) {
    let rays = camera.rays();
    for (i, (&depth, &normal)) in image.depth_m.iter().zip(&image.normal).enumerate() {
        let (u, v) = (i as u32 % image.width, i as u32 / image.width);
        check(depth, normal, rays.direction(u, v), i);
    }
}

/// Signed distance of a box room from within, and its gradient.
fn room(point: Vec3) -> Explicit {
    let half = Vec3::new(1.1, 0.83, 0.97);
    let gap = half - point.abs();
    let axis = (0..3).min_by(|&a, &b| gap[a].total_cmp(&gap[b])).unwrap_or(0);
    let mut gradient = [0.0; 3];
    gradient[axis] = -point[axis].signum();
    [gap[axis], gradient[0], gradient[1], gradient[2]]
}

fn ball(point: Vec3) -> Explicit {
    let out = point.normalize_or(Vec3::X);
    [point.length() - 0.7, out.x, out.y, out.z]
}

#[test]
fn a_plane_is_exact() {
    let normal = Vec3::new(0.3, -0.5, 0.8).normalize();
    let field = |p: Vec3| [p.dot(normal) - 0.123, normal.x, normal.y, normal.z];
    let camera = camera(DVec3::new(0.2, -0.7, 1.2), DVec3::new(0.1, 0.1, 0.0), 40, 30);
    let eye = camera.rays().eye;
    let views = [Profile::Lite, Profile::Full].map(|profile| view_in(profile, 1.6, field));
    for (renderer, view) in RENDERERS.into_iter().flat_map(|r| views.iter().map(move |v| (r, v))) {
        let image = draw(view, &camera, renderer);
        let mut hits = 0;
        each(&image, &camera, |depth, found, direction, i| {
            let expected = (0.123 - eye.dot(normal)) / direction.dot(normal);
            let point = eye + direction * expected;
            if point.abs().max_element() > 1.4 {
                return;
            }
            hits += 1;
            assert!((depth - expected).abs() < 3e-4, "{renderer:?} {i}: {depth} {expected}");
            assert!(found.dot(normal) > 0.9999, "{renderer:?} {i}: {found}");
            assert!(image.opacity[i] > 0.99 && image.unknown[i] == 0, "{renderer:?} {i}");
        });
        assert!(hits > 600, "{hits}");
    }
}

#[test]
fn a_ball_is_round() {
    let view = view_of(1.2, ball);
    let camera = camera(DVec3::new(1.1, -0.2, 0.3), DVec3::ZERO, 40, 40);
    let eye = camera.rays().eye;
    for renderer in RENDERERS {
        let image = draw(&view, &camera, renderer);
        let mut hits = 0;
        each(&image, &camera, |depth, found, direction, i| {
            let b = eye.dot(direction) / direction.length_squared();
            let root = b * b - (eye.length_squared() - 0.49) / direction.length_squared();
            let across = (eye - direction * b).length();
            if across > 0.75 {
                assert!(image.opacity[i] < 0.01 && depth == 0.0, "{renderer:?} {i}");
                assert_eq!((found, image.unknown[i]), (Vec3::ZERO, 1), "{renderer:?} {i}");
            } else if across < 0.65 {
                let expected = -b - root.sqrt();
                let normal = (eye + direction * expected).normalize();
                let error_m = (depth - expected) * direction.dot(normal);
                // What interpolation is off by in voxels of a seventh of the radius; 0.1 rad.
                assert!(error_m.abs() < 4.5e-3, "{renderer:?} {i}: {depth} {expected}");
                assert!(found.dot(normal) > 0.995, "{renderer:?} {i}: {found} {normal}");
                hits += 1;
            }
        });
        assert!(hits > 500, "{hits}");
    }
}

/// The depth of the box room from within.
fn room_depth(eye: Vec3, direction: Vec3) -> f32 {
    let walls = Vec3::new(1.1, 0.83, 0.97) * direction.signum();
    ((walls - eye) / direction).min_element()
}

#[test]
fn a_room_is_seen_from_within_from_a_wall_and_from_outside() {
    let view = view_of(1.4, room);
    for (place, eye) in [
        ("within", DVec3::new(0.3, -0.4, 0.2)),
        ("in a wall", DVec3::new(-1.18, 0.1, 0.2)),
        ("behind it", DVec3::new(-2.5, 0.3, 0.4)),
        ("far outside of the root", DVec3::new(-80.0, 3.0, 1.0)),
    ] {
        let mut camera = camera(eye, DVec3::new(1.0, 0.02, 0.03), 37, 23);
        if eye.x < -50.0 {
            (camera.intrinsics.fx, camera.intrinsics.fy) = (2000.0, 2000.0);
        }
        let eye = camera.rays().eye;
        for renderer in RENDERERS {
            let image = draw(&view, &camera, renderer);
            let mut hits = 0;
            each(&image, &camera, |depth, normal, direction, i| {
                let expected = room_depth(eye, direction);
                let point = eye + direction * expected;
                let gap = Vec3::new(1.1, 0.83, 0.97) - point.abs();
                // Off the edges, and seen through the near wall.
                let beside = gap.to_array().iter().filter(|gap| **gap < 0.12).count();
                let enters = eye.x > -1.1 || {
                    let wall = eye + direction * ((-1.1 - eye.x) / direction.x);
                    wall.y.abs() < 0.7 && wall.z.abs() < 0.8
                };
                if beside > 1 || !enters {
                    return;
                }
                hits += 1;
                let error = (depth - expected).abs();
                assert!(error < 1e-3, "{renderer:?} {place} {i}: {depth} {expected}");
                assert!(normal.dot(direction) < 0.0 && normal.max_element() < 1.01);
                assert!(normal.abs().max_element() > 0.999, "{renderer:?} {place} {i}: {normal}");
            });
            assert!(hits > 250, "{renderer:?} {place}: {hits}");
        }
    }
}

#[test]
fn images_of_any_size_and_of_nothing_are_drawn() {
    let (full, empty) = (view_of(0.6, ball), view_of(0.0, ball));
    for renderer in RENDERERS {
        for (width, height) in [(1, 1), (17, 3), (3, 35), (16, 16)] {
            let camera = camera(DVec3::new(2.0, 0.1, 0.1), DVec3::ZERO, width, height);
            let image = draw(&full, &camera, renderer);
            assert_eq!((image.width, image.height), (width, height));
            assert_eq!(image.unknown.len(), (width * height) as usize);
            let image = draw(&empty, &camera, renderer);
            let n = (width * height) as usize;
            let nothing = Rendering {
                width,
                height,
                color: vec![Vec3::ZERO; n],
                depth_m: vec![0.0; n],
                normal: vec![Vec3::ZERO; n],
                opacity: vec![0.0; n],
                unknown: vec![1; n],
                ..Rendering::default()
            };
            assert_eq!(image, nothing, "{renderer:?}");
        }
    }
}

#[test]
fn columns_that_nobody_wants_are_empty_and_an_interruption_is_none() {
    let view = view_of(1.2, ball);
    let camera = camera(DVec3::new(1.1, -0.2, 0.3), DVec3::ZERO, 40, 40);
    let pool = query_pool(1).expect("threads");
    for renderer in RENDERERS {
        let settings = settings(renderer);
        let none = render(&view, &camera, Channels::default(), &settings, &pool, &|| false);
        let none = none.expect("not stopped");
        assert_eq!(none, Rendering { width: 40, height: 40, ..Rendering::default() });
        assert!(render(&view, &camera, Channels::ALL, &settings, &pool, &|| true).is_none());
        let all = draw(&view, &camera, renderer);
        let depth = Channels { depth: true, ..Channels::default() };
        let depth = render(&view, &camera, depth, &settings, &pool, &|| false).expect("drawn");
        assert_eq!(depth.depth_m, all.depth_m, "a column does not depend on the others");
    }
}

#[test]
fn settings_are_checked() {
    RenderSettings::default().check().expect("good");
    for sharpness in [0.0, f32::NAN, 1e9] {
        let settings = RenderSettings { sharpness, ..RenderSettings::default() };
        assert_eq!(settings.check().expect_err("wrong").field(), Some("sharpness"));
    }
}
