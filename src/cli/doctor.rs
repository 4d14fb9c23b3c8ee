//! `orenx doctor`: what this machine can train on, and whether it does so rightly.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use clap::Args;
use glam::Vec3;

use super::map::processor;
use crate::backend::{AdapterReport, Adapters, GpuBackend, adapters};
use crate::config::{BackendChoice, GpuSettings, MapConfig, MapSettings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::error::{Error, Result};
use crate::geometry::random::{pcg4d, unit};
use crate::geometry::simd::InstructionSet;
use crate::map::{Fields, MapView, Mapper, Trainer};

/// Frames of the self-test, their width, and the points that both maps are asked about.
const FRAMES: usize = 3;
const WIDTH: u32 = 96;
const POINTS: u32 = 20_000;
/// Most that the maps of two backends may differ by at any point, m: a hundredth of what a map is
/// off by.
const TOLERANCE_M: f32 = 1e-4;

/// Say what this machine has for training, and test the GPU backend against the CPU's
#[derive(Debug, Args)]
pub struct DoctorArgs {}

impl DoctorArgs {
    pub fn run(self) -> anyhow::Result<()> {
        println!("processor: {}", processor());
        println!("instructions: {:?}", InstructionSet::detect());
        let found = adapters();
        if found.is_empty() {
            println!("adapters: none; the machine has no Vulkan driver, and maps train on the CPU");
            return Ok(());
        }
        for adapter in &found {
            describe(adapter);
        }
        let usable = |a: &&AdapterReport| a.unfit.is_none();
        if !found.iter().any(|a| usable(&a)) {
            println!("maps train on the CPU: no adapter can be used");
            return Ok(());
        }
        let hardware = found.iter().filter(usable).any(|a| a.is_hardware);
        println!(
            "backend \"auto\" is the {}",
            if hardware { "GPU" } else { "CPU: there is software Vulkan alone, which is slower" }
        );
        kernels()?;
        self_test()
    }
}

fn describe(adapter: &AdapterReport) {
    println!("adapter: {}, {}, driver {}", adapter.name, adapter.kind, adapter.driver);
    for (what, limit) in &adapter.limits {
        println!("  {limit} {what}");
    }
    println!("  timestamps: {}", if adapter.has_timestamps { "yes" } else { "no" });
    if let Some(why) = &adapter.unfit {
        println!("  cannot be used: {why}");
    }
}

/// Compiles the kernels of the default settings and says which variants they are.
fn kernels() -> Result<()> {
    let config = MapConfig::from_settings(&MapSettings::default())?;
    let memory_mib = GpuSettings::default().memory_mib;
    let gpu = GpuBackend::new(&config, Adapters::Any, memory_mib)?;
    println!("kernels, row gradients in 32-bit fixed point:");
    for (name, variant) in gpu.kernels() {
        println!("  {name}: {}", if variant.is_empty() { "one variant" } else { &variant });
    }
    Ok(())
}

/// Maps the same frames on both backends and compares what the maps say.
fn self_test() -> anyhow::Result<()> {
    let start = Instant::now();
    let cpu = map_on(BackendChoice::Cpu)?;
    let gpu = map_on(BackendChoice::Gpu).context("the self-test on the GPU")?;
    let points: Vec<Vec3> = (0..POINTS)
        .map(|i| {
            let [x, y, z, _] = pcg4d([0, 0, 0, i]);
            Vec3::new(unit(x), unit(y), unit(z)) * 8.0 - 4.0
        })
        .collect();
    let largest = |of: fn(&crate::map::PointAnswers) -> &[f32]| {
        let answer = |view: &MapView| of(&view.query(&points, Fields::ALL)).to_vec();
        let (cpu, gpu) = (answer(&cpu), answer(&gpu));
        let differences = cpu.iter().zip(&gpu).filter(|(c, g)| c.is_finite() || g.is_finite());
        // Known to one and not to the other counts as infinitely far.
        differences
            .map(|(c, g)| (c - g).abs())
            .fold(0.0f32, |m, d| m.max(if d.is_nan() { f32::INFINITY } else { d }))
    };
    let distance = largest(|answers| &answers.distance);
    let occupancy = largest(|answers| &answers.occupancy);
    println!(
        "self-test: {FRAMES} frames on both backends, {POINTS} points, {:.1} s: largest difference \
         {:.4} mm in distance, {occupancy:.6} in occupancy",
        start.elapsed().as_secs_f32(),
        distance * 1e3,
    );
    if distance > TOLERANCE_M {
        return Err(Error::Internal(format!(
            "the backends' maps differ by {distance} m, more than {TOLERANCE_M}"
        ))
        .into());
    }
    Ok(())
}

fn map_on(backend: BackendChoice) -> Result<Arc<MapView>> {
    let mut mapper = Mapper::new(MapConfig::from_settings(&MapSettings::default())?)?;
    mapper.train_on(Trainer::of(backend))?;
    let room = Synthetic::room(FRAMES * 20).with_width(WIDTH);
    for index in 0..FRAMES {
        mapper.integrate(&room.load(index, false)?)?;
    }
    mapper.publish_all()
}
