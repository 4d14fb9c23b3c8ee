//! Steps: Adam by row, threads, instruction sets, checkpoints, bad batches.

use super::*;

#[test]
fn every_row_follows_adam_with_its_own_step_count() {
    let tree = mixed_tree(rough_prior);
    let p = parameters(Stencil::Forward);
    let mut backend = rough_backend(Profile::Lite, 2, tree.rows.len());
    let host = Host { nodes: &tree, prior: &tree.prior };
    type Reference = ([f64; 28], [f64; 28], [u32; 2]);
    let mut reference: Vec<Reference> = vec![([0.0; 28], [0.0; 28], [0; 2]); tree.rows.len()];
    for round in 0..4 {
        // Every round sees another part of the tree.
        let mut batch = rough_batch(24);
        for point in &mut batch.points {
            *point = *point * 0.3 + Vec3::new(0.1 * round as f32 - 0.2, -0.1, -0.1);
        }
        let before = backend.rows.learned.clone();
        backend.accumulate(&host, &batch, &p).expect("a valid batch");
        let gradients = backend.rows.gradients(&backend.outputs);
        let report = backend.step(&host, &batch, &p).expect("a valid batch");
        assert_eq!(report.rows, gradients.len());
        let mut touched = vec![false; tree.rows.len()];
        for (row, gradient) in &gradients {
            let row = *row as usize;
            touched[row] = true;
            let (m, v, t) = &mut reference[row];
            t[0] += 1;
            t[1] += u32::from(gradient.occupied);
            for column in 0..28 {
                let occupancy = (16..24).contains(&column);
                if occupancy && !gradient.occupied {
                    continue;
                }
                let (t, rate) = if occupancy { (t[1], 1e-2) } else { (t[0], 1e-3) };
                let g = f64::from(gradient.columns[column]);
                m[column] = 0.9 * m[column] + 0.1 * g;
                v[column] = 0.999 * v[column] + 0.001 * g * g;
                let m_hat = m[column] / (1.0 - 0.9f64.powi(t as i32));
                let v_hat = v[column] / (1.0 - 0.999f64.powi(t as i32));
                let by = rate * m_hat / (v_hat.sqrt() + 1e-8);
                let value = |row: &LearnedRow| match column {
                    0..16 => row.sdf_feature[column],
                    16..24 => row.occupancy_feature[column - 16],
                    _ => row.explicit[column - 24],
                };
                let found = value(&backend.rows.learned[row]) - value(&before[row]);
                assert!(
                    (f64::from(found) + by).abs() < 1e-6 + 1e-3 * rate,
                    "round {round} row {row} column {column}: {found} but {}",
                    -by
                );
            }
            assert_eq!(backend.rows.moments[row].sdf_steps, t[0]);
            assert_eq!(backend.rows.moments[row].occupancy_steps, t[1]);
        }
        for row in (0..tree.rows.len()).filter(|row| !touched[*row]) {
            assert_eq!(backend.rows.learned[row], before[row], "an untouched row moved");
        }
    }
    let counts: Vec<u32> = reference.iter().map(|r| r.2[0]).collect();
    assert!(counts.contains(&1) && counts.contains(&4), "the rounds overlap in part");
}

#[test]
fn a_step_has_the_same_bits_on_any_number_of_threads() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let tree = mixed_tree(box_prior);
        let run = |threads: usize| {
            let mut backend = backend(profile, threads);
            backend.rows.resize(tree.rows.len());
            let host = Host { nodes: &tree, prior: &tree.prior };
            let mut losses = Vec::new();
            for round in 0..4 {
                let batch = samples_of(box_distance, 1500, round);
                let report = backend.step(&host, &batch, &parameters(stencil)).expect("valid");
                losses.push(report.losses);
            }
            (losses, Backend::export(&backend).expect("a state"))
        };
        let one = run(1);
        assert!(one.1.learned.iter().any(|row| row.sdf_feature[0] != 0.0));
        assert!(one == run(2), "{profile:?}: 2 threads differ");
        assert!(one == run(3), "{profile:?}: 3 threads differ");
    }
}

#[test]
fn instruction_sets_agree_by_value() {
    let tree = mixed_tree(rough_prior);
    for profile in [Profile::Lite, Profile::Full] {
        let batch = rough_batch(700);
        let p = parameters(Stencil::Central);
        let mut results = Vec::new();
        for set in InstructionSet::available() {
            let mut backend = rough_backend(profile, 1, tree.rows.len());
            backend.set = set;
            let total = loss(&mut backend, &tree, &batch, &p);
            results.push((total, backend.rows.gradients(&backend.outputs)));
        }
        let (total, rows) = &results[0];
        for (other_total, other_rows) in &results[1..] {
            assert!((total - other_total).abs() < 1e-4 * total);
            assert_eq!(rows.len(), other_rows.len());
            // A relu at its kink may flip between two correct sets: few rows, by number.
            let differ = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-3 + 1e-3 * a.abs())
            };
            let pairs = rows.iter().zip(other_rows);
            let flipped =
                pairs.filter(|(a, b)| a.0 != b.0 || differ(&a.1.columns, &b.1.columns)).count();
            assert!(flipped <= rows.len() / 50, "{flipped} of {} rows differ", rows.len());
        }
    }
}

#[test]
fn a_state_resumes_bit_for_bit() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.prior };
    let p = parameters(Stencil::Forward);
    let batch = |round| samples_of(box_distance, 600, round);
    let mut first = backend(Profile::Lite, 2);
    first.rows.resize(tree.rows.len());
    for round in 0..3 {
        first.step(&host, &batch(round), &p).expect("a valid batch");
    }
    let state = Backend::export(&first).expect("a state");
    let mut second = backend(Profile::Lite, 1);
    Backend::import(&mut second, state.clone()).expect("a state of this shape");
    for round in 3..6 {
        let a = first.step(&host, &batch(round), &p).expect("a valid batch");
        let b = second.step(&host, &batch(round), &p).expect("a valid batch");
        assert_eq!(a, b);
    }
    assert!(
        Backend::export(&first).expect("a state") == Backend::export(&second).expect("a state")
    );

    let mut full = backend(Profile::Full, 1);
    let refused = Backend::import(&mut full, state);
    assert!(refused.is_err(), "weights of another shape");
}

#[test]
fn changed_rows_are_read_once_and_reset_rows_are_zero() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.prior };
    let mut backend = backend(Profile::Lite, 1);
    backend.rows.resize(tree.rows.len());
    let batch = samples_of(box_distance, 300, 0);
    let report = backend.step(&host, &batch, &parameters(Stencil::Forward)).expect("valid");
    let read = |backend: &mut CpuBackend| {
        let mut rows = Vec::new();
        Backend::read_changed(backend, &mut |row, values| rows.push((row, *values)));
        rows
    };
    let rows = read(&mut backend);
    assert_eq!(rows.len(), report.rows);
    assert!(rows.is_sorted_by_key(|(row, _)| *row));
    assert!(read(&mut backend).is_empty());
    let some: Vec<u32> = rows.iter().take(5).map(|(row, _)| *row).collect();
    backend.rows.reset(&some);
    // Growth keeps what is there.
    backend.rows.resize(tree.rows.len() * 2);
    let after = read(&mut backend);
    assert_eq!(after.iter().map(|(row, _)| *row).collect::<Vec<_>>(), some);
    assert!(after.iter().all(|(_, values)| *values == LearnedRow::default()));
    assert!(some.iter().all(|row| backend.rows.moments[*row as usize] == RowMoments::ZERO));
    let kept = rows[5];
    assert_eq!(backend.rows.learned[kept.0 as usize], kept.1);
}

#[test]
fn samples_outside_or_without_a_label_are_left_out() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.prior };
    let mut backend = backend(Profile::Lite, 1);
    let mut batch = samples_of(box_distance, 10, 0);
    // The first sample's stencil leaves the tree; the others lack something altogether.
    batch.points[0] = Vec3::new(0.39, 0.0, 0.0);
    batch.eikonal.fill(true);
    batch.points[1] = Vec3::splat(9.0);
    batch.points[2] = Vec3::NAN;
    batch.distances[3] = f32::NAN;
    batch.occupancies[4] = f32::INFINITY;
    let p = parameters(Stencil::Central);
    // Without rows nothing can be located.
    assert_eq!(backend.step(&host, &batch, &p).expect("valid").samples, 0);
    backend.rows.resize(tree.rows.len());
    assert_eq!(backend.step(&host, &batch, &p).expect("valid").samples, 6);
    assert!(!backend.plan.sites[0].eikonal && backend.plan.sites[0].centre.is_some());
    assert!(backend.rows.learned.iter().all(|row| row.explicit.iter().all(|x| x.is_finite())));

    batch.kinds.pop();
    assert!(backend.step(&host, &batch, &p).is_err(), "columns of different lengths");
    batch.kinds.push(SampleKind::Free);
    let short = Host { nodes: &tree, prior: &tree.prior[1..] };
    assert!(backend.step(&short, &batch, &p).is_err(), "fewer priors than rows");
}
