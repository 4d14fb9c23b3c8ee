//! From the mapper's state to a view: what has changed is written into pages that views share.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::language::Viewpoint;
use super::mapper::Mapper;
use super::view::{BRICKS, MapView, NODES, Node, ROWS};
use crate::config::Prior;
use crate::geometry::Aabb;
use crate::modality::radiance::{self, Texel};
use crate::modality::{Features, Row};
use crate::octree::{Explicit, NO_BLOCK, NO_NODE, NO_ROW, NodeSource};
use crate::surface::Lattice;

impl Mapper {
    /// Publishes everything so far as an immutable view, of a new epoch if anything has changed.
    pub fn publish(&mut self) -> Arc<MapView> {
        let start = Instant::now();
        self.stats.epoch += u64::from(std::mem::take(&mut self.changed));
        self.find_painted();
        self.find_coded();
        self.find_carved();
        self.write_nodes();
        self.write_rows();
        self.store.bricks.grow(self.surface.evidence.bricks().div_ceil(BRICKS));
        for brick in std::mem::take(&mut self.changed_bricks) {
            let page = self.store.bricks.write(brick as usize / BRICKS);
            page.known[brick as usize % BRICKS] = *self.surface.evidence.known(brick);
        }
        self.write_colors();
        self.write_codes();
        self.stage("publish", start);
        self.schedule.learn_publish(start.elapsed());
        Arc::new(MapView {
            epoch: self.stats.epoch,
            newest_stamp_ns: self.newest_stamp_ns,
            config: self.config.clone(),
            decoders: self.backend.decoders(),
            store: self.store.clone(),
            viewpoints: self.viewpoints(),
        })
    }

    /// Where key frames were taken from.
    fn viewpoints(&mut self) -> Arc<[Viewpoint]> {
        if self.key_frames.take_changed() {
            self.viewpoints = self.key_frames.iter().map(Viewpoint::new).collect();
        }
        self.viewpoints.clone()
    }

    /// Brings the view's rows up to date: prior plus what the backend learned.
    fn write_rows(&mut self) {
        let rows = self.topology.rows();
        self.store.rows.grow(rows.div_ceil(ROWS));
        self.learned.resize(rows, [0.0; 4]);
        let closed = self.config.prior == Prior::Closed;
        let prior = if closed { self.surface.prior.values() } else { &self.no_prior[..] };
        let (pages, learned) = (&mut self.store.rows, &mut self.learned);
        let explicit = |row: u32, learned: &Explicit| {
            std::array::from_fn(|i| prior[row as usize][i] + learned[i])
        };
        self.backend.read_changed(&mut |row, values| {
            pages.write(row as usize / ROWS).rows[row as usize % ROWS] = Row {
                explicit: explicit(row, &values.explicit),
                features: Features::nearest(&values.sdf_feature, &values.occupancy_feature),
            };
            learned[row as usize] = values.explicit;
        });
        for row in std::mem::take(&mut self.changed_rows) {
            let page = pages.write(row as usize / ROWS);
            page.rows[row as usize % ROWS].explicit = explicit(row, &learned[row as usize]);
        }
    }

    /// Adds the nodes of blocks of colour that are new to the changed ones.
    fn find_painted(&mut self) {
        let Some(color) = &self.surface.color else { return };
        let r0 = Lattice::new(&self.config).r0;
        for cell in &color.band.cells()[self.store.color_blocks..] {
            let nodes = &mut self.changed_nodes;
            self.topology.visit_nodes(cell.map(|c| c << r0), r0, &mut |node| nodes.push(node));
        }
    }

    /// Adds the nodes of blocks of codes that are new to the changed ones.
    fn find_coded(&mut self) {
        let Some(language) = &self.language else { return };
        let size = Lattice::new(&self.config).code_cell(&self.config);
        for cell in &language.band.cells()[self.store.codes.blocks()..] {
            let nodes = &mut self.changed_nodes;
            self.topology.visit_nodes(cell.map(|c| c << size), size, &mut |node| nodes.push(node));
        }
    }

    /// Adds the nodes of bricks of evidence that are new to the changed ones: some stood there before.
    fn find_carved(&mut self) {
        let lattice = Lattice::new(&self.config);
        let (evidence, nodes) = (&self.surface.evidence, &mut self.changed_nodes);
        for brick in self.store.placed_bricks as u32..evidence.bricks() as u32 {
            let cell = evidence.brick_cell(brick).map(|c| c << lattice.cell);
            self.topology.visit_nodes(cell, lattice.brick, &mut |node| nodes.push(node));
        }
        self.store.placed_bricks = evidence.bricks();
    }

    fn write_codes(&mut self) {
        let Some(language) = &self.language else { return };
        let mut changed = std::mem::take(&mut self.changed_codes);
        changed.sort_unstable();
        changed.dedup();
        let learned = language.contract().cloned().zip(language.dictionary());
        self.store.codes.write(&language.band, learned, changed, |row| language.code(row));
    }

    fn write_colors(&mut self) {
        let Some(color) = &self.surface.color else { return };
        let mut changed = std::mem::take(&mut self.changed_colors);
        let learned = &mut self.learned_colors;
        self.backend.read_changed_colors(&mut |block, values| {
            let rows = block as usize * values.len();
            if learned.len() < rows + values.len() {
                learned.resize(rows + values.len(), [0.0; 3]);
            }
            learned[rows..rows + values.len()].copy_from_slice(values);
            changed.push(block);
        });
        changed.sort_unstable();
        changed.dedup();
        self.store.write_colors(&color.band, changed, |block, texels, harmonics| {
            let rows = block as usize * texels.len();
            for (i, (texel, seen)) in texels.iter_mut().zip(&color.seen()[rows..]).enumerate() {
                let logits = (seen.weight > 0.0).then(|| {
                    let learned = learned.get(rows + i).copied().unwrap_or_default();
                    radiance::logits(Vec3::from(seen.color)) + Vec3::from(learned)
                });
                let distance = color.relief().get(rows + i).and_then(|seen| seen.distance());
                *texel = Texel::new(logits, distance);
            }
            let width = harmonics.len() / texels.len();
            for (row, harmonics) in (rows as u32..).zip(harmonics.chunks_exact_mut(width.max(1))) {
                radiance::write_harmonics(color.harmonics(row), harmonics);
            }
        });
    }

    fn write_nodes(&mut self) {
        let mut nodes = std::mem::take(&mut self.changed_nodes);
        nodes.sort_unstable();
        nodes.dedup();
        self.store.root = self.topology.root();
        self.store.node_slots = self.topology.node_slots();
        self.store.nodes.grow(self.topology.node_slots().div_ceil(NODES));
        let lattice = Lattice::new(&self.config);
        let (r0, code_cell) = (lattice.r0, lattice.code_cell(&self.config));
        let mut bounds = self.store.bounds.unwrap_or(Aabb::EMPTY);
        for node in nodes {
            let page = self.store.nodes.write(node as usize / NODES);
            let i = node as usize % NODES;
            page.children[i] = self.topology.children(node);
            let low = self.topology.min_m(node);
            let corners = *self.topology.corners(node);
            let carries = corners[0] != NO_ROW;
            // A slot without a node has no size.
            let middle = || low + 0.5 * self.topology.size_m(node);
            let brick = carries.then(middle).and_then(|at| self.surface.evidence.find(at));
            let (cell, log2_size) = (self.topology.low_corner(node), self.topology.log2_size(node));
            let color = self.surface.color.as_ref().filter(|_| carries && log2_size <= r0);
            let block = color.and_then(|color| color.band.find(cell.map(|c| c >> r0)));
            let language = self.language.as_ref().filter(|_| carries && log2_size <= r0);
            let code_block =
                language.and_then(|language| language.band.find(cell.map(|c| c >> code_cell)));
            page.nodes[i] = Node {
                corners,
                brick: brick.map_or(NO_NODE, |b| b.brick),
                block: block.unwrap_or(NO_BLOCK),
                code_block: code_block.unwrap_or(NO_BLOCK),
                low: cell,
                log2_size,
            };
            if carries {
                bounds.extend(low);
                bounds.extend(low + self.topology.size_m(node));
            }
        }
        self.store.bounds = (!bounds.is_empty()).then_some(bounds);
    }
}
