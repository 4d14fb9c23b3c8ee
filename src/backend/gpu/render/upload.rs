//! What a view's change takes to the GPU, and what is worked out of it there.

use super::super::layout::harmonic_words;
use super::super::passes::Passes;
use super::super::writes::Writes;
use super::scene::{BlockRecord, Extent, GpuScene, NodeRecord, feature_words};
use super::{GpuRenderer, layout};
use crate::error::Result;
use crate::modality::Row;
use crate::modality::decoder::Decoder;
use crate::modality::density::FAR;
use crate::surface::Known;

/// Records that are uploaded together, ...
const BATCH: usize = 1 << 15;
/// ... fewer where they are long.
const BATCH_WORDS: usize = 1 << 22;
/// Most workgroups of a pass; they loop.
const GROUPS: u32 = 1 << 14;

impl GpuRenderer {
    /// A scene of nothing.
    pub fn scene(&self) -> Result<GpuScene> {
        GpuScene::new(&self.gpu)
    }

    /// Makes room for a view; to be called before anything of it is written.
    pub fn begin(&self, scene: &mut GpuScene, extent: &Extent) -> Result<()> {
        scene.reserve(&self.gpu, extent)?;
        scene.extent = Some(*extent);
        scene.list = None;
        self.gpu.check()
    }

    /// Writes nodes that changed.
    pub fn write_nodes(
        &self,
        scene: &GpuScene,
        nodes: impl Iterator<Item = (u32, NodeRecord)>,
    ) -> Result<()> {
        self.in_batches(nodes, |batch, writes| {
            let each = || batch.iter();
            writes.add(&scene.links, each().map(|(id, node)| (*id, [node.link])));
            writes.add(&scene.corners, each().map(|(id, node)| (*id, node.corners)));
            writes.add(&scene.nodes, each().map(|(id, node)| (*id, node.words())));
        })
    }

    /// Writes vertex rows that changed.
    pub fn write_rows<'a>(
        &self,
        scene: &GpuScene,
        rows: impl Iterator<Item = (u32, &'a Row)>,
    ) -> Result<()> {
        self.in_batches(rows, |batch, writes| {
            let each = || batch.iter();
            let explicit = |row: &Row| row.explicit.map(f32::to_bits);
            writes.add(&scene.rows, each().map(|(id, row)| (*id, explicit(row))));
            writes.add(&scene.features, each().map(|(id, row)| (*id, feature_words(row))));
        })
    }

    /// Writes bricks of evidence that changed.
    pub fn write_bricks<'a>(
        &self,
        scene: &GpuScene,
        bricks: impl Iterator<Item = (u32, &'a Known)>,
    ) -> Result<()> {
        self.in_batches(bricks, |batch, writes| {
            let halves = batch.iter().flat_map(|(id, known)| {
                let words: [[u32; 8]; 2] = bytemuck::cast(**known);
                [(2 * id, words[0]), (2 * id + 1, words[1])]
            });
            writes.add(&scene.bricks, halves);
        })
    }

    /// Writes blocks of colour that changed.
    pub fn write_blocks<'a>(
        &self,
        scene: &GpuScene,
        blocks: impl Iterator<Item = (u32, BlockRecord<'a>)>,
    ) -> Result<()> {
        let mut blocks = blocks.peekable();
        let words = |block: &BlockRecord<'_>| 2 * (block.texels.len() + block.harmonics.len());
        let most = blocks.peek().map_or(1, |(_, first)| BATCH_WORDS / words(first).max(1));
        self.in_batches_of(most.clamp(1, BATCH), blocks, |batch, writes| {
            let each = || batch.iter();
            writes.add(&scene.blocks, each().map(|(id, block)| (*id, *block.uppers)));
            let texels = |block: &BlockRecord<'_>| bytemuck::pod_collect_to_vec(block.texels);
            writes.add_pairs(&scene.texels, each().map(|(id, block)| (*id, texels(block))));
            let harmonics = |block: &BlockRecord<'_>| harmonic_words(block.harmonics);
            writes.add_pairs(&scene.harmonics, each().map(|(id, block)| (*id, harmonics(block))));
        })
    }

    /// Writes the decoder of distances.
    pub fn write_decoder(&self, scene: &mut GpuScene, decoder: &Decoder) -> Result<()> {
        let weights = decoder.weights();
        scene.weights.grow(&self.gpu, weights.len().div_ceil(4) as u64)?;
        self.gpu.write(&scene.weights.buffer, weights);
        Ok(())
    }

    /// After everything was written: decodes distances at vertices and lists the cubes that take
    /// light of surfaces of a sharpness. Waits for their number.
    pub fn settle(&self, scene: &mut GpuScene, decoder: &Decoder, sharpness: f32) -> Result<()> {
        let Some(extent) = scene.extent else { return Ok(()) };
        self.gpu.write(&scene.step, &[GpuScene::lattice(&extent)]);
        loop {
            let (leaf_room, room) = (scene.leaves.capacity(), scene.cubes.capacity());
            let numbers = layout::Scene {
                room: leaf_room as u32,
                cube_room: room as u32,
                ..self.numbers(&extent, decoder, sharpness)
            };
            self.gpu.write(&scene.numbers, &[numbers]);
            let mut passes = Passes::new(&self.gpu, None);
            passes.encoder.clear_buffer(&scene.listed_leaves, 0, None);
            passes.encoder.clear_buffer(&scene.listed, 0, None);
            let buffers = scene.buffers();
            let groups = |items: usize| (items as u32).div_ceil(64).min(GROUPS);
            let vertices = self.kernel("render/vertices")?.bind(&self.gpu, &buffers)?;
            vertices.dispatch(&mut passes, groups(extent.rows));
            let list = self.kernel("render/list")?.bind(&self.gpu, &buffers)?;
            list.dispatch(&mut passes, groups(extent.nodes));
            let relief = self.kernel("render/relief")?.bind(&self.gpu, &buffers)?;
            relief.dispatch(&mut passes, groups(leaf_room as usize));
            self.gpu.queue.submit([passes.encoder.finish()]);
            let count = |buffer| -> Result<u32> {
                Ok(self.gpu.read::<u32>(buffer, 1)?.first().copied().unwrap_or(0))
            };
            let (leaves, listed) = (count(&scene.listed_leaves)?, count(&scene.listed)?);
            if u64::from(leaves) <= leaf_room && u64::from(listed) <= room {
                scene.list = Some((sharpness, listed));
                return self.gpu.check();
            }
            scene.reserve_leaves(&self.gpu, leaves.into())?;
            scene.reserve_cubes(&self.gpu, listed.into())?;
        }
    }

    /// Whether cubes are listed for a sharpness.
    pub fn is_settled(scene: &GpuScene, sharpness: f32) -> bool {
        scene.list.is_some_and(|(listed, _)| listed == sharpness)
    }

    fn numbers(&self, extent: &Extent, decoder: &Decoder, sharpness: f32) -> layout::Scene {
        let shape = decoder.shape();
        let (fine_log2, cell_log2) = extent.cube_lattice();
        layout::Scene {
            nodes: extent.nodes as u32,
            rows: extent.rows as u32,
            room: 0,
            surface_log2: extent.surface_log2.into(),
            light_m: FAR / sharpness,
            cell_m: extent.cell_m,
            band_scale: extent.band.side() as f32 / extent.band.cell_m,
            band_log2: extent.band.log2_side.into(),
            inputs: shape.inputs as u32,
            first: shape.first as u32,
            second: shape.second as u32,
            scale: decoder.scale(),
            cube_room: 0,
            fine_log2,
            largest_log2: u32::from(extent.surface_log2) + fine_log2,
            cell_log2,
            harmonics: extent.harmonics as u32,
        }
    }

    fn in_batches<'p, T>(
        &self,
        records: impl Iterator<Item = T>,
        add: impl for<'w> Fn(&'w [T], &mut Writes<'p>),
    ) -> Result<()> {
        self.in_batches_of(BATCH, records, add)
    }

    /// Hands records on in batches of `most`, each uploaded before the next one is put together.
    fn in_batches_of<'p, T>(
        &self,
        most: usize,
        records: impl Iterator<Item = T>,
        add: impl for<'w> Fn(&'w [T], &mut Writes<'p>),
    ) -> Result<()> {
        let mut records = records.peekable();
        while records.peek().is_some() {
            let batch: Vec<T> = records.by_ref().take(most).collect();
            let mut writes = Writes::default();
            add(&batch, &mut writes);
            let mut passes = Passes::new(&self.gpu, None);
            self.writer.record(&self.gpu, &mut passes, writes)?;
            self.gpu.queue.submit([passes.encoder.finish()]);
        }
        self.gpu.check()
    }
}
