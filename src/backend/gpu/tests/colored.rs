//! Colours of a room that a robot sees: the band is copied, rays are drawn and work is done as on the
//! host.

use glam::Vec3;

use super::radiance::{config, parameters};
use super::world::World;
use super::*;
use crate::backend::cpu::radiance::tests as color_twin;
use crate::backend::gpu::layout::Ray;
use crate::backend::{CpuBackend, RadianceParameters};
use crate::dataset::synthetic::Synthetic;
use crate::modality::radiance::{Harmonic, harmonics, write_harmonics};
use crate::octree::{NO_BLOCK, Uppers};
use crate::surface::SeenColor;
use crate::train::{ColorRay, KeyFrame, RayPlan, draw_colors};

/// The part of a backend that copies a world.
fn follow(gpu: &mut GpuBackend, world: &World, changes: &Changes<'_>) {
    gpu.reserve(world.topology.rows()).expect("room");
    gpu.follow(&world.scene(), changes).expect("room");
}

fn assert_band_is_copied(gpu: &GpuBackend, world: &World) {
    let field = world.surface.color.as_ref().expect("colours");
    let radiance = gpu.colors.radiance.as_ref().expect("some");
    let held = radiance.band.held as usize;
    let uppers = gpu.gpu.read::<Uppers>(&radiance.band.uppers.buffer, held).expect("neighbours");
    let there = |block: u32| if (block as usize) < held { block } else { NO_BLOCK };
    for (block, found) in (0..).zip(&uppers) {
        assert_eq!(*found, field.band.uppers(block).map(there), "block {block}");
    }
    let rows = held * field.band.scale.vertices();
    let seen = gpu.gpu.read::<[f32; 4]>(&radiance.band.seen.buffer, rows).expect("colours");
    let mut any = 0;
    for (row, found) in seen.iter().enumerate() {
        let SeenColor { color: [r, g, b], weight } =
            field.seen().get(row).copied().unwrap_or_default();
        assert_eq!(*found, [r, g, b, weight], "vertex {row}");
        any += usize::from(weight > 0.0);
    }
    assert!(any > 1000, "{any} vertices seen");
    let width = harmonics(2);
    let harmonics = &radiance.band.harmonics.buffer;
    let harmonics = gpu.gpu.read::<[i16; 4]>(harmonics, rows * width).expect("harmonics");
    let mut any = 0;
    for (row, found) in harmonics.chunks(width).enumerate() {
        let mut expected = vec![Harmonic::default(); width];
        write_harmonics(field.harmonics(row as u32), &mut expected);
        let found: Vec<Harmonic> = found.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        assert_eq!(found, expected, "vertex {row}");
        any += usize::from(found.iter().any(|term| *term != [0; 3]));
    }
    assert!(any > 100, "{any} vertices with harmonics");
    let slots = radiance.band.blocks.capacity() as usize;
    let table = gpu.gpu.read::<[i32; 4]>(&radiance.band.blocks.buffer, slots).expect("a table");
    let mut cells: Vec<_> = table.iter().filter(|entry| entry[3] > 0).collect();
    cells.sort_by_key(|entry| entry[3]);
    assert_eq!(cells.len(), held);
    for (entry, cell) in cells.iter().zip(field.band.cells()) {
        assert_eq!(entry[..3], cell[..], "the cell of block {}", entry[3] - 1);
    }
}

#[test]
fn rays_are_drawn_and_the_band_is_copied_as_on_the_host() {
    let data = Synthetic::room(60).with_width(160);
    let mut config = config(Profile::Lite, 2);
    // So coarse that vertices have had pixels enough for harmonics.
    config.radiance.log2_side = 1;
    let mut world = World::of(config);
    let backend = || GpuBackend::new(&world.config, Adapters::Any, 1024).expect("an adapter");
    let (mut gpu, mut late) = (backend(), backend());
    for index in 0..5 {
        let told = world.see(&data, index);
        follow(&mut gpu, &world, &told.changes());
    }
    assert_band_is_copied(&gpu, &world);
    follow(&mut late, &world, &world.everything().changes());
    assert_band_is_copied(&late, &world);

    let frames: Vec<&KeyFrame> = world.window.iter().collect();
    let p = parameters(color_twin::radiance(0.01, 200.0));
    let rays = 2000;
    let p = StepParameters {
        radiance: p.radiance.map(|radiance| RadianceParameters { rays, ..radiance }),
        ..p
    };
    let plan = RayPlan { rays: 500, seed: 11, step: 7, eikonal_share: 0.3 };
    let work = Work { frames: &frames, plan, steps: 1, parameters: p };
    let (topology, surface) = (&world.topology, &world.surface);
    let expected = draw_colors(&plan, rays, &frames, topology, surface, &world.pool);
    let scene = world.scene();
    gpu.train(&scene, &work).expect("a step");
    gpu.finish().expect("results");
    let radiance = gpu.colors.radiance.as_ref().expect("some");
    let found = gpu.gpu.read::<Ray>(&radiance.rays.buffer, rays as usize).expect("rays");
    let kept: Vec<&Ray> = found.iter().filter(|ray| ray.z >= 0.0).collect();
    // A label at the bound of what is stale may fall to either side.
    assert!(kept.len().abs_diff(expected.len()) <= 3 && kept.len() > 1500, "{}", kept.len());
    let mut others = 0;
    for ray in kept {
        let same = |twin: &ColorRay| {
            twin.z == ray.z
                && (twin.color - Vec3::from(ray.color)).abs().max_element() < 1e-5
                && (twin.direction - Vec3::from(ray.direction)).length() < 1e-5
                && twin.origin == Vec3::from(ray.origin)
        };
        others += usize::from(!expected.iter().any(same));
    }
    assert!(others <= 3, "{others} rays that the host does not draw");
    let step = gpu.report().expect("a report").step;
    assert!(step.losses.photometric > 0.0 && step.losses.photometric < 0.1, "{step:?}");
}

#[test]
fn work_with_colours_is_that_of_the_cpu() {
    let data = Synthetic::room(60).with_width(160);
    let mut world = World::of(config(Profile::Lite, 1));
    // Distances that learn from colours may part by a rate a step where little light gets to; what
    // they should learn is compared elsewhere.
    world.config.radiance.sharpens = false;
    let mut cpu = CpuBackend::new(&world.config, world.pool.clone()).expect("settings");
    let mut gpu = GpuBackend::new(&world.config, Adapters::Any, 1024).expect("an adapter");
    for index in 0..4 {
        let told = world.see(&data, index);
        let frames: Vec<&KeyFrame> = world.window.iter().collect();
        let plan = RayPlan { rays: 500, seed: 11, step: 7 * world.frames, eikonal_share: 0.3 };
        let p = parameters(color_twin::radiance(0.01, 200.0));
        let radiance = p.radiance.map(|r| RadianceParameters { rays: 2000, sharpens: false, ..r });
        let p = StepParameters { radiance, ..p };
        let work = Work { frames: &frames, plan, steps: 2, parameters: p };
        let mut losses = Vec::new();
        let backends: [&mut dyn Backend; 2] = [&mut cpu, &mut gpu];
        for backend in backends {
            backend.reserve(world.topology.rows()).expect("room");
            backend.follow(&world.scene(), &told.changes()).expect("room");
            backend.train(&world.scene(), &work).expect("steps");
            backend.finish().expect("results");
            losses.push(backend.report().expect("a report").step.losses);
        }
        let [cpu, gpu] = [losses[0].photometric, losses[1].photometric];
        println!("photometric: {cpu} and {gpu}");
        // Most of this room has one colour a surface: what is left to learn there is rounding. A
        // quarter of a step of 8 bits; measured: 4e-4.
        assert!(cpu > 0.0 && (cpu - gpu).abs() < 1e-3, "photometric: {cpu} and {gpu}");
    }
    let (cpu, gpu) = (cpu.export().expect("a state"), gpu.export().expect("a state"));
    let (cpu, gpu) = (cpu.colors, gpu.colors);
    assert_eq!(cpu.steps.len(), gpu.steps.len());
    let differ = cpu.steps.iter().zip(&gpu.steps).filter(|(cpu, gpu)| cpu != gpu).count();
    let stepped = cpu.steps.iter().filter(|&&t| t > 0).count();
    println!("{differ} of {stepped} vertices have other step counts");
    assert!(stepped > 1000 && differ * 10 < stepped, "{differ} of {stepped} vertices");
}
