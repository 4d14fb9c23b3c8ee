//! Copy-on-write pages behind a two-level table: the mapper writes, views share.

use std::sync::Arc;

/// Pages a block of the table.
const BLOCK: usize = 64;

/// A growing table of pages. Cloning shares every page and costs one reference a block; writing
/// copies a page only while a clone still holds it.
#[derive(Clone)]
pub(super) struct PageTable<P> {
    blocks: Vec<Arc<[Arc<P>; BLOCK]>>,
    pages: usize,
    /// Stands for every page that was never written.
    empty: Arc<P>,
}

impl<P: Default> Default for PageTable<P> {
    fn default() -> Self {
        Self { blocks: Vec::new(), pages: 0, empty: Arc::default() }
    }
}

impl<P: Clone + Default> PageTable<P> {
    /// The page with an index, which must exist.
    #[inline]
    pub(super) fn page(&self, index: usize) -> &P {
        &self.blocks[index / BLOCK][index % BLOCK]
    }

    /// The number of pages.
    pub(super) fn len(&self) -> usize {
        self.pages
    }

    /// All pages in order.
    pub(super) fn pages(&self) -> impl Iterator<Item = &P> {
        self.blocks.iter().flat_map(|block| block.iter().map(|page| &**page)).take(self.pages)
    }

    /// Every page that `old` does not share, with its index and what it was there; all of them without
    /// `old`. Pages that were never written are left out.
    pub(super) fn changed<'a>(
        &'a self,
        old: Option<&'a Self>,
    ) -> impl Iterator<Item = (usize, &'a P, Option<&'a P>)> {
        self.blocks.iter().enumerate().flat_map(move |(at, block)| {
            let before = old.and_then(|old| old.blocks.get(at));
            let is_same = before.is_some_and(|before| Arc::ptr_eq(before, block));
            let pages = if is_same { &[][..] } else { &block[..] };
            pages.iter().enumerate().filter_map(move |(i, page)| {
                let before = before.map(|before| &before[i]);
                let is_same = Arc::ptr_eq(page, &self.empty)
                    || before.is_some_and(|before| Arc::ptr_eq(before, page));
                (!is_same).then(|| (at * BLOCK + i, &**page, before.map(|before| &**before)))
            })
        })
    }

    /// Adds empty pages until there are `pages`.
    pub(super) fn grow(&mut self, pages: usize) {
        self.pages = self.pages.max(pages);
        let empty = || Arc::new(std::array::from_fn(|_| self.empty.clone()));
        self.blocks.resize_with(self.pages.div_ceil(BLOCK), empty);
    }

    /// The page with an index, for writing.
    #[inline]
    pub(super) fn write(&mut self, index: usize) -> &mut P {
        let block = Arc::make_mut(&mut self.blocks[index / BLOCK]);
        Arc::make_mut(&mut block[index % BLOCK])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clone_does_not_see_later_writes_and_untouched_pages_are_shared() {
        let mut table = PageTable::<[u32; 4]>::default();
        table.grow(200);
        table.write(130)[2] = 7;
        let view = table.clone();
        table.write(130)[2] = 8;
        table.grow(300);
        assert_eq!((view.page(130)[2], table.page(130)[2]), (7, 8));
        assert!(std::ptr::eq(view.page(10), table.page(10)));
    }

    #[test]
    fn what_two_tables_do_not_share_is_told_with_what_it_was() {
        let mut table = PageTable::<[u32; 4]>::default();
        table.grow(200);
        table.write(130)[2] = 7;
        let old = table.clone();
        table.write(130)[2] = 8;
        table.grow(300);
        table.write(290)[0] = 1;
        let told = |old| -> Vec<(usize, u32, Option<u32>)> {
            table.changed(old).map(|(at, new, old)| (at, new[2], old.map(|old| old[2]))).collect()
        };
        assert_eq!(told(Some(&old)), [(130, 8, Some(7)), (290, 0, None)]);
        assert_eq!(told(None), [(130, 8, None), (290, 0, None)]);
        assert!(told(Some(&table.clone())).is_empty());
    }
}
