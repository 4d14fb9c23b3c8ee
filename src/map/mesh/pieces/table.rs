//! Which pieces there are and when each changed last, found by comparing views: what two views share is
//! seen by the addresses of their pages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::{LOG2_VOXELS, PieceKey, leaf};
use crate::map::pages::PageTable;
use crate::map::view::{BLOCKS, BRICKS, MapView, NODES, Node, NodePage, ROWS};
use crate::octree::{NO_BLOCK, NO_NODE};

/// A vertex near the surface that moved it by more than this is seen, m.
const SEEN_M: f32 = 0.002;
/// What is less than that, and colours that settle, are shown together after this time.
const SETTLE: Duration = Duration::from_secs(4);

/// The pieces of one map, by what was seen of its views.
#[derive(Default)]
pub struct PieceTable {
    /// The view that was looked at last.
    view: Option<Arc<MapView>>,
    pieces: BTreeMap<PieceKey, Piece>,
    /// The same by the number of their last change.
    changed: BTreeMap<u64, PieceKey>,
    changes: u64,
}

struct Piece {
    change: u64,
    /// When that was.
    at: Instant,
    /// Whether it has changed a little since.
    unsettled: bool,
}

/// What became of a leaf.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    Same,
    Little,
    Seen,
}

impl PieceTable {
    /// No pieces.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether a view is of the map that was looked at: one map's views share their settings.
    pub fn is_of(&self, view: &MapView) -> bool {
        self.view.as_ref().is_none_or(|old| Arc::ptr_eq(&old.config, &view.config))
    }

    /// The epoch that was looked at last.
    pub fn epoch(&self) -> Option<u64> {
        self.view.as_ref().map(|view| view.epoch)
    }

    /// The number of the newest change.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// The pieces that changed after change `since`, oldest change first, with its number.
    pub fn since(&self, since: u64) -> impl Iterator<Item = (u64, PieceKey)> + '_ {
        let after = since.saturating_add(1);
        self.changed.range(after..).map(|(change, key)| (*change, *key))
    }

    /// Looks at a later view of the same map. Costs a look at every leaf near surfaces.
    pub fn follow(&mut self, view: &Arc<MapView>, now: Instant) {
        let mut marks = BTreeMap::new();
        if self.epoch() != Some(view.epoch) {
            let old = self.view.replace(view.clone());
            Differences::between(view, old.as_deref()).mark(&mut marks);
        }
        for (key, mark) in marks {
            let settled = match self.pieces.get_mut(&key) {
                Some(piece) if mark == Mark::Little => {
                    piece.unsettled = true;
                    false
                }
                _ => true,
            };
            if settled {
                self.change(key, now);
            }
        }
        let is_due = |(key, piece): (&PieceKey, &Piece)| {
            let is_old = now.saturating_duration_since(piece.at) >= SETTLE;
            (piece.unsettled && is_old).then_some(*key)
        };
        let due: Vec<PieceKey> = self.pieces.iter().filter_map(is_due).collect();
        due.into_iter().for_each(|key| self.change(key, now));
    }

    fn change(&mut self, key: PieceKey, now: Instant) {
        self.changes += 1;
        let piece = Piece { change: self.changes, at: now, unsettled: false };
        if let Some(old) = self.pieces.insert(key, piece) {
            self.changed.remove(&old.change);
        }
        self.changed.insert(self.changes, key);
    }
}

/// A set of numbers.
struct Bits(Vec<u64>);

impl Bits {
    fn new(count: usize) -> Self {
        Self(vec![0; count.div_ceil(64)])
    }

    fn insert(&mut self, at: usize) {
        if let Some(word) = self.0.get_mut(at / 64) {
            *word |= 1 << (at % 64);
        }
    }

    fn has(&self, at: usize) -> bool {
        self.0.get(at / 64).is_some_and(|word| word >> (at % 64) & 1 == 1)
    }
}

/// What two views do not share.
struct Differences<'a> {
    view: &'a MapView,
    old: Option<&'a MapView>,
    /// Pages of nodes.
    pages: Bits,
    /// Rows that changed, and those whose change is seen.
    rows: Bits,
    moved: Bits,
    bricks: Bits,
    blocks: Bits,
}

impl<'a> Differences<'a> {
    fn between(view: &'a MapView, old: Option<&'a MapView>) -> Self {
        let store = &view.store;
        let mut found = Self {
            view,
            old,
            pages: Bits::new(store.nodes.len()),
            rows: Bits::new(store.rows.len() * ROWS),
            moved: Bits::new(store.rows.len() * ROWS),
            bricks: Bits::new(store.bricks.len() * BRICKS),
            blocks: Bits::new(store.colors.len() * BLOCKS),
        };
        for (at, _, _) in store.nodes.changed(old.map(|old| &old.store.nodes)) {
            found.pages.insert(at);
        }
        found.find_rows();
        found.find_bricks();
        found.find_blocks();
        found
    }

    fn find_rows(&mut self) {
        let reach = 2.0 * self.view.config.r0_m;
        let old = self.old.map(|old| &old.store.rows);
        for (at, page, before) in self.view.store.rows.changed(old) {
            for (i, row) in page.rows.iter().enumerate() {
                let was = before.map(|before| &before.rows[i]);
                let bytes = |row| bytemuck::bytes_of(row);
                if was.is_some_and(|was| bytes(was) == bytes(row)) {
                    continue;
                }
                self.rows.insert(at * ROWS + i);
                let (is, was) = (row.explicit[0], was.map_or(f32::NAN, |was| was.explicit[0]));
                let is_same = (is - was).abs() <= SEEN_M && (is < 0.0) == (was < 0.0);
                // A row that was not there has no distance: the new one alone counts.
                let is_far = is.abs().min(was.abs()) > reach;
                if !is_same && !is_far {
                    self.moved.insert(at * ROWS + i);
                }
            }
        }
    }

    fn find_bricks(&mut self) {
        let old = self.old.map(|old| &old.store.bricks);
        for (at, page, before) in self.view.store.bricks.changed(old) {
            for (i, known) in page.known.iter().enumerate() {
                if before.is_none_or(|before| before.known[i] != *known) {
                    self.bricks.insert(at * BRICKS + i);
                }
            }
        }
    }

    fn find_blocks(&mut self) {
        let old = self.old.map(|old| &old.store.colors);
        let vertices = self.view.store.band.vertices();
        for (at, page, before) in self.view.store.colors.changed(old) {
            for i in 0..BLOCKS {
                let range = i * vertices..(i + 1) * vertices;
                let was = before.and_then(|before| before.texels.get(range.clone()));
                if was != page.texels.get(range) {
                    self.blocks.insert(at * BLOCKS + i);
                }
            }
        }
    }

    /// Marks the pieces of all leaves that changed, or went.
    fn mark(&self, marks: &mut BTreeMap<PieceKey, Mark>) {
        let (r0, _) = self.view.piece_levels();
        let mut set = |node: &Node, mark: Mark| {
            let key = node.low.map(|c| c >> (r0 + LOG2_VOXELS));
            let known = marks.entry(key).or_insert(mark);
            if mark == Mark::Seen {
                *known = mark;
            }
        };
        let old = self.old.map(|old| &old.store.nodes);
        let pages = self.view.store.nodes.len().max(old.map_or(0, PageTable::len));
        let page_of =
            |table: &'a PageTable<NodePage>, at| (at < table.len()).then(|| table.page(at));
        for at in 0..pages {
            let page = page_of(&self.view.store.nodes, at);
            // Of a page that both share, only what it refers to may have changed.
            let before = old.and_then(|old| page_of(old, at));
            let before = before.filter(|_| page.is_none() || self.pages.has(at));
            let leaf_of =
                |page: Option<&'a NodePage>, i: usize| leaf(page?.children[i], &page?.nodes[i], r0);
            for i in 0..NODES {
                let (now, was) = (leaf_of(page, i), leaf_of(before, i));
                if let Some(was) = was.filter(|was| now.is_none_or(|now| !is_alike(now, was))) {
                    set(was, Mark::Seen);
                }
                let Some(now) = now else { continue };
                let is_new = self.old.is_none()
                    || (self.pages.has(at) && was.is_none_or(|was| !is_alike(now, was)));
                match if is_new { Mark::Seen } else { self.mark_of(now) } {
                    Mark::Same => {}
                    mark => set(now, mark),
                }
            }
        }
    }

    /// What became of what a leaf refers to.
    fn mark_of(&self, node: &Node) -> Mark {
        let corners = || node.corners.iter().map(|row| *row as usize);
        let has_moved = corners().any(|row| self.moved.has(row));
        if has_moved || (node.brick != NO_NODE && self.bricks.has(node.brick as usize)) {
            return Mark::Seen;
        }
        let is_painted = node.block != NO_BLOCK && self.blocks.has(node.block as usize);
        if is_painted || corners().any(|row| self.rows.has(row)) {
            Mark::Little
        } else {
            Mark::Same
        }
    }
}

/// Whether two nodes are drawn alike, where what they refer to is.
fn is_alike(a: &Node, b: &Node) -> bool {
    let drawn = |n: &Node| (n.corners, n.brick, n.block, n.low, n.log2_size);
    drawn(a) == drawn(b)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{mapper, take};
    use super::*;

    fn changed(table: &PieceTable, since: u64) -> Vec<PieceKey> {
        let mut keys: Vec<_> = table.since(since).map(|(_, key)| key).collect();
        keys.sort_unstable();
        keys
    }

    #[test]
    fn what_did_not_change_is_not_told_again() {
        let (mut mapper, mut table) = (mapper(), PieceTable::new());
        let (start, late) = (Instant::now(), Instant::now() + SETTLE);
        table.follow(&take(&mut mapper, 0), start);
        let (all, seen) = (changed(&table, 0), table.changes());
        assert!(all.len() > 4 && seen == all.len() as u64, "{all:?}");
        table.follow(&mapper.publish(), start);
        assert_eq!((changed(&table, seen), table.changes()), (vec![], seen));
        // The other side of the room.
        table.follow(&take(&mut mapper, 50), start);
        let more = changed(&table, seen);
        assert!(more.iter().any(|key| !all.contains(key)), "{more:?}");
        assert!(all.iter().any(|key| !more.contains(key)), "{more:?}");
        let every = changed(&table, 0);
        assert!(all.iter().chain(&more).all(|key| every.contains(key)));
        // What changed a little is told later, once.
        let seen = table.changes();
        table.follow(&mapper.publish(), late);
        let settled = table.changes();
        table.follow(&mapper.publish(), late + SETTLE);
        assert_eq!(table.changes(), settled);
        assert!(settled - seen <= every.len() as u64);
    }

    #[test]
    fn an_emptied_map_changes_every_piece_that_was_there() {
        let (mut mapper, mut table) = (mapper(), PieceTable::new());
        table.follow(&take(&mut mapper, 0), Instant::now());
        let (all, seen) = (changed(&table, 0), table.changes());
        mapper.reset().expect("it empties");
        let empty = mapper.publish();
        assert!(table.is_of(&empty));
        table.follow(&empty, Instant::now());
        assert_eq!(changed(&table, seen), all);
        assert!(!table.is_of(&super::super::tests::mapper().publish()));
    }
}
