//! Copy-on-write pages behind a two-level table: the mapper writes, views share.

use std::sync::Arc;

/// Pages a block of the table.
const BLOCK: usize = 64;

/// A growing table of pages. Cloning shares every page and costs one reference a block; writing
/// copies a page only while a clone still holds it.
#[derive(Clone)]
pub(super) struct PageTable<P> {
    blocks: Vec<Arc<Vec<Arc<P>>>>,
    pages: usize,
}

impl<P> Default for PageTable<P> {
    fn default() -> Self {
        Self { blocks: Vec::new(), pages: 0 }
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
        self.blocks.iter().flat_map(|block| block.iter().map(|page| &**page))
    }

    /// Adds empty pages until there are `pages`.
    pub(super) fn grow(&mut self, pages: usize) {
        while self.pages < pages {
            if self.pages.is_multiple_of(BLOCK) {
                self.blocks.push(Arc::new(Vec::with_capacity(BLOCK)));
            }
            if let Some(block) = self.blocks.last_mut() {
                Arc::make_mut(block).push(Arc::new(P::default()));
            }
            self.pages += 1;
        }
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
