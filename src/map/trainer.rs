//! Which backend trains a map, and what becomes of the map when it fails.

use std::sync::Arc;

use super::mapper::{Mapper, scene};
use super::view::MapView;
use crate::backend::{
    Adapters, Backend, BackendState, Changes, ColorRows, CpuBackend, DecoderState, GpuBackend,
    LearnedRow, RowMoments,
};
use crate::config::{BackendChoice, GpuSettings, Renderer};
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
        let radiance = &self.config.radiance;
        let compares = self.config.has("radiance") && radiance.rays_per_step > 0;
        if compares && radiance.renderer == Renderer::Tile {
            let problem = "a GPU compares colours by rays: color_renderer must be ray, or the \
                           backend cpu";
            return Err(Error::invalid("backend", problem));
        }
        GpuBackend::new(&self.config, adapters, trainer.gpu_memory_mib)
    }

    fn change_backend(&mut self, mut backend: Box<dyn Backend>) -> Result<()> {
        self.backend.finish()?;
        let state = self.backend.export()?;
        self.introduce(&mut *backend)?;
        backend.import(state)?;
        self.backend = backend;
        // They are the other backend's, and so is the time of its labels.
        self.stats.passes.clear();
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
        let blocks = self.surface.color.as_ref().map_or(0, |color| color.band.blocks() as u32);
        let blocks: Vec<u32> = (0..blocks).collect();
        let everything = Changes {
            nodes: &nodes,
            rows: &rows,
            voided: &[],
            measured: &rows,
            surfels: &surfels,
            bricks: &bricks,
            colors: &blocks,
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
            colors: ColorRows {
                first: vec![[0.0; 3]; self.learned_colors.len()],
                second: vec![[0.0; 3]; self.learned_colors.len()],
                steps: vec![0; self.learned_colors.len()],
                learned: self.learned_colors.clone(),
            },
        };
        let mut cpu = CpuBackend::new(&self.config, self.trainers.clone())?;
        self.introduce(&mut cpu)?;
        cpu.import(state)?;
        self.backend = Box::new(cpu);
        self.trainer = Trainer::CPU;
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::backend::{Scene, Work, WorkReport};
    use crate::config::{MapConfig, MapSettings};
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;
    use crate::map::Fields;
    use crate::modality::Decoders;

    /// A backend whose device is lost with the next step.
    struct Lost(Box<dyn Backend>);

    impl Backend for Lost {
        fn adapter(&self) -> Option<&str> {
            Some("a test")
        }

        fn gpu_peak_bytes(&self) -> u64 {
            self.0.gpu_peak_bytes()
        }

        fn reserve(&mut self, rows: usize) -> Result<usize> {
            self.0.reserve(rows)
        }

        fn follow(&mut self, scene: &Scene<'_>, changes: &Changes<'_>) -> Result<()> {
            self.0.follow(scene, changes)
        }

        fn train(&mut self, _: &Scene<'_>, _: &Work<'_>) -> Result<()> {
            Err(Error::DeviceLost("taken away by a test".into()))
        }

        fn finish(&mut self) -> Result<()> {
            Err(Error::DeviceLost("taken away by a test".into()))
        }

        fn report(&mut self) -> Option<WorkReport> {
            None
        }

        fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow)) {
            self.0.read_changed(visit);
        }

        fn read_changed_colors(&mut self, visit: &mut dyn FnMut(u32, &[[f32; 3]])) {
            self.0.read_changed_colors(visit);
        }

        fn decoders(&self) -> Arc<Decoders> {
            self.0.decoders()
        }

        fn export(&self) -> Result<BackendState> {
            Err(Error::DeviceLost("taken away by a test".into()))
        }

        fn import(&mut self, state: BackendState) -> Result<()> {
            self.0.import(state)
        }

        fn memory_bytes(&self) -> u64 {
            self.0.memory_bytes()
        }
    }

    /// Takes the device away from a mapper.
    pub(crate) fn lose_device(mapper: &mut Mapper) -> Result<()> {
        let cpu = CpuBackend::new(&mapper.config, mapper.trainers.clone())?;
        let backend = std::mem::replace(&mut mapper.backend, Box::new(cpu));
        mapper.backend = Box::new(Lost(backend));
        Ok(())
    }

    #[test]
    fn a_gpu_is_refused_what_only_the_cpu_does() {
        let settings = MapSettings {
            color_rays: 64,
            color_renderer: Renderer::Tile,
            ..MapSettings::default()
        };
        let config = MapConfig::from_settings(&settings).expect("good");
        let mut mapper = Mapper::new(config).expect("an empty map");
        let trainer = Trainer { backend: BackendChoice::Gpu, ..Trainer::CPU };
        let refused = mapper.train_on(trainer).expect_err("tiles").to_string();
        assert!(refused.contains("color_renderer"), "{refused}");
        let trainer = Trainer { backend: BackendChoice::Auto, ..trainer };
        mapper.train_on(trainer).expect("the CPU does it");
        assert_eq!(mapper.adapter(), None);
    }

    #[test]
    fn what_readers_had_survives_a_lost_device() {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        let room = Synthetic::room(100).with_width(64);
        let mut mapper = Mapper::new(config).expect("an empty map");
        for index in 0..3 {
            mapper.integrate(&room.load(index, false).expect("a frame")).expect("integrated");
        }
        let before = mapper.publish_all().expect("a view");
        lose_device(&mut mapper).expect("a CPU backend");
        let lost = mapper.integrate(&room.load(3, false).expect("a frame"));
        assert!(matches!(lost, Err(Error::DeviceLost(_))), "{lost:?}");
        assert!(mapper.state().is_err(), "there is nothing to read");

        mapper.rescue().expect("the CPU takes over");
        assert_eq!(mapper.adapter(), None);
        let learned = mapper.state().expect("a state").backend.learned;
        assert!(learned.iter().any(|row| row.sdf_feature[0] != 0.0), "what was learned is there");
        // The lost frame's surfaces are in the map; places that it did not touch answer as before.
        let points: Vec<_> = mapper.topology.positions().iter().step_by(7).copied().collect();
        let (old, new) = (
            before.query(&points, Fields::DISTANCE),
            mapper.publish().query(&points, Fields::DISTANCE),
        );
        let known: Vec<f32> = old
            .distance
            .iter()
            .zip(&new.distance)
            .filter(|(old, new)| old.is_finite() && new.is_finite())
            .map(|(old, new)| (old - new).abs())
            .collect();
        let same = known.iter().filter(|&&difference| difference < 1e-3).count();
        assert!(known.len() > 100 && same * 10 > known.len() * 8, "{same} of {}", known.len());
        mapper.integrate(&room.load(4, false).expect("a frame")).expect("mapping goes on");
    }
}
