//! Rows come, change, are voided and grow; what was learned stays with them.

use super::*;
use crate::modality::losses::Stencil;

fn trained() -> (crate::backend::CpuBackend, Tree, GpuBackend) {
    let tree = twin::mixed_tree(twin::rough_prior);
    let mut cpu = twin::rough_backend(Profile::Lite, 1, tree.rows.len());
    let (batch, p) = (twin::rough_batch(300), twin::parameters(Stencil::Forward));
    twin::step(&mut cpu, &tree, &batch, &p);
    let gpu = like(&cpu, Profile::Lite, &tree);
    (cpu, tree, gpu)
}

fn heard(gpu: &mut GpuBackend) -> Vec<(u32, LearnedRow)> {
    let mut rows = Vec::new();
    gpu.read_changed(&mut |row, learned| rows.push((row, *learned)));
    rows
}

#[test]
fn a_state_comes_back_as_it_went_and_survives_growth() {
    let (cpu, tree, mut gpu) = trained();
    let state = cpu.export().expect("a state");
    assert!(gpu.export().expect("a state") == state);
    let before = gpu.rows.capacity();
    gpu.rows.reserve(&gpu.gpu, 4 * before).expect("room");
    assert!(gpu.rows.capacity() >= 4 * before);
    assert!(gpu.export().expect("a state") == state, "growing loses nothing");
    // Steps after growing are those without.
    let (batch, p) = (twin::rough_batch(300), twin::parameters(Stencil::Forward));
    let mut other = like(&cpu, Profile::Lite, &tree);
    run(&mut gpu, &tree, &batch, &p, true);
    run(&mut other, &tree, &batch, &p, true);
    assert!(gpu.export().expect("a state") == other.export().expect("a state"), "bit for bit");
}

#[test]
fn a_damaged_state_is_refused_and_changes_nothing() {
    let (cpu, _, mut gpu) = trained();
    let state = cpu.export().expect("a state");
    for damage in [
        |state: &mut BackendState| state.sdf.weights.truncate(3),
        |state: &mut BackendState| state.occupancy.second[0] = f32::NAN,
        |state: &mut BackendState| state.learned.truncate(1),
    ] {
        let mut damaged = state.clone();
        damage(&mut damaged);
        assert!(gpu.import(damaged).is_err());
        assert!(gpu.export().expect("a state") == state);
    }
}

#[test]
fn voided_rows_are_zero_and_results_from_before_do_not_bring_them_back() {
    let (_, tree, mut gpu) = trained();
    let (batch, p) = (twin::rough_batch(300), twin::parameters(Stencil::Forward));
    heard(&mut gpu);
    // A step is under way when the rows are voided.
    let samples = batch.points.len() as u32;
    gpu.training.upload(&gpu.gpu, &batch).expect("room");
    gpu.training.set(&gpu.gpu, training::numbers(&tree, gpu.rows_used as u32, samples, &p));
    let mut passes = Passes::new(&gpu.gpu, None);
    let model = gpu.model();
    gpu.training.accumulate(&gpu.gpu, &mut passes, &model, p.stencil, samples).expect("passes");
    gpu.training.optimise(&gpu.gpu, &mut passes, &model, (p.stencil, samples), 0).expect("passes");
    gpu.submit(passes, 0, samples).expect("a device");
    let voided: Vec<u32> = (0..tree.rows.len() as u32).step_by(3).collect();
    gpu.void(&voided).expect("a device");
    gpu.finish().expect("a device");
    let rows = heard(&mut gpu);
    let state = gpu.export().expect("a state");
    assert!(rows.iter().any(|(row, learned)| row % 3 != 0 && *learned != LearnedRow::default()));
    for (row, learned) in rows {
        assert!(learned == state.learned[row as usize], "row {row}: told what is there");
        assert!(row % 3 != 0 || learned == LearnedRow::default(), "row {row} is voided");
    }
    assert!(
        voided.iter().all(|&row| state.moments[row as usize] == crate::backend::RowMoments::ZERO)
    );
}

#[test]
fn more_rows_than_a_readback_holds_come_with_the_next_ones() {
    let (_, tree, mut gpu) = trained();
    let (batch, p) = (twin::rough_batch(300), twin::parameters(Stencil::Forward));
    heard(&mut gpu);
    gpu.collector.set_room(16);
    run(&mut gpu, &tree, &batch, &p, true);
    let first = heard(&mut gpu);
    assert_eq!((first.len(), gpu.more), (16, true));
    gpu.finish().expect("a device");
    assert!(!gpu.more);
    let state = gpu.export().expect("a state");
    let mut all: Vec<u32> = first.iter().map(|(row, _)| *row).collect();
    for (row, learned) in heard(&mut gpu) {
        assert!(learned == state.learned[row as usize]);
        all.push(row);
    }
    all.sort_unstable();
    all.dedup();
    let report = gpu.report().expect("a report");
    assert!(all.len() > 100 && report.step.rows <= all.len(), "{}", all.len());
}

#[test]
fn the_memory_budget_bounds_rows() {
    let tree = twin::mixed_tree(twin::rough_prior);
    let cpu = twin::rough_backend(Profile::Lite, 1, tree.rows.len());
    let mut gpu = like(&cpu, Profile::Lite, &tree);
    gpu.most_rows = 200_000;
    assert_eq!(gpu.reserve(100).expect("room") as u64, gpu.room());
    let granted = gpu.reserve(190_000).expect("room");
    assert!((190_000..=200_000).contains(&granted), "{granted}");
    assert!(gpu.reserve(199_999).expect("room") <= 200_000);
    // So does what a kernel can bind at once.
    let most = Rows::most(&gpu.gpu, u64::MAX);
    assert!(most < gpu.gpu.most_bytes() / 112 && most > gpu.gpu.most_bytes() / 113, "{most}");
}

#[test]
fn a_device_that_refuses_says_so_with_every_call() {
    let (_, _, mut gpu) = trained();
    gpu.gpu.buffer("small", 16).expect("room").destroy();
    let big = gpu.gpu.buffer("big", u64::MAX / 2).expect_err("no binding is that large");
    assert!(matches!(big, Error::ResourceExhausted { .. }), "{big}");
    gpu.gpu.check().expect("that is no fault of the device");
    gpu.gpu.break_down("taken away");
    assert!(matches!(gpu.finish(), Err(Error::DeviceLost(_))) || gpu.under_way.is_none());
    assert!(matches!(gpu.gpu.check(), Err(Error::DeviceLost(_))));
    assert!(matches!(gpu.export(), Err(Error::DeviceLost(_))));
}
