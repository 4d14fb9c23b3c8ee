//! Colours along rays: against central differences, and what training on them does.

use std::borrow::Cow;
use std::sync::Arc;

use super::super::tests::{backend, mixed_tree, parameters, random, rough_backend};
use super::*;
use crate::config::{Profile, Renderer};
use crate::modality::losses::Stencil;
use crate::modality::test_tree::Tree;
use crate::octree::{BandScale, Cell};
use crate::surface::{ColorState, SeenColor};

pub(in crate::backend) const SCALE: BandScale = BandScale { cell_m: 0.1, log2_side: 2 };

/// A band all over the tree, painted by place.
pub(in crate::backend) fn painted(color: impl Fn(Vec3) -> Vec3) -> ColorField {
    let cells: Vec<Cell> =
        (0..729).map(|i| [i % 9, i / 9 % 9, i / 81].map(|c: i32| c - 4)).collect();
    let mut seen = Vec::new();
    for cell in &cells {
        for i in 0..SCALE.vertices() {
            let side = SCALE.side();
            let local =
                Vec3::new((i % side) as f32, (i / side % side) as f32, (i / side / side) as f32);
            let at = Vec3::from(cell.map(|c| c as f32)) * 0.1 + local * SCALE.spacing_m();
            seen.push(SeenColor { color: color(at).to_array(), weight: 1.0 });
        }
    }
    with_harmonics(0, &cells, seen, Vec::new())
}

fn with_harmonics(
    degree: u8,
    cells: &[Cell],
    seen: Vec<SeenColor>,
    by_direction: Vec<f32>,
) -> ColorField {
    let state = ColorState {
        cells: Cow::Borrowed(cells),
        seen: Cow::Owned(seen),
        relief: Cow::default(),
        by_direction: Cow::Owned(by_direction),
    };
    let field = ColorField::new(SCALE, 1, None).with_degree(degree);
    field.with_state(state).expect("blocks and vertices")
}

/// A painted band with harmonics of some degree, uneven from vertex to vertex, and so strong that they
/// take colours out of 0..1.
pub(in crate::backend) fn shining(degree: u8) -> ColorField {
    let field = painted(stripes);
    let terms = crate::geometry::harmonics::terms(degree);
    let vertex = |row: usize| {
        let mean = [0.1, -0.2, -0.9, 1.0].into_iter();
        mean.chain((0..3 * terms).map(move |i| 0.8 * random(row as u32, i)[0]))
    };
    let by_direction = (0..field.band.rows()).flat_map(vertex).collect();
    with_harmonics(degree, field.band.cells(), field.seen().to_vec(), by_direction)
}

/// Stripes across x and y, about as fine as the vertices can hold.
pub(in crate::backend) fn stripes(at: Vec3) -> Vec3 {
    let phase = at * 30.0;
    Vec3::new(phase.x.sin(), phase.y.cos(), (phase.x + phase.y).sin()) * 0.3 + 0.5
}

/// Slanting rays onto the plane z = 0, and the colours that `seen` has there.
pub(in crate::backend) fn rays(count: usize, seen: impl Fn(Vec3) -> Vec3) -> Vec<ColorRay> {
    let ray = |i: usize| {
        let r = random(9, i);
        let end = Vec3::new(0.25 * r[0], 0.25 * r[1], 0.0);
        let direction = Vec3::new(0.6 * r[2], 0.6 * r[3], -1.0);
        ColorRay { origin: end - direction * 0.35, direction, z: 0.35, color: seen(end) }
    };
    (0..count).map(ray).collect()
}

pub(in crate::backend) fn plane(offset_m: f32) -> Tree {
    mixed_tree(move |at| [at.z + offset_m, 0.0, 0.0, 1.0])
}

pub(in crate::backend) fn radiance(rate: f32, sharpness: f32) -> RadianceParameters {
    RadianceParameters {
        rays: 0,
        renderer: Renderer::Ray,
        rate,
        sharpness,
        weight: 10.0,
        sharpens: true,
    }
}

pub(in crate::backend) fn compare(
    backend: &mut CpuBackend,
    tree: &Tree,
    field: &ColorField,
    rays: &[ColorRay],
    radiance: &RadianceParameters,
) -> (f64, Batch) {
    let host = Host { nodes: tree, prior: &tree.prior };
    let (mut batch, p) = (Batch::default(), parameters(Stencil::Forward));
    let loss = backend.compare_colors(&host, field, rays, &p, radiance, &mut batch);
    (loss, batch)
}

/// What a comparison finds before anything is stepped, for whoever must find the same.
pub(in crate::backend) struct Found {
    /// Of each ray: the points on it, where they are (t), f there, and ∂/∂f of the sum of |Ĉ − C|.
    pub(in crate::backend) rays: Vec<Vec<FoundPoint>>,
    /// ∂/∂(logits of a vertex) of the same, ascending.
    pub(in crate::backend) by_rows: Vec<(u32, [f32; 3])>,
    pub(in crate::backend) loss: f64,
    pub(in crate::backend) compared: u32,
}

#[derive(Debug, Clone, Copy)]
pub(in crate::backend) struct FoundPoint {
    pub(in crate::backend) place: Vec3,
    pub(in crate::backend) t: f32,
    pub(in crate::backend) f: f32,
    pub(in crate::backend) by_f: f32,
}

pub(in crate::backend) fn found(
    backend: &mut CpuBackend,
    tree: &Tree,
    field: &ColorField,
    rays: &[ColorRay],
    radiance: &RadianceParameters,
) -> Found {
    backend.radiance.rows.resize(field.band.rows());
    let host = Host { nodes: tree, prior: &tree.prior };
    let p = parameters(Stencil::Forward);
    let (march, all) = backend.compared(&host, field, rays, &p, radiance);
    let point = |(place, f): (&Vec3, &f32)| FoundPoint { place: *place, t: 0.0, f: *f, by_f: 0.0 };
    let mut points: Vec<FoundPoint> =
        march.points.iter().zip(&backend.radiance.distances).map(point).collect();
    // By rays a joint is a point.
    for (piece, ends) in march.pieces.iter().zip(&march.joints_of) {
        for (end, t) in ends.iter().zip(piece.t) {
            points[*end as usize].t = t;
        }
    }
    for ((piece, end), by) in &all.by_ends {
        points[march.joints_of[*piece as usize][usize::from(*end)] as usize].by_f += by;
    }
    let mut begin = 0;
    let of_ray = |&end: &u32| {
        let pieces = &march.joints_of[std::mem::replace(&mut begin, end as usize)..end as usize];
        let last = pieces.last().map_or(0, |last| last[1] + 1);
        points[pieces.first().map_or(0, |first| first[0]) as usize..last as usize].to_vec()
    };
    let mut by_rows = std::collections::BTreeMap::<u32, Vec3>::new();
    for (row, by) in &all.by_rows {
        *by_rows.entry(*row).or_default() += Vec3::from(*by);
    }
    Found {
        rays: march.ends.iter().map(of_ray).collect(),
        by_rows: by_rows.into_iter().map(|(row, by)| (row, by.to_array())).collect(),
        loss: all.loss,
        compared: all.rays,
    }
}

/// A backend whose rows are far from zero, but not so far that distances leave the reach of colours.
pub(in crate::backend) fn uneven_backend(profile: Profile, rows: usize) -> CpuBackend {
    let mut backend = rough_backend(profile, 1, rows);
    for row in &mut backend.rows.learned {
        row.explicit = row.explicit.map(|x| 0.1 * x);
        row.sdf_feature = row.sdf_feature.map(|x| 0.2 * x);
    }
    backend
}

#[test]
fn gradients_are_central_differences() {
    gradients_are_differences(&painted(stripes), Renderer::Ray);
    gradients_are_differences(&shining(2), Renderer::Ray);
    gradients_are_differences(&painted(stripes), Renderer::Tile);
}

fn gradients_are_differences(field: &ColorField, renderer: Renderer) {
    let tree = plane(0.01);
    let mut backend = uneven_backend(Profile::Lite, tree.rows.len());
    // Far from every colour, so that no difference changes its sign.
    let rays = rays(24, |_| Vec3::new(2.0, -1.0, 2.0));
    let radiance = RadianceParameters { weight: 100.0, renderer, ..radiance(0.0, 80.0) };
    let loss = |backend: &mut CpuBackend| {
        f64::from(radiance.weight) * compare(backend, &tree, field, &rays, &radiance).0
    };
    let (_, batch) = compare(&mut backend, &tree, field, &rays, &radiance);
    let host = Host { nodes: &tree, prior: &tree.prior };
    let report = backend.accumulate(&host, &batch, &parameters(Stencil::Forward)).expect("valid");
    assert_eq!(report.losses.total, 0.0, "they pay no loss of their own");
    let gradients = backend.rows.gradients(&backend.outputs);
    let by_weights = backend.sdf_memory.gradient.clone();
    let mut compared = 0;
    let mut check = |name: &str, found: f32, difference: &mut dyn FnMut(f32) -> f64, step: f32| {
        let (low, middle, high) = (difference(-step), difference(0.0), difference(step));
        let expected = (high - low) / f64::from(2.0 * step);
        let kink = ((high - middle) - (middle - low)).abs() > 0.02 * (high - low).abs() + 1e-6;
        if !kink {
            let error = (f64::from(found) - expected).abs();
            assert!(error < 0.03 + 0.04 * expected.abs(), "{name}: {found} but {expected}");
            compared += usize::from(expected.abs() > 0.1);
        }
    };
    for (row, gradient) in gradients.iter().step_by(3) {
        assert!(!gradient.occupied, "colours say nothing of occupancy");
        // By tiles the gradients at vertices learn nothing.
        let columns = if renderer == Renderer::Ray { &[0, 5, 24, 27][..] } else { &[0, 5, 24] };
        for &column in columns {
            let mut difference = |by: f32| {
                let learned = &mut backend.rows.learned[*row as usize];
                let value = match column {
                    24.. => &mut learned.explicit[column - 24],
                    _ => &mut learned.sdf_feature[column],
                };
                let before = std::mem::replace(value, *value + by);
                let loss = loss(&mut backend);
                let learned = &mut backend.rows.learned[*row as usize];
                match column {
                    24.. => learned.explicit[column - 24] = before,
                    _ => learned.sdf_feature[column] = before,
                }
                loss
            };
            check("row", gradient.columns[column], &mut difference, 1e-3);
        }
    }
    for (i, found) in by_weights.iter().enumerate().step_by(37) {
        let mut difference = |by: f32| {
            let mut nudge = |by: f32| {
                Arc::make_mut(&mut backend.decoders).sdf.update(|weights| weights[i] += by);
            };
            nudge(by);
            let loss = loss(&mut backend);
            Arc::make_mut(&mut backend.decoders).sdf.update(|weights| weights[i] -= by);
            loss
        };
        check("weight", *found, &mut difference, 1e-3);
    }
    assert!(compared > 20, "only {compared} gradients were not small");
}

/// By the logits of vertices, with harmonics beside them and where these leave the range of colours.
#[test]
fn gradients_of_logits_are_central_differences() {
    let tree = plane(0.01);
    for field in [painted(stripes), shining(1), shining(3)] {
        let mut backend = uneven_backend(Profile::Lite, tree.rows.len());
        let rays = rays(24, |_| Vec3::new(2.0, -1.0, 2.0));
        let radiance = radiance(0.0, 80.0);
        let found = found(&mut backend, &tree, &field, &rays, &radiance);
        let mut compared = 0;
        for (row, by) in found.by_rows.iter().step_by(5) {
            for channel in 0..3 {
                let mut loss = |step: f32| {
                    let value = &mut backend.radiance.rows.state.learned[*row as usize][channel];
                    let before = std::mem::replace(value, *value + step);
                    let host = Host { nodes: &tree, prior: &tree.prior };
                    let p = parameters(Stencil::Forward);
                    let (_, all) = backend.compared(&host, &field, &rays, &p, &radiance);
                    backend.radiance.rows.state.learned[*row as usize][channel] = before;
                    3.0 * all.loss
                };
                let step = 1e-2;
                let (low, middle, high) = (loss(-step), loss(0.0), loss(step));
                let kink =
                    ((high - middle) - (middle - low)).abs() > 0.02 * (high - low).abs() + 1e-6;
                let expected = (high - low) / f64::from(2.0 * step);
                let error = (f64::from(by[channel]) - expected).abs();
                assert!(kink || error < 1e-3 + 0.02 * expected.abs(), "{row}: {by:?} {expected}");
                compared += usize::from(!kink && expected.abs() > 5e-3);
            }
        }
        assert!(compared > 20, "only {compared} gradients were not small");
    }
}

#[test]
fn colours_are_learned_from_rays() {
    let (tree, field) = (plane(0.0), painted(|_| Vec3::splat(0.5)));
    let mut backend = backend(Profile::Lite, 2);
    backend.resize(tree.rows.len());
    let rays = rays(2048, stripes);
    let radiance = radiance(0.05, 200.0);
    let (before, _) = compare(&mut backend, &tree, &field, &rays, &radiance);
    let mut after = before;
    for _ in 0..60 {
        (after, _) = compare(&mut backend, &tree, &field, &rays, &radiance);
    }
    assert!(before > 0.15 && after < 0.2 * before, "{before} {after}");
    let (mut blocks, mut largest) = (Vec::new(), 0.0f32);
    backend.radiance.read_changed(SCALE.vertices(), &mut |block, learned| {
        blocks.push(block);
        largest = learned.as_flattened().iter().fold(largest, |most, x| most.max(x.abs()));
    });
    assert!(blocks.is_sorted() && blocks.len() > 20 && largest > 0.5, "{blocks:?} {largest}");
    backend.radiance.read_changed(SCALE.vertices(), &mut |_, _| panic!("told once"));
}

#[test]
fn a_surface_moves_to_where_its_colours_fit() {
    for renderer in [Renderer::Ray, Renderer::Tile] {
        a_surface_moves(renderer);
    }
}

fn a_surface_moves(renderer: Renderer) {
    // The map holds the colours of the true plane, and its surface 1.5 cm too high.
    let (tree, field) = (plane(-0.015), painted(stripes));
    let mut backend = backend(Profile::Lite, 2);
    backend.resize(tree.rows.len());
    let rays = rays(2048, stripes);
    let radiance = RadianceParameters { renderer, ..radiance(0.0, 200.0) };
    let p = parameters(Stencil::Forward);
    let host = Host { nodes: &tree, prior: &tree.prior };
    let points =
        (0..400).map(|i| Vec3::new((i % 20) as f32 - 9.5, (i / 20) as f32 - 9.5, 0.0) * 0.02);
    let mut on_plane = March::default();
    on_plane.points.extend(points);
    let error = |backend: &mut CpuBackend| {
        backend.distances_at(&host, &on_plane, &p);
        backend.radiance.distances.iter().map(|f| f.abs()).sum::<f32>() / 400.0
    };
    assert!((error(&mut backend) - 0.015).abs() < 1e-6);
    for _ in 0..100 {
        let (_, batch) = compare(&mut backend, &tree, &field, &rays, &radiance);
        backend.step(&host, &batch, &p).expect("a valid batch");
    }
    let after = error(&mut backend);
    assert!(after < 0.0075, "{renderer:?}: {after}");
}

/// Where the decoder says nothing, tiles see the field that rays see, from fewer points.
#[test]
fn tiles_ask_corners_once_and_see_what_rays_see() {
    let tree = mixed_tree(|at| {
        let to_centre = at - Vec3::new(0.1, 0.0, -0.4);
        let normal = to_centre.normalize();
        [to_centre.length() - 0.4, normal.x, normal.y, normal.z]
    });
    let mut backend = backend(Profile::Lite, 2);
    backend.resize(tree.rows.len());
    let host = Host { nodes: &tree, prior: &tree.prior };
    let rays = rays(700, stripes);
    let mut seen = [Renderer::Ray, Renderer::Tile].map(|renderer| {
        let radiance = RadianceParameters { renderer, ..radiance(0.0, 200.0) };
        let mut march = backend.march(&host, &radiance, &rays);
        backend.distances_at(&host, &march, &parameters(Stencil::Forward));
        march.measure(&backend.radiance.distances);
        march
    });
    let [by_rays, by_tiles] = &mut seen;
    assert!(by_rays.pieces.len() > 2000 && by_rays.pieces.len() == by_tiles.pieces.len());
    // Between voxels of two sizes each asks another of both; a corner is asked a little within its own.
    let is_same = |a: &f32, b: &f32| (a - b).abs() < 2e-4;
    let mut same = 0;
    for (a, b) in by_rays.pieces.iter().zip(&by_tiles.pieces) {
        assert_eq!(a.t, b.t);
        assert!(a.f.iter().zip(&b.f).all(|(a, b)| (a - b).abs() < 0.02), "{a:?} {b:?}");
        same += usize::from(a.f.iter().zip(&b.f).all(|(a, b)| is_same(a, b)));
    }
    assert!(same * 10 > by_rays.pieces.len() * 7, "{same} of {}", by_rays.pieces.len());
    assert!(by_tiles.points.len() < by_rays.points.len() / 4, "{}", by_tiles.points.len());
}

#[test]
fn threads_do_not_show() {
    let (tree, field) = (plane(0.01), painted(stripes));
    let run = |threads| {
        let mut backend = backend(Profile::Lite, threads);
        backend.resize(tree.rows.len());
        let rays = rays(500, |at| stripes(at + 0.1));
        let (loss, batch) = compare(&mut backend, &tree, &field, &rays, &radiance(0.05, 200.0));
        (loss.to_bits(), batch.distances, backend.radiance.export())
    };
    assert_eq!(run(1), run(3));
}
