//! What changed between two views.

use std::ops::ControlFlow;
use std::sync::Arc;

use super::slots::{BlockSlot, NodeSlot};
use super::{Copied, Head, Part, Table};
use crate::map::pages::PageTable;
use crate::map::view::{BLOCKS, BRICKS, MapView, NODES, NodePage, ROWS};
use crate::modality::radiance;
use crate::octree::NO_BLOCK;

/// The way from one view to a later one.
pub struct Changes<'a> {
    view: &'a MapView,
    /// Of the same map; `None`: an empty view.
    old: Option<&'a MapView>,
    copied: Copied,
}

/// Where parts go; breaks when nobody wants any more.
type Sink<'a> = &'a mut dyn FnMut(Part) -> ControlFlow<()>;

impl MapView {
    /// What changed since `old`, an earlier view; everything if that is of another map.
    pub fn changes<'a>(&'a self, old: Option<&'a MapView>, copied: Copied) -> Changes<'a> {
        let old = old.filter(|old| Arc::ptr_eq(&self.config, &old.config));
        Changes { view: self, old, copied }
    }
}

impl Changes<'_> {
    /// How large the new view is.
    pub fn head(&self) -> Head {
        let Self { view, copied, .. } = *self;
        let store = &view.store;
        let mut config = view.config.clone();
        if !copied.radiance || !copied.language {
            let left = |name: &String| match name.as_str() {
                "radiance" => copied.radiance,
                "language" => copied.language,
                _ => true,
            };
            Arc::make_mut(&mut config).modalities.retain(left);
        }
        let learned = store.codes.learned().filter(|_| copied.language);
        let count = |table| match table {
            Table::Nodes => store.node_slots,
            Table::Rows => store.rows.len() * ROWS,
            Table::Bricks => store.bricks.len() * BRICKS,
            Table::Colors if copied.radiance => store.color_blocks,
            Table::Codes if copied.language => store.codes.blocks(),
            Table::Atoms => learned.map_or(0, |(_, dictionary)| dictionary.len()),
            Table::Colors | Table::Codes => 0,
            Table::Decoders => 2,
            Table::Viewpoints => view.viewpoints.len(),
        };
        Head {
            from_epoch: self.old.map(|old| old.epoch),
            epoch: view.epoch,
            newest_stamp_ns: view.newest_stamp_ns,
            config,
            root: store.root,
            bounds: store.bounds,
            slots: Table::ALL.map(|table| count(table) as u32),
            contract: learned.map(|(contract, _)| contract.clone()),
        }
    }

    /// Hands every slot that changed to `sink`, in parts of about `part_bytes`, table by table. `Break`
    /// if the sink did.
    pub fn parts(&self, part_bytes: usize, sink: Sink<'_>) -> ControlFlow<()> {
        self.nodes(&mut Parts::new(Table::Nodes, part_bytes, sink))?;
        self.rows(&mut Parts::new(Table::Rows, part_bytes, sink))?;
        self.bricks(&mut Parts::new(Table::Bricks, part_bytes, sink))?;
        if self.copied.radiance {
            self.colors(&mut Parts::new(Table::Colors, part_bytes, sink))?;
        }
        if self.copied.language {
            self.codes(&mut Parts::new(Table::Codes, part_bytes, sink))?;
            self.atoms(&mut Parts::new(Table::Atoms, part_bytes, sink))?;
        }
        self.decoders(&mut Parts::new(Table::Decoders, part_bytes, sink))?;
        self.viewpoints(&mut Parts::new(Table::Viewpoints, part_bytes, sink))
    }

    fn nodes(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let slot = |page: &NodePage, i: usize| {
            let mut slot = NodeSlot::new(page.children[i], &page.nodes[i]);
            if !self.copied.radiance {
                slot.block = NO_BLOCK;
            }
            if !self.copied.language {
                slot.code_block = NO_BLOCK;
            }
            slot
        };
        let (new, old) = (&self.view.store.nodes, self.old.map(|old| &old.store.nodes));
        changed(new, old, |at, page, before| {
            (0..NODES).try_for_each(|i| match slot(page, i) {
                same if same == slot(before, i) => ControlFlow::Continue(()),
                new => parts.push(at * NODES + i, &[bytemuck::bytes_of(&new)]),
            })
        })?;
        parts.end()
    }

    fn rows(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let (new, old) = (&self.view.store.rows, self.old.map(|old| &old.store.rows));
        changed(new, old, |at, page, before| {
            (0..ROWS).try_for_each(|i| {
                let bytes = bytemuck::bytes_of(&page.rows[i]);
                // By bytes: a NaN is like itself, and -0 is not 0.
                match bytes == bytemuck::bytes_of(&before.rows[i]) {
                    true => ControlFlow::Continue(()),
                    false => parts.push(at * ROWS + i, &[bytes]),
                }
            })
        })?;
        parts.end()
    }

    fn bricks(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let (new, old) = (&self.view.store.bricks, self.old.map(|old| &old.store.bricks));
        changed(new, old, |at, page, before| {
            (0..BRICKS).try_for_each(|i| match page.known[i] == before.known[i] {
                true => ControlFlow::Continue(()),
                false => parts.push(at * BRICKS + i, &[bytemuck::bytes_of(&page.known[i])]),
            })
        })?;
        parts.end()
    }

    fn colors(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let store = &self.view.store;
        let (new, old) = (&store.colors, self.old.map(|old| &old.store.colors));
        let vertices = store.band.vertices();
        let width = vertices * radiance::harmonics(store.color_degree);
        changed(new, old, |at, page, before| {
            let blocks = (store.color_blocks - at * BLOCKS).min(BLOCKS);
            (0..blocks).filter(|_| !page.texels.is_empty()).try_for_each(|i| {
                let range = i * vertices..(i + 1) * vertices;
                let (cell, uppers) = (page.cells[i], page.uppers[i]);
                let texels = &page.texels[range.clone()];
                let by_direction = i * width..(i + 1) * width;
                let harmonics = &page.harmonics[by_direction.clone()];
                let is_same = (cell, uppers) == (before.cells[i], before.uppers[i])
                    && before.texels.get(range) == Some(texels)
                    && before.harmonics.get(by_direction) == Some(harmonics);
                if is_same {
                    return ControlFlow::Continue(());
                }
                let head = BlockSlot { cell, uppers };
                let slot = [
                    bytemuck::bytes_of(&head),
                    bytemuck::cast_slice(texels),
                    bytemuck::cast_slice(harmonics),
                ];
                parts.push(at * BLOCKS + i, &slot)
            })
        })?;
        parts.end()
    }

    fn codes(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let (new, old) = (&self.view.store.codes, self.old.map(|old| &old.store.codes));
        new.changed(old, |block, cell, uppers, codes| {
            let head = BlockSlot { cell, uppers };
            parts.push(block, &[bytemuck::bytes_of(&head), codes])
        })?;
        parts.end()
    }

    /// Atoms are only ever appended.
    fn atoms(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let Some((_, dictionary)) = self.view.store.codes.learned() else {
            return ControlFlow::Continue(());
        };
        let told = self.old.and_then(|old| old.store.codes.learned());
        for atom in told.map_or(0, |(_, old)| old.len())..dictionary.len() {
            let values = dictionary.atom(atom).unwrap_or_default();
            parts.push(atom, &[bytemuck::cast_slice(values)])?;
        }
        parts.end()
    }

    fn decoders(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let decoders = &self.view.decoders;
        if self.old.is_some_and(|old| Arc::ptr_eq(&old.decoders, decoders)) {
            return ControlFlow::Continue(());
        }
        for (i, decoder) in [&decoders.sdf, &decoders.occupancy].into_iter().enumerate() {
            parts.push(i, &[bytemuck::cast_slice(decoder.weights())])?;
            // Of different lengths, and so a part each.
            parts.end()?;
        }
        ControlFlow::Continue(())
    }

    fn viewpoints(&self, parts: &mut Parts<'_>) -> ControlFlow<()> {
        let old = self.old.map_or(&[][..], |old| &old.viewpoints);
        for (i, viewpoint) in self.view.viewpoints.iter().enumerate() {
            if old.get(i) != Some(viewpoint) {
                parts.push(i, &[bytemuck::bytes_of(viewpoint)])?;
            }
        }
        parts.end()
    }
}

/// Calls `visit` for every page that two tables do not share, with its index and what it was before.
fn changed<P: Clone + Default>(
    new: &PageTable<P>,
    old: Option<&PageTable<P>>,
    mut visit: impl FnMut(usize, &P, &P) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let empty = P::default();
    new.changed(old).try_for_each(|(at, page, before)| visit(at, page, before.unwrap_or(&empty)))
}

/// Gathers slots of a table into parts.
struct Parts<'a> {
    part: Part,
    part_bytes: usize,
    sink: Sink<'a>,
}

impl<'a> Parts<'a> {
    fn new(table: Table, part_bytes: usize, sink: Sink<'a>) -> Self {
        let part = Part { table, slots: Vec::new(), bytes: Vec::new() };
        Self { part, part_bytes, sink }
    }

    fn push(&mut self, slot: usize, bytes: &[&[u8]]) -> ControlFlow<()> {
        self.part.slots.push(slot as u32);
        bytes.iter().for_each(|bytes| self.part.bytes.extend_from_slice(bytes));
        if self.part.bytes.len() >= self.part_bytes {
            self.end()
        } else {
            ControlFlow::Continue(())
        }
    }

    /// Hands over what is gathered.
    fn end(&mut self) -> ControlFlow<()> {
        if self.part.slots.is_empty() {
            return ControlFlow::Continue(());
        }
        let empty = Part { table: self.part.table, slots: Vec::new(), bytes: Vec::new() };
        (self.sink)(std::mem::replace(&mut self.part, empty))
    }
}
