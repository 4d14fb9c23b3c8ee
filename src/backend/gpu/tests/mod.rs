//! Every kernel against its twin on the CPU, on whatever adapter there is: no adapter is a failure.

mod colored;
mod labels;
mod pools;
mod radiance;
mod shaders;
mod twins;
mod world;

use super::*;
use crate::backend::StepParameters;
use crate::backend::cpu::tests as twin;
use crate::config::Profile;
use crate::modality::test_tree::Tree;
use crate::octree::NodeSource;
use crate::train::Batch;

/// A backend on any adapter, with the rows and decoders of a CPU backend.
fn like(cpu: &crate::backend::CpuBackend, profile: Profile, tree: &Tree) -> GpuBackend {
    like_of(&twin::config(profile), cpu, tree)
}

fn like_of(config: &MapConfig, cpu: &crate::backend::CpuBackend, tree: &Tree) -> GpuBackend {
    let mut gpu = GpuBackend::new(config, Adapters::Any, 1024)
        .expect("an adapter: tests need a Vulkan driver, software will do");
    gpu.reserve(tree.rows.len()).expect("room");
    gpu.rows_used = tree.rows.len();
    gpu.mirror.reserve_nodes(&gpu.gpu, node_slots(tree).into()).expect("room");
    let nodes: Vec<u32> = (0..node_slots(tree)).collect();
    let rows: Vec<u32> = (0..tree.rows.len() as u32).collect();
    let changes = Changes { nodes: &nodes, rows: &rows, ..Changes::default() };
    let mut passes = Passes::new(&gpu.gpu, None);
    let mut writes = Writes::default();
    gpu.mirror.follow(&mut writes, (tree, &tree.prior[..]), &changes);
    gpu.writer.record(&gpu.gpu, &mut passes, writes).expect("room");
    gpu.gpu.queue.submit([passes.encoder.finish()]);
    gpu.import(cpu.export().expect("a state")).expect("a state of this shape");
    gpu
}

/// Slots of nodes, holes included.
fn node_slots(tree: &Tree) -> u32 {
    let root = tree.root().expect("a root").node;
    let (mut open, mut slots) = (vec![root], root + 1);
    while let Some(node) = open.pop() {
        let link = tree.children(node);
        let children = (0..8).filter(|octant| link >> octant & 1 == 1);
        open.extend(children.map(|octant| (link >> 8) * 8 + octant));
        slots = slots.max(open.last().copied().unwrap_or(0) + 1);
    }
    slots
}

/// Runs the passes that find losses and gradients, and then, if asked to, those that step.
fn run(gpu: &mut GpuBackend, tree: &Tree, batch: &Batch, p: &StepParameters, step: bool) {
    let samples = batch.points.len() as u32;
    gpu.training.upload(&gpu.gpu, batch).expect("room");
    gpu.training.set(&gpu.gpu, training::numbers(tree, gpu.rows_used as u32, samples, p));
    let mut passes = Passes::new(&gpu.gpu, None);
    let model = gpu.model();
    gpu.training.accumulate(&gpu.gpu, &mut passes, &model, p.stencil, samples).expect("passes");
    if step {
        gpu.training
            .optimise(&gpu.gpu, &mut passes, &model, (p.stencil, samples), 0)
            .expect("passes");
    }
    gpu.submit(passes, 0, samples).expect("a device");
    gpu.hear().expect("results");
}
