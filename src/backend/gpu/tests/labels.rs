//! Samples that the GPU draws and labels against those that the host draws, in rooms that a robot
//! sees.

use glam::Vec3;

use super::world::World;
use super::*;
use crate::backend::CpuBackend;
use crate::backend::gpu::layout::{NONE, Sample, Step};
use crate::backend::gpu::pool::Pool;
use crate::backend::gpu::sampling::Slots;
use crate::dataset::synthetic::Synthetic;
use crate::modality::losses::Stencil;
use crate::train::{KeyFrame, RAY_SAMPLES, RayPlan, SampleKind, sample, stale_m};

/// How far a point may lie from its twin, and a label be from its twin's, m: the logarithm and the
/// cosine of a driver differ in the last bits, and so do sums.
const POINT_M: f32 = 1e-5;
const LABEL_M: f32 = 1e-4;
/// Labels jump where another surfel becomes the nearest, at the faces of voxels and where a rule
/// begins to hold: a label may be the twin's for a point that is off by so much, m, ...
const EDGE_M: f32 = 2e-5;
/// ... for one sample in so many.
const EDGES: usize = 200;
const RAYS: u32 = 3000;

const KINDS: [SampleKind; RAY_SAMPLES as usize] =
    [SampleKind::Surface, SampleKind::Free, SampleKind::Perturbed, SampleKind::Perturbed];

fn plan(world: &World) -> RayPlan {
    RayPlan { rays: RAYS, seed: 11, step: 7 * world.frames, eikonal_share: 0.3 }
}

impl World {
    /// The label of a sample, if the host keeps it.
    fn says(&self, kind: SampleKind, point: Vec3) -> Option<f32> {
        let (distance, _) = self.surface.label(&self.topology, point)?;
        let kept = match kind {
            SampleKind::Surface => distance.abs() <= stale_m(&self.surface),
            SampleKind::Free => distance >= 0.0,
            SampleKind::Perturbed | SampleKind::Ray => true,
        };
        kept.then_some(distance)
    }

    /// Whether the host says the same of the point or of one right beside it.
    fn could_say(&self, kind: SampleKind, point: Vec3, found: Option<f32>) -> bool {
        let steps = [0.0, -EDGE_M, EDGE_M];
        (0..27).any(|i| {
            let step = Vec3::new(steps[i % 3], steps[i / 3 % 3], steps[i / 9]);
            same(self.says(kind, point + step), found)
        })
    }
}

fn same(a: Option<f32>, b: Option<f32>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= LABEL_M,
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// The part of the backend that draws, without what trains.
struct Drawer {
    gpu: Gpu,
    writer: Writer,
    mirror: Mirror,
    surface: SurfaceMirror,
    sampling: Sampling,
    step: wgpu::Buffer,
    samples: Pool,
}

impl Drawer {
    fn new(config: &MapConfig) -> Self {
        let gpu = Gpu::open(Adapters::Any).expect("an adapter");
        Self {
            writer: Writer::new(&gpu).expect("kernels"),
            mirror: Mirror::new(&gpu).expect("room"),
            surface: SurfaceMirror::new(&gpu).expect("room"),
            sampling: Sampling::new(&gpu, config).expect("a kernel"),
            step: gpu.buffer("step", size_of::<Step>() as u64).expect("room"),
            samples: Pool::new(&gpu, "samples", size_of::<Sample>() as u64).expect("room"),
            gpu,
        }
    }

    /// Follows a world; returns the bytes that went to the GPU.
    fn follow(&mut self, world: &World, changes: &Changes<'_>) -> usize {
        let Scene { topology, surface, prior } = world.scene();
        let rows = topology.rows() as u64;
        self.mirror.reserve_nodes(&self.gpu, topology.node_slots() as u64).expect("room");
        self.mirror.prior.grow_ahead(&self.gpu, rows).expect("room");
        self.surface.anchors.grow_ahead(&self.gpu, rows).expect("room");
        self.surface.reserve(&self.gpu, surface).expect("room");
        let mut writes = Writes::default();
        self.mirror.follow(&mut writes, (topology, prior), changes);
        self.surface.follow(&mut writes, surface, changes);
        let bytes = writes.bytes();
        let mut passes = Passes::new(&self.gpu, None);
        self.writer.record(&self.gpu, &mut passes, writes).expect("passes");
        self.gpu.queue.submit([passes.encoder.finish()]);
        bytes
    }

    /// The samples of a step of some work, in slots that were poisoned first.
    fn draw(&mut self, world: &World, steps: u32, step: u32) -> Vec<Sample> {
        let frames: Vec<&KeyFrame> = world.window.iter().collect();
        let parameters = twin::parameters(Stencil::Forward);
        let plan = plan(world);
        let work = Work { frames: &frames, plan, steps, parameters };
        let drawn = self.sampling.prepare(&self.gpu, &world.surface, &work).expect("room");
        let count = drawn.samples;
        assert_eq!(count, RAYS * RAY_SAMPLES);
        let rows = world.topology.rows() as u32;
        let numbers = training::numbers(&world.topology, rows, count, &parameters);
        self.gpu.write(&self.step, &[numbers]);
        self.samples.grow(&self.gpu, count.into()).expect("room");
        let poison = vec![0x5a5a_5a5au32; count as usize * size_of::<Sample>() / 4];
        self.gpu.write(&self.samples.buffer, &poison);
        let (mirror, surface) = (&self.mirror, &self.surface);
        let slots = Slots { mirror, surface, step: &self.step, samples: &self.samples, count };
        let mut passes = Passes::new(&self.gpu, None);
        self.sampling.draw(&self.gpu, &mut passes, step, &slots).expect("a pass");
        self.gpu.queue.submit([passes.encoder.finish()]);
        self.gpu.read(&self.samples.buffer, count as usize).expect("samples")
    }
}

/// What a comparison found.
#[derive(Debug, Default)]
struct Compared {
    samples: usize,
    behind: usize,
    /// Samples that agree with the host for a point right beside them.
    edges: usize,
    wrong: Vec<String>,
}

/// The host's batch, read in step with slots.
struct Reader {
    batch: Batch,
    next: usize,
}

impl Reader {
    /// The host's label, occupancy and coin of a slot, if it is next.
    fn take(&mut self, kind: SampleKind, point: Vec3) -> Option<(f32, f32, bool)> {
        let i = self.next;
        let is_next = i < self.batch.points.len()
            && self.batch.kinds[i] == kind
            && self.batch.points[i].distance(point) <= POINT_M;
        is_next.then(|| {
            self.next += 1;
            (self.batch.distances[i], self.batch.occupancies[i], self.batch.eikonal[i])
        })
    }

    fn skip_ray(&mut self) {
        while self.batch.kinds.get(self.next).is_some_and(|&k| k != SampleKind::Surface) {
            self.next += 1;
        }
    }
}

/// Compares slots with the host's batch, which holds the same samples in the same order, less the
/// empty slots.
fn compare(world: &World, found: &[Sample], step: u32) -> Compared {
    let frames: Vec<&KeyFrame> = world.window.iter().collect();
    let plan = RayPlan { step: plan(world).step + step, ..plan(world) };
    let batch = sample(&plan, &frames, &world.topology, &world.surface, &world.pool);
    let mut reader = Reader { batch, next: 0 };
    let mut all = Compared::default();
    for (ray, slots) in found.chunks(RAY_SAMPLES as usize).enumerate() {
        compare_ray(world, ray, slots, &mut reader, &mut all);
    }
    if reader.next != reader.batch.points.len() {
        all.wrong.push(format!("{} samples of the host have no slot", reader.batch.points.len()));
    }
    all
}

fn compare_ray(
    world: &World,
    ray: usize,
    slots: &[Sample],
    reader: &mut Reader,
    all: &mut Compared,
) {
    let mut is_there = [true; 2];
    for (slot, (found, kind)) in slots.iter().zip(KINDS).enumerate() {
        let point = Vec3::from(found.point);
        let twin = if is_there[1] { reader.take(kind, point) } else { None };
        let label = (found.kind != NONE).then_some(found.distance);
        if found.kind != NONE && found.kind != kind as u32 {
            all.wrong.push(format!("ray {ray} slot {slot} is of kind {}", found.kind));
        }
        if slot == 0 {
            is_there = [label.is_some(), twin.is_some()];
        }
        let skipped = if is_there[0] { None } else { Some(label.is_some()) };
        let expected = if is_there[1] {
            twin.map(|(label, ..)| label)
        } else {
            world.says(kind, point).filter(|_| slot > 0)
        };
        match skipped {
            Some(true) => all.wrong.push(format!("ray {ray} slot {slot} of a stale ray")),
            Some(false) if slot > 0 => continue,
            _ if same(label, expected) => {}
            _ if world.could_say(kind, point, label) => {
                all.edges += 1;
                continue;
            }
            _ => all.wrong.push(format!("ray {ray} slot {slot}: {label:?}, not {expected:?}")),
        }
        if let (Some(label), Some((_, occupancy, eikonal))) = (label, twin) {
            all.samples += 1;
            all.behind += usize::from(label < 0.0);
            if found.eikonal != u32::from(eikonal)
                || (found.occupancy != occupancy && label.abs() > LABEL_M)
            {
                all.wrong.push(format!("ray {ray} slot {slot}: other occupancy or coin"));
            }
        }
    }
    reader.skip_ray();
}

/// Fails unless the GPU draws what the host draws.
fn assert_same(world: &World, drawer: &mut Drawer, steps: u32, step: u32) -> Compared {
    let found = drawer.draw(world, steps, step);
    let all = compare(world, &found, step);
    assert!(all.wrong.is_empty(), "{} wrong: {:?}", all.wrong.len(), &all.wrong[..1]);
    assert!(all.samples > 2 * RAYS as usize && all.behind > 100, "too little: {all:?}");
    assert!(all.edges * EDGES < all.samples, "too many edges: {all:?}");
    all
}

#[test]
fn samples_are_drawn_and_labelled_as_on_the_host() {
    let data = Synthetic::room(60).with_width(160);
    let mut world = World::new();
    let mut drawer = Drawer::new(&world.config);
    for index in 0..12 {
        let told = world.see(&data, index);
        drawer.follow(&world, &told.changes());
        if index % 4 == 3 {
            let all = assert_same(&world, &mut drawer, 3, index as u32 % 3);
            println!("frame {index}: {} samples, {} edges", all.samples, all.edges);
        }
    }
    // One that is told all at once knows the same.
    let mut late = Drawer::new(&world.config);
    late.follow(&world, &world.everything().changes());
    assert_same(&world, &mut late, 1, 0);
    assert!(late.draw(&world, 1, 0) == drawer.draw(&world, 1, 0));
}

#[test]
fn labels_follow_a_box_that_moves_away() {
    const MOVES_AT: usize = 12;
    let data = Synthetic::moved_box(60, MOVES_AT).with_width(160);
    let mut world = World::new();
    // Each but the first is told less from when the box moves.
    let mut drawers: Vec<Drawer> = (0..4).map(|_| Drawer::new(&world.config)).collect();
    let mut removed = 0;
    for index in 0..MOVES_AT + 14 {
        let told = world.see(&data, index);
        removed += told.removed;
        let all = told.changes();
        let less = [
            all,
            Changes { measured: &[], ..all },
            Changes { surfels: &[], ..all },
            Changes { bricks: &[], ..all },
        ];
        for (drawer, less) in drawers.iter_mut().zip(less) {
            drawer.follow(&world, if index < MOVES_AT { &all } else { &less });
        }
    }
    assert!(removed > 100, "{removed} surfels removed");
    let all = assert_same(&world, &mut drawers[0], 1, 0);
    println!("{} samples, {} edges, {removed} surfels removed", all.samples, all.edges);
    for (i, drawer) in drawers.iter_mut().enumerate().skip(1) {
        let found = drawer.draw(&world, 1, 0);
        let wrong = compare(&world, &found, 0).wrong.len();
        println!("list {i} left out: {wrong} wrong");
        assert!(wrong > 10, "list {i} is not needed: {wrong} wrong");
    }
}

#[test]
fn a_frame_sends_little() {
    let data = Synthetic::room(300).with_width(1200);
    let mut world = World::new();
    let mut drawer = Drawer::new(&world.config);
    let bytes: Vec<usize> = (0..3)
        .map(|index| {
            let told = world.see(&data, index);
            drawer.follow(&world, &told.changes())
        })
        .collect();
    println!("{bytes:?} bytes");
    assert!(bytes[1..].iter().all(|&b| b < 10 << 20), "{bytes:?} bytes");
}

#[test]
fn work_is_that_of_the_cpu() {
    let data = Synthetic::room(60).with_width(160);
    let mut world = World::new();
    let mut cpu = CpuBackend::new(&world.config, world.pool.clone()).expect("settings");
    let mut gpu = GpuBackend::new(&world.config, Adapters::Any, 1024).expect("an adapter");
    for index in 0..4 {
        let told = world.see(&data, index);
        let frames: Vec<&KeyFrame> = world.window.iter().collect();
        let parameters = twin::parameters(Stencil::Forward);
        let work = Work { frames: &frames, plan: plan(&world), steps: 2, parameters };
        let mut reports = Vec::new();
        let backends: [&mut dyn Backend; 2] = [&mut cpu, &mut gpu];
        for backend in backends {
            backend.reserve(world.topology.rows()).expect("room");
            backend.follow(&world.scene(), &told.changes()).expect("room");
            backend.train(&world.scene(), &work).expect("steps");
            backend.finish().expect("results");
            reports.push(backend.report().expect("a report").step);
        }
        let [cpu, gpu] = reports[..] else { panic!("two reports") };
        assert!(cpu.samples > 2 * RAYS as usize);
        for (cpu, gpu) in [(cpu.samples, gpu.samples), (cpu.rows, gpu.rows)] {
            assert!(cpu.abs_diff(gpu) * EDGES <= cpu, "{cpu} and {gpu}");
        }
        for ((name, cpu), (_, gpu)) in cpu.losses.named().into_iter().zip(gpu.losses.named()) {
            assert!((cpu - gpu).abs() <= 0.01 * (cpu.abs() + 0.01), "{name}: {cpu} and {gpu}");
        }
    }
    // Nothing to draw from is no work.
    let work = Work {
        frames: &[],
        plan: plan(&world),
        steps: 2,
        parameters: twin::parameters(Stencil::Forward),
    };
    gpu.train(&world.scene(), &work).expect("no steps");
    gpu.finish().expect("results");
    assert_eq!(gpu.report().expect("a report").step.samples, 0);
}
