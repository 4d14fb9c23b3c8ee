//! What a mapper has of a room that a robot sees, and what each frame changes of it.

use super::*;
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::octree::Topology;
use crate::surface::{Lattice, Surface};
use crate::train::{KeyFrame, Pixel};

/// What the host has of a map.
pub(super) struct World {
    pub(super) config: MapConfig,
    pub(super) topology: Topology,
    pub(super) surface: Surface,
    pub(super) pool: Arc<rayon::ThreadPool>,
    /// The last five frames, and one from close by.
    pub(super) window: Vec<KeyFrame>,
    pub(super) frames: u32,
}

/// What a frame changed.
#[derive(Default)]
pub(super) struct Told {
    pub(super) nodes: Vec<u32>,
    pub(super) rows: Vec<u32>,
    pub(super) measured: Vec<u32>,
    pub(super) surfels: Vec<u32>,
    pub(super) bricks: Vec<u32>,
    pub(super) colors: Vec<u32>,
    pub(super) removed: usize,
}

impl Told {
    pub(super) fn changes(&self) -> Changes<'_> {
        Changes {
            nodes: &self.nodes,
            rows: &self.rows,
            voided: &[],
            measured: &self.measured,
            surfels: &self.surfels,
            bricks: &self.bricks,
            colors: &self.colors,
        }
    }
}

impl World {
    pub(super) fn new() -> Self {
        Self::of(twin::config(Profile::Lite))
    }

    /// A world that is seen in colour, if its map trains on colours.
    pub(super) fn of(config: MapConfig) -> Self {
        let lattice = Lattice::new(&config);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let mut surface = Surface::new(&config);
        if let Some(color) = &mut surface.color {
            color.band.limit(100_000);
        }
        Self {
            topology: Topology::new(lattice.unit_m, lattice.brick),
            surface,
            config,
            pool: Arc::new(pool),
            window: Vec::new(),
            frames: 0,
        }
    }

    /// Takes a frame in, as a mapper does.
    pub(super) fn see(&mut self, data: &Synthetic, index: usize) -> Told {
        let colored = self.config.radiance.rays_per_step > 0;
        let frame = data.load(index, colored).expect("a frame");
        self.frames += 1;
        let rows = self.topology.rows() as u32;
        let change =
            self.surface.integrate(&frame, None, self.frames, &mut self.topology, &self.pool);
        let pixels = self.config.key_frame_pixels as usize;
        let gain = colored.then_some(change.gain);
        let view = KeyFrame::new(&frame, None, pixels, self.config.r0_m, gain);
        self.window.pop();
        self.window.truncate(4);
        self.window.insert(0, view.clone());
        self.window.push(close_by(view));
        Told {
            nodes: self.topology.take_changed_nodes(),
            rows: (rows..self.topology.rows() as u32).chain(change.prior.rows).collect(),
            measured: change.prior.measured,
            surfels: change.surfels,
            bricks: change.touched_bricks,
            colors: change.colors,
            removed: change.surfels_removed,
        }
    }

    pub(super) fn everything(&self) -> Told {
        Told {
            nodes: (0..self.topology.node_slots() as u32).collect(),
            rows: (0..self.topology.rows() as u32).collect(),
            measured: (0..self.topology.rows() as u32).collect(),
            surfels: (0..self.surface.surfels.slots() as u32).collect(),
            bricks: (0..self.surface.evidence.bricks() as u32).collect(),
            colors: (0..self.blocks()).collect(),
            removed: 0,
        }
    }

    fn blocks(&self) -> u32 {
        self.surface.color.as_ref().map_or(0, |color| color.band.blocks() as u32)
    }

    pub(super) fn scene(&self) -> Scene<'_> {
        let prior = self.surface.prior.values();
        Scene { topology: &self.topology, surface: &self.surface, prior }
    }
}

/// The middle pixel of a frame as if it were seen from nearer than free space begins.
fn close_by(mut frame: KeyFrame) -> KeyFrame {
    let pixel = frame.pixels[frame.pixels.len() / 2];
    let close = Pixel { z: 0.13, ..pixel };
    frame.origin += frame.direction(pixel) * (pixel.z - close.z);
    frame.pixels = [close].into();
    frame.colors = frame.colors.iter().take(1).copied().collect();
    frame
}
