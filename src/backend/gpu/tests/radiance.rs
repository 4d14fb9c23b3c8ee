//! Colours along rays on the GPU and on the CPU, on the same inputs.

use glam::Vec3;

use super::*;
use crate::backend::cpu::radiance::tests as color_twin;
use crate::backend::gpu::layout::{NONE, Ray, RayPoint};
use crate::backend::{CpuBackend, RadianceParameters};
use crate::modality::losses::{LossWeights, Stencil};
use crate::surface::ColorField;
use crate::train::ColorRay;

const RAYS: usize = 300;

pub(super) fn config(profile: Profile, degree: u8) -> MapConfig {
    let mut config = twin::config(profile);
    config.radiance.degree = degree;
    config.radiance.rays_per_step = RAYS as u32;
    config.radiance.sharpens = true;
    config
}

/// The same map, rays and colours on both backends.
struct Both {
    tree: Tree,
    field: ColorField,
    cpu: CpuBackend,
    gpu: GpuBackend,
    rays: Vec<ColorRay>,
}

impl Both {
    fn new(profile: Profile, degree: u8, seen: impl Fn(Vec3) -> Vec3) -> Self {
        let (tree, field) = (color_twin::plane(0.01), color_twin::shining(degree));
        let cpu = color_twin::uneven_backend(profile, tree.rows.len());
        let mut gpu = like_of(&config(profile, degree), &cpu, &tree);
        let radiance = gpu.colors.radiance.as_mut().expect("it trains on colours");
        radiance.take_up(&gpu.gpu, &field).expect("room");
        let blocks: Vec<u32> = (0..field.band.blocks() as u32).collect();
        let changes = Changes { colors: &blocks, ..Changes::default() };
        let mut writes = Writes::default();
        radiance.follow(&mut writes, &field, &changes);
        let mut passes = Passes::new(&gpu.gpu, None);
        gpu.writer.record(&gpu.gpu, &mut passes, writes).expect("room");
        gpu.gpu.queue.submit([passes.encoder.finish()]);
        Self { rays: color_twin::rays(RAYS, seen), tree, field, cpu, gpu }
    }

    /// Runs the passes of a step on the GPU: those that compare, and then, if asked to, those that
    /// step. Samples of `batch` are part of it, with their gradients.
    fn run(&mut self, batch: &Batch, p: &StepParameters, step: bool) {
        let (gpu, rays) = (&mut self.gpu, self.rays.len() as u32);
        let samples = batch.points.len() as u32;
        gpu.training.upload(&gpu.gpu, batch).expect("room");
        gpu.training.set(&gpu.gpu, training::numbers(&self.tree, gpu.rows_used as u32, samples, p));
        let parameters = p.radiance.as_ref().expect("numbers");
        let radiance = gpu.colors.radiance.as_mut().expect("it trains on colours");
        radiance.upload(&gpu.gpu, &self.rays).expect("room");
        radiance.prepare(&gpu.gpu, parameters, 1.4, self.tree.unit_m()).expect("room");
        let mut passes = Passes::new(&gpu.gpu, None);
        let (radiance, numbers) = (gpu.colors.radiance.as_ref().expect("some"), &gpu.training.step);
        let (device, model) = (&gpu.gpu, gpu.model());
        radiance.compare(device, &mut passes, (&model, numbers), rays).expect("passes");
        if step {
            radiance.optimise(device, &mut passes, (&model, numbers)).expect("passes");
        }
        let training = &gpu.training;
        training.accumulate(device, &mut passes, &model, p.stencil, samples).expect("passes");
        let more = radiance.sharpen(device, &mut passes, (&model, numbers)).expect("a pass");
        if step {
            let samples = (p.stencil, samples);
            training.optimise(device, &mut passes, &model, samples, more).expect("passes");
        }
        gpu.submit(passes, rays, samples).expect("a device");
        gpu.hear().expect("results");
    }

    /// The rays and their points as the GPU has them.
    fn points(&self) -> Vec<Vec<RayPoint>> {
        let radiance = self.gpu.colors.radiance.as_ref().expect("some");
        let rays = self.gpu.gpu.read::<Ray>(&radiance.rays.buffer, self.rays.len()).expect("rays");
        let count = rays.iter().map(|ray| ray.first + ray.points).max().expect("rays") as usize;
        let points = self.gpu.gpu.read::<RayPoint>(&radiance.points.buffer, count).expect("points");
        rays.iter().map(|r| points[r.first as usize..][..r.points as usize].to_vec()).collect()
    }

    fn color_gradients(&self) -> Vec<[i32; 4]> {
        let radiance = self.gpu.colors.radiance.as_ref().expect("some");
        let rows = self.field.band.rows();
        self.gpu.gpu.read(&radiance.rows.gradients.buffer, rows).expect("gradients")
    }
}

pub(super) fn parameters(radiance: RadianceParameters) -> StepParameters {
    let radiance = RadianceParameters { rays: RAYS as u32, ..radiance };
    StepParameters { radiance: Some(radiance), ..twin::parameters(Stencil::Forward) }
}

/// Fails unless numbers are near each other, measured by the largest of them.
fn assert_near(name: &str, pairs: impl Iterator<Item = (f32, f32)>, tolerance: f32) {
    let pairs: Vec<(f32, f32)> = pairs.collect();
    let largest = pairs.iter().fold(0.0f32, |m, (_, x)| m.max(x.abs()));
    assert!(largest > 0.0, "{name} has nothing to compare");
    for (i, (found, expected)) in pairs.iter().enumerate() {
        let error = (found - expected).abs();
        assert!(error <= tolerance * largest, "{name} {i}: {found}, not {expected} of {largest}");
    }
}

/// Of what harmonics have a part in: on the GPU they are those of views, in steps of 2⁻¹³.
fn tolerance(degree: u8) -> f32 {
    if degree == 0 { 2e-4 } else { 1e-3 }
}

#[test]
fn rays_are_rendered_and_differentiated_as_by_the_twin() {
    for (profile, degree) in [
        (Profile::Lite, 0),
        (Profile::Full, 0),
        (Profile::Lite, 1),
        (Profile::Lite, 2),
        (Profile::Full, 3),
    ] {
        let tolerance = tolerance(degree);
        let mut both = Both::new(profile, degree, |at| color_twin::stripes(at + 0.07));
        let p = parameters(color_twin::radiance(0.01, 80.0));
        both.run(&Batch::default(), &p, false);
        let Both { tree, field, cpu, rays, .. } = &mut both;
        let radiance = p.radiance.as_ref().expect("numbers");
        let expected = color_twin::found(cpu, tree, field, rays, radiance);
        let found = both.points();
        let pairs = || found.iter().flatten().zip(expected.rays.iter().flatten());
        for (ray, (found, expected)) in found.iter().zip(&expected.rays).enumerate() {
            assert_eq!(found.len(), expected.len(), "points of ray {ray}");
            assert!(found.iter().all(|point| point.voxel != NONE));
        }
        assert!(pairs().count() > 4 * RAYS);
        for (found, expected) in pairs() {
            assert!(Vec3::from(found.place).distance(expected.place) < 1e-5);
            assert!((found.t - expected.t).abs() < 1e-5);
        }
        assert_near("f", pairs().map(|(a, b)| (a.f, b.f)), 1e-5);
        assert_near("by f", pairs().map(|(a, b)| (a.by_f, b.by_f)), tolerance);
        let results = radiance_results(&both.gpu);
        assert!(expected.compared > RAYS as u32 / 2, "{} rays compared", expected.compared);
        assert_eq!(results[0], expected.compared);
        assert_eq!(results[3], 0, "no ray without room");
        let loss = f64::from(results[1]) / crate::backend::gpu::radiance::LOSS_UNITS;
        assert!((loss - expected.loss).abs() < 1e-4 * expected.loss, "{loss} {}", expected.loss);

        let sums = both.color_gradients();
        let units = 4_294_967_296.0 / 512.0;
        let touched = sums.iter().filter(|sum| sum[3] > 0).count();
        assert_eq!(touched, expected.by_rows.len(), "vertices that rays touched");
        let by_rows = expected.by_rows.iter().flat_map(|(row, by)| {
            let sum = sums[*row as usize];
            (0..3).map(move |i| (sum[i] as f32 / units, by[i]))
        });
        assert_near("colours", by_rows, tolerance);
    }
}

fn radiance_results(gpu: &GpuBackend) -> Vec<u32> {
    let radiance = gpu.colors.radiance.as_ref().expect("some");
    gpu.gpu.read(&radiance.compared, 4).expect("sums")
}

#[test]
fn distances_learn_from_colours_as_by_the_twin() {
    for (profile, degree) in [(Profile::Lite, 0), (Profile::Full, 0), (Profile::Lite, 2)] {
        let tolerance = tolerance(degree);
        let mut both = Both::new(profile, degree, |_| Vec3::new(2.0, -1.0, 2.0));
        let mut p = parameters(color_twin::radiance(0.01, 80.0));
        // Nothing but colours pulls at distances.
        p.weights = LossWeights {
            boundary: 0.0,
            perturbation: 0.0,
            projection: 0.0,
            eikonal_surface: 0.0,
            eikonal_space: 0.0,
            consistency: 0.0,
            ..p.weights
        };
        let mut batch = twin::rough_batch(500);
        both.run(&batch, &p, false);
        let Both { tree, field, cpu, rays, gpu, .. } = &mut both;
        let radiance = p.radiance.as_ref().expect("numbers");
        batch.append(color_twin::compare(cpu, tree, field, rays, radiance).1);
        assert!(batch.points.len() > 500 + RAYS, "{} samples", batch.points.len());
        let expected = twin::found(cpu, tree, &batch, &p);
        let count = tree.rows.len();
        let sums = gpu.gpu.read::<[i32; 28]>(&gpu.rows.gradients.buffer, count).expect("sums");
        let flags = gpu.gpu.read::<u32>(&gpu.rows.flags.buffer, count).expect("flags");
        let mut touched = vec![0u32; count];
        for (row, _, occupied) in &expected.rows {
            touched[*row as usize] = if *occupied { 3 } else { 1 };
        }
        let flags: Vec<u32> = flags.iter().map(|f| f & 3).collect();
        assert_eq!(flags, touched, "rows that the step touched");
        let column = |c: usize, units: f32| {
            let sums = &sums;
            let pair = move |(row, columns, _): &(u32, [f32; 28], bool)| {
                (sums[*row as usize][c] as f32 / (units * 512.0), columns[c])
            };
            expected.rows.iter().map(pair)
        };
        // Sums of many small numbers in fixed point, whose units are made for those of samples.
        for c in 0..16 {
            assert_near(&format!("feature {c}"), column(c, 2048.0), 1e-2);
        }
        assert_near("d", column(24, 256.0), 1e-2);
        for c in 25..28 {
            assert_near(&format!("g {c}"), column(c, 2048.0), 1e-2);
        }
        let weights = gpu.sdf.weights.size() as usize / 4;
        let lanes = gpu.gpu.read::<f32>(&gpu.sdf.partials, gpu.sdf.partials.size() as usize / 4);
        let lanes = lanes.expect("partial sums");
        let sum = |i: usize| lanes.iter().skip(i).step_by(weights + layout::LOSSES).sum::<f32>();
        let by_weights = expected.by_sdf_weights.iter().enumerate();
        assert_near("decoder", by_weights.map(|(i, by)| (sum(i), *by)), tolerance);
    }
}

#[test]
fn steps_are_those_of_the_twin_and_come_back() {
    let mut both = Both::new(Profile::Lite, 1, |at| color_twin::stripes(at + 0.07));
    // Distances stay, so that nothing but colours can differ.
    let p = StepParameters {
        rate: 0.0,
        occupancy_rate: 0.0,
        decoder_rate: 0.0,
        ..parameters(color_twin::radiance(0.01, 80.0))
    };
    let batch = twin::rough_batch(200);
    // There is room for a few blocks at a time.
    both.gpu.colors.radiance.as_mut().expect("some").collector.set_room(8);
    for step in 0..3 {
        both.run(&batch, &p, true);
        let Both { tree, field, cpu, rays, gpu, .. } = &mut both;
        let radiance = p.radiance.as_ref().expect("numbers");
        let (loss, by_rays) = color_twin::compare(cpu, tree, field, rays, radiance);
        let mut batch = batch.clone();
        batch.append(by_rays);
        twin::step(cpu, tree, &batch, &p);
        assert_eq!(gpu.more, step == 0);
        let found = gpu.report().expect("a report").step.losses.photometric;
        assert!((found - loss).abs() < 1e-3 * loss, "{found}, not {loss}");
    }
    both.gpu.finish().expect("results");
    let (gpu, cpu) = (both.gpu.export().expect("a state"), both.cpu.export().expect("a state"));
    assert_eq!(gpu.colors.steps, cpu.colors.steps);
    assert!(gpu.colors.steps.contains(&3));
    // Adam divides a gradient by its own size: where that is a few units of fixed point, as for a
    // vertex that next to no light gets to, rounding shows.
    let columns = |state: &BackendState| state.colors.learned.as_flattened().to_vec();
    let (learned, twins) = (columns(&gpu), columns(&cpu));
    let errors = || learned.iter().zip(&twins).map(|(gpu, cpu)| (gpu - cpu).abs());
    assert!(errors().all(|error| error < 3.0 * 0.01 * 2.0), "a step beyond its rate");
    let weighs = |second: &f32| *second > 1e-15;
    let second = cpu.colors.second.as_flattened();
    let weighed = second.iter().filter(|second| weighs(second)).count();
    let differ = errors().zip(second).filter(|(error, second)| weighs(second) && *error > 3e-4);
    let differ = differ.count();
    assert!(weighed > 2000 && differ * 50 < weighed, "{differ} of {weighed} numbers");
    // What came back is what is there.
    let mut heard = vec![[0.0; 3]; gpu.colors.learned.len()];
    both.gpu.read_changed_colors(&mut |block, learned| {
        let first = block as usize * learned.len();
        heard[first..first + learned.len()].copy_from_slice(learned);
    });
    assert!(heard == gpu.colors.learned);
}

#[test]
fn a_state_comes_back_as_it_went_also_beyond_the_room() {
    let mut both = Both::new(Profile::Lite, 1, |at| color_twin::stripes(at + 0.07));
    let p = parameters(color_twin::radiance(0.01, 80.0));
    both.run(&twin::rough_batch(200), &p, true);
    let state = both.gpu.export().expect("a state");
    assert!(state.colors.steps.iter().any(|&t| t > 0));
    let mut heard = 0;
    both.gpu.import(state.clone()).expect("its own state");
    both.gpu.read_changed_colors(&mut |_, learned| heard += learned.len());
    assert_eq!(heard, state.colors.steps.len());
    assert!(both.gpu.export().expect("a state") == state);

    // A backend that has room for half of the blocks keeps the rest as it came.
    let mut small = like_of(&config(Profile::Lite, 1), &both.cpu, &both.tree);
    let radiance = small.colors.radiance.as_mut().expect("some");
    radiance.set_most_blocks(both.field.band.blocks() as u64 / 2);
    radiance.take_up(&small.gpu, &both.field).expect("room for half");
    assert_eq!(radiance.band.held as usize, both.field.band.blocks() / 2);
    small.import(state.clone()).expect("a state");
    assert!(small.export().expect("a state") == state);
    let mut damaged = state.clone();
    for column in [&mut damaged.colors.learned, &mut damaged.colors.first] {
        column.truncate(7);
    }
    damaged.colors.second.truncate(7);
    damaged.colors.steps.truncate(7);
    assert!(small.import(damaged).is_err(), "it ends within a block");
    // One that does not train on colours keeps them all.
    let mut other = like(&both.cpu, Profile::Lite, &both.tree);
    other.import(state.clone()).expect("a state");
    assert!(other.export().expect("a state") == state);
}
