//! Which backend trains a map, and what becomes of the map when it fails.

use std::sync::Arc;

use super::mapper::{Mapper, scene};
use super::view::MapView;
use crate::backend::{
    Adapters, Backend, BackendState, Changes, CpuBackend, DecoderState, GpuBackend, LearnedRow,
    RowMoments,
};
use crate::config::{BackendChoice, GpuSettings};
use crate::error::{Error, Result};
use crate::modality::RowSource;

/// What a machine gives to training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trainer {
    pub backend: BackendChoice,
    /// Memory of the GPU that rows may take, MiB.
    pub gpu_memory_mib: u32,
}

impl Trainer {
    /// Trains on the CPU.
    pub const CPU: Self = Self { backend: BackendChoice::Cpu, gpu_memory_mib: 0 };

    /// A choice, with the memory that the settings file gives.
    pub fn of(backend: BackendChoice) -> Self {
        Self { backend, gpu_memory_mib: GpuSettings::default().memory_mib }
    }
}

impl Mapper {
    /// The GPU that the map is trained on; `None` for the CPU.
    pub fn adapter(&self) -> Option<&str> {
        self.backend.adapter()
    }

    /// Most memory of the GPU that was in use so far, bytes; 0 without one.
    pub fn gpu_peak_bytes(&self) -> u64 {
        self.backend.gpu_peak_bytes()
    }

    /// Goes on training elsewhere, with everything that was learned. With [`BackendChoice::Auto`]
    /// it is the GPU if there is a hardware adapter that can be used, else the CPU.
    pub fn train_on(&mut self, trainer: Trainer) -> Result<()> {
        let backend: Box<dyn Backend> = match trainer.backend {
            BackendChoice::Cpu => return self.train_on_cpu(trainer),
            BackendChoice::Gpu => Box::new(self.open_gpu(Adapters::Any, trainer)?),
            BackendChoice::Auto => match self.open_gpu(Adapters::Hardware, trainer) {
                Ok(gpu) => Box::new(gpu),
                Err(reason) => {
                    tracing::info!(%reason, "training on the CPU");
                    return self.train_on_cpu(trainer);
                }
            },
        };
        self.change_backend(backend)?;
        self.trainer = trainer;
        tracing::info!(gpu = self.adapter(), "training");
        Ok(())
    }

    fn train_on_cpu(&mut self, trainer: Trainer) -> Result<()> {
        if self.trainer != Trainer::CPU {
            let cpu = CpuBackend::new(&self.config, self.trainers.clone())?;
            self.change_backend(Box::new(cpu))?;
        }
        self.trainer = Trainer { backend: BackendChoice::Cpu, ..trainer };
        Ok(())
    }

    fn open_gpu(&self, adapters: Adapters, trainer: Trainer) -> Result<GpuBackend> {
        GpuBackend::new(&self.config, adapters, trainer.gpu_memory_mib)
    }

    fn change_backend(&mut self, mut backend: Box<dyn Backend>) -> Result<()> {
        self.backend.finish()?;
        let state = self.backend.export()?;
        self.introduce(&mut *backend)?;
        backend.import(state)?;
        self.backend = backend;
        Ok(())
    }

    /// Tells a new backend of everything that there is.
    pub(super) fn introduce(&self, backend: &mut dyn Backend) -> Result<()> {
        let nodes: Vec<u32> = (0..self.topology.node_slots() as u32).collect();
        let rows: Vec<u32> = (0..self.topology.rows() as u32).collect();
        if backend.reserve(rows.len())? < rows.len() {
            return Err(Error::ResourceExhausted {
                what: backend.adapter().unwrap_or("the CPU backend").to_owned(),
                limit: format!("has no room for {} rows: see gpu.memory_mib", rows.len()),
            });
        }
        let surfels: Vec<u32> = (0..self.surface.surfels.slots() as u32).collect();
        let bricks: Vec<u32> = (0..self.surface.evidence.bricks() as u32).collect();
        let everything = Changes {
            nodes: &nodes,
            rows: &rows,
            voided: &[],
            measured: &rows,
            surfels: &surfels,
            bricks: &bricks,
        };
        let scene = scene(&self.config, &self.topology, &self.surface, &self.no_prior);
        backend.follow(&scene, &everything)
    }

    /// Waits for all training: what is published next holds it.
    pub fn finish(&mut self) -> Result<()> {
        self.backend.finish()?;
        self.hear();
        Ok(())
    }

    /// Waits for all training, and publishes it with the rest.
    pub fn publish_all(&mut self) -> Result<Arc<MapView>> {
        self.finish()?;
        Ok(self.publish())
    }

    /// After the backend failed: takes back what readers have of it, so that the map can be saved
    /// and mapped on, by the CPU. Adam's memory is lost.
    pub fn rescue(&mut self) -> Result<()> {
        let decoders = self.backend.decoders();
        let learned = |row: u32| {
            let features = self.store.row(row).features;
            LearnedRow {
                sdf_feature: features.sdf.map(|half| half.widen()),
                occupancy_feature: features.occupancy.map(|half| half.widen()),
                explicit: self.learned[row as usize],
            }
        };
        let published = self.learned.len();
        let mut rows: Vec<LearnedRow> = (0..published as u32).map(learned).collect();
        rows.resize(self.topology.rows(), LearnedRow::default());
        let state = BackendState {
            moments: vec![RowMoments::ZERO; rows.len()],
            learned: rows,
            sdf: DecoderState::of(&decoders.sdf),
            occupancy: DecoderState::of(&decoders.occupancy),
        };
        let mut cpu = CpuBackend::new(&self.config, self.trainers.clone())?;
        self.introduce(&mut cpu)?;
        cpu.import(state)?;
        self.backend = Box::new(cpu);
        self.trainer = Trainer::CPU;
        Ok(())
    }
}
