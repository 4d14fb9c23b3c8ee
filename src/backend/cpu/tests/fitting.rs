//! What training reaches, judged through the read-out.

use super::*;
use crate::backend::LearnedRow;
use crate::geometry::simd::Half;
use crate::modality::read::{Answers, evaluate};
use crate::modality::{Features, Row};

/// A trained row as a view holds it.
fn read(prior: &[f32; 4], learned: &LearnedRow) -> Row {
    Row {
        explicit: std::array::from_fn(|c| prior[c] + learned.explicit[c]),
        features: Features::nearest(&learned.sdf_feature, &learned.occupancy_feature),
    }
}

/// Mean |f − truth| of the trained field near the box, m.
fn error_of(tree: &mut Tree, prior: &[[f32; 4]], backend: &mut CpuBackend) -> f64 {
    Backend::read_changed(backend, &mut |row, values| {
        let row = row as usize;
        tree.rows[row] = read(&prior[row], values);
    });
    let test = samples_of(box_distance, 4000, 999);
    let mut found = vec![0.0; test.points.len()];
    let decoders = Backend::decoders(backend);
    let answers = Answers { distance: &mut found, ..Answers::default() };
    evaluate(tree, &decoders, &test.points, answers);
    let errors = found.iter().zip(&test.distances).map(|(f, y)| f64::from((f - y).abs()));
    errors.sum::<f64>() / found.len() as f64
}

#[test]
fn training_beats_the_closed_form_at_a_box_edge() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let mut tree = Tree::new(3, 0.1, |_, _| true, box_prior);
        let prior = tree.prior.clone();
        let mut backend = backend(profile, 2);
        backend.rows.resize(tree.rows.len());
        let before = error_of(&mut tree, &prior, &mut backend);
        let mut errors = Vec::new();
        for round in 0..60 {
            let host = Host { nodes: &tree, prior: &prior };
            let batch = samples_of(box_distance, 2000, round);
            backend.step(&host, &batch, &parameters(stencil)).expect("a valid batch");
            if round % 20 == 19 {
                errors.push(error_of(&mut tree, &prior, &mut backend));
            }
        }
        println!("{profile:?}: {before:.5} -> {errors:.5?} m");
        assert!(errors[0] < 0.9 * before && errors[2] < 0.7 * before, "{before} {errors:?}");
    }
}

#[test]
fn the_paper_start_learns_a_sphere_from_zero() {
    let sphere = |at: Vec3| at.length() - 0.25;
    let mut tree = Tree::new(3, 0.1, |_, _| true, |_| [0.0; 4]);
    let prior = tree.prior.clone();
    let mut backend = backend(Profile::Lite, 2);
    backend.rows.resize(tree.rows.len());
    let p = StepParameters { rate: 5e-3, ..parameters(Stencil::Central) };
    for round in 0..150 {
        let host = Host { nodes: &tree, prior: &prior };
        let report = backend.step(&host, &samples_of(sphere, 2000, round), &p).expect("valid");
        assert!(report.losses.total.is_finite());
    }
    Backend::read_changed(&mut backend, &mut |row, values| {
        tree.rows[row as usize] = read(&[0.0; 4], values);
    });
    let test = samples_of(sphere, 2000, 999);
    let count = test.points.len();
    let (mut distance, mut occupancy) = (vec![0.0; count], vec![0.0; count]);
    let decoders = Backend::decoders(&backend);
    let answers =
        Answers { distance: &mut distance, occupancy: &mut occupancy, ..Answers::default() };
    evaluate(&tree, &decoders, &test.points, answers);
    let error: f32 = distance.iter().zip(&test.distances).map(|(f, y)| (f - y).abs()).sum();
    assert!(error / (count as f32) < 0.008, "mean error {} m", error / count as f32);
    let far = |i: &usize| test.distances[*i].abs() > 0.02;
    let right =
        (0..count).filter(far).filter(|i| (occupancy[*i] > 0.5) == (test.distances[*i] < 0.0));
    let share = right.count() as f32 / (0..count).filter(far).count() as f32;
    assert!(share > 0.9, "occupancy is right at {share}");
}

#[test]
fn the_trainer_and_the_read_out_evaluate_the_same_field() {
    let mut tree = mixed_tree(rough_prior);
    for profile in [Profile::Lite, Profile::Full] {
        let mut backend = rough_backend(profile, 1, tree.rows.len());
        let prior: Vec<[f32; 4]> = tree.positions.iter().map(|at| rough_prior(*at)).collect();
        for (row, learned) in backend.rows.learned.iter_mut().enumerate() {
            // Features that a view holds exactly.
            for x in learned.sdf_feature.iter_mut().chain(&mut learned.occupancy_feature) {
                *x = Half::nearest(*x).widen();
            }
            tree.rows[row] = read(&prior[row], learned);
        }
        let mut batch = rough_batch(100);
        let decoders = Backend::decoders(&backend);
        let answers = Answers { distance: &mut batch.distances, ..Answers::default() };
        evaluate(&tree, &decoders, &batch.points, answers);
        let host = Host { nodes: &tree, prior: &prior };
        let losses = backend
            .accumulate(&host, &batch, &parameters(Stencil::Forward))
            .expect("a valid batch")
            .losses;
        for loss in [losses.projection, losses.perturbation, losses.boundary] {
            assert!(loss < 1e-6, "{losses:?}");
        }
    }
}
