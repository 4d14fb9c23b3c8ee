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
}
