//! The codes of a view: pages of blocks, with the dictionary that they are of.

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::Vec3;

use super::pages::PageTable;
use crate::config::{CodeForm, MapConfig};
use crate::error::Result;
use crate::frame::Contract;
use crate::modality::language::{Dictionary, KeptCodes, LanguageField, StoredCodes};
use crate::octree::{Band, BandScale, Cell, NO_VERTEX, Uppers};

/// Vertices of a page, unless a block has more.
const PAGE_VERTICES: usize = 64;

/// Blocks of codes of a page; empty until it is written.
#[derive(Clone, Default)]
struct CodePage {
    cells: Vec<Cell>,
    uppers: Vec<Uppers>,
    /// The vertices of block after block.
    codes: Option<KeptCodes>,
}

/// What a view knows of language.
#[derive(Clone)]
pub(super) struct ViewCodes {
    scale: BandScale,
    form: CodeForm,
    terms: usize,
    blocks: usize,
    pages: PageTable<CodePage>,
    learned: Option<(Contract, Arc<Dictionary>)>,
}

/// A vertex of the band that was seen with features.
pub(super) struct CodedVertex<'a> {
    /// In units of the spacing.
    pub lattice: [i32; 3],
    codes: &'a KeptCodes,
    row: usize,
}

impl CodedVertex<'_> {
    /// Writes the code to `out`.
    pub(super) fn read(&self, out: &mut [f32]) {
        out.fill(0.0);
        self.codes.add_to(self.row, 1.0, out);
    }
}

/// Codes as a compact map holds them.
#[derive(Debug, Default)]
pub struct ViewCodesState {
    pub learned: Option<(Contract, Vec<f32>)>,
    pub cells: Vec<Cell>,
    pub codes: StoredCodes,
}

impl ViewCodes {
    /// Nothing seen yet.
    pub(super) fn new(config: &MapConfig) -> Self {
        let scale =
            LanguageField::scale(config).unwrap_or(BandScale { cell_m: config.r0_m, log2_side: 0 });
        Self {
            scale,
            form: config.language.codes,
            terms: config.language.terms as usize,
            blocks: 0,
            pages: PageTable::default(),
            learned: None,
        }
    }

    pub(super) fn scale(&self) -> BandScale {
        self.scale
    }

    pub(super) fn blocks(&self) -> usize {
        self.blocks
    }

    /// The encoder and the atoms; `None` before the first features.
    pub(super) fn learned(&self) -> Option<&(Contract, Arc<Dictionary>)> {
        self.learned.as_ref()
    }

    pub(super) fn bytes(&self) -> u64 {
        let pages = self.pages.pages().map(|page| {
            let codes = page.codes.as_ref().map_or(0, KeptCodes::bytes);
            codes + size_of_val(&page.cells[..]) + size_of_val(&page.uppers[..])
        });
        pages.sum::<usize>() as u64
    }

    /// Blocks of a page.
    fn page_blocks(&self) -> usize {
        (PAGE_VERTICES >> (3 * self.scale.log2_side)).max(1)
    }

    /// Writes blocks; `code` gives that of a vertex of the band.
    pub(super) fn write<'a>(
        &mut self,
        band: &Band,
        learned: Option<(Contract, Arc<Dictionary>)>,
        blocks: impl IntoIterator<Item = u32>,
        code: impl Fn(usize) -> Option<&'a [f32]>,
    ) {
        let (page_blocks, vertices) = (self.page_blocks(), self.scale.vertices());
        self.learned = learned;
        self.blocks = band.blocks();
        self.pages.grow(self.blocks.div_ceil(page_blocks));
        for block in blocks {
            let page = self.pages.write(block as usize / page_blocks);
            let slot = block as usize % page_blocks;
            page.cells.resize(page_blocks, [0; 3]);
            page.uppers.resize(page_blocks, [u32::MAX; 8]);
            page.cells[slot] = band.cells()[block as usize];
            page.uppers[slot] = *band.uppers(block);
            let codes = page.codes.get_or_insert_with(|| {
                KeptCodes::new(self.form, self.terms, page_blocks * vertices)
            });
            for i in 0..vertices {
                let row = slot * vertices + i;
                match code(block as usize * vertices + i) {
                    Some(code) => codes.set(row, code),
                    None if codes.square(row) > 0.0 => codes.set(row, &[]),
                    None => {}
                }
            }
        }
    }

    /// Calls `visit` for every block that differs from what it is in `old`, with its cell, its
    /// neighbours and the bytes of its codes, each as wide as the dictionary.
    pub(super) fn changed(
        &self,
        old: Option<&Self>,
        mut visit: impl FnMut(usize, Cell, Uppers, &[u8]) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let (page_blocks, vertices) = (self.page_blocks(), self.scale.vertices());
        let width = self.learned.as_ref().map_or(0, |(_, dictionary)| dictionary.len());
        let (mut bytes, mut before_bytes) = (Vec::new(), Vec::new());
        for (at, page, before) in self.pages.changed(old.map(|old| &old.pages)) {
            let Some(codes) = &page.codes else { continue };
            for i in 0..page_blocks.min(self.blocks - at * page_blocks) {
                let rows = i * vertices..(i + 1) * vertices;
                bytes.clear();
                rows.clone().for_each(|row| codes.write_row(row, width, &mut bytes));
                let known = before.and_then(|before| {
                    let codes = before.codes.as_ref()?;
                    before_bytes.clear();
                    rows.for_each(|row| codes.write_row(row, width, &mut before_bytes));
                    Some((before.cells[i], before.uppers[i]))
                });
                let is_same =
                    known == Some((page.cells[i], page.uppers[i])) && bytes == before_bytes;
                if !is_same {
                    visit(at * page_blocks + i, page.cells[i], page.uppers[i], &bytes)?;
                }
            }
        }
        ControlFlow::Continue(())
    }

    /// Makes room for blocks.
    pub(super) fn make_room(&mut self, blocks: usize) {
        self.blocks = blocks;
        self.pages.grow(blocks.div_ceil(self.page_blocks()));
    }

    /// Sets a block, which must exist, from what [`ViewCodes::changed`] told, with codes of `width`
    /// coefficients; `None` if its length is not theirs.
    pub(super) fn set_block(
        &mut self,
        block: usize,
        (cell, uppers): (Cell, Uppers),
        width: usize,
        bytes: &[u8],
    ) -> Option<()> {
        let (page_blocks, vertices) = (self.page_blocks(), self.scale.vertices());
        let page = self.pages.write(block / page_blocks);
        let i = block % page_blocks;
        page.cells.resize(page_blocks, [0; 3]);
        page.uppers.resize(page_blocks, [u32::MAX; 8]);
        (page.cells[i], page.uppers[i]) = (cell, uppers);
        let codes = page
            .codes
            .get_or_insert_with(|| KeptCodes::new(self.form, self.terms, page_blocks * vertices));
        let row_bytes = KeptCodes::bytes_of(self.form, self.terms, width);
        (bytes.len() == vertices * row_bytes).then_some(())?;
        for (vertex, bytes) in bytes.chunks_exact(row_bytes).enumerate() {
            codes.read_row(i * vertices + vertex, width, bytes)?;
        }
        Some(())
    }

    /// Whether every page was written.
    pub(super) fn is_written(&self) -> bool {
        self.pages.pages().all(|page| page.codes.is_some())
    }

    /// Sets the encoder and the atoms, which are only ever appended.
    pub(super) fn learn(&mut self, contract: Contract, atoms: &[f32]) -> Result<()> {
        let told = self.learned.as_ref().map(|(_, dictionary)| dictionary.len());
        if told.is_none_or(|told| told * contract.dimension != atoms.len()) {
            let dictionary = dictionary_of(&contract, atoms)?;
            self.learned = Some((contract, Arc::new(dictionary)));
        }
        Ok(())
    }

    /// Where a row's code is, if a frame saw it.
    #[inline]
    fn find(&self, row: u32) -> Option<(&KeptCodes, usize)> {
        let page_rows = self.page_blocks() * self.scale.vertices();
        let codes = self.pages.page(row as usize / page_rows).codes.as_ref()?;
        let row = row as usize % page_rows;
        (codes.square(row) > 0.0).then_some((codes, row))
    }

    /// Writes the code at a point of a voxel with this block to `out`: the trilinear average of the
    /// vertices around that frames saw; false where there is none.
    #[inline]
    pub(super) fn code_at(&self, block: u32, point: Vec3, out: &mut [f32]) -> bool {
        let page_blocks = self.page_blocks();
        let page = self.pages.page(block as usize / page_blocks);
        let place = self.scale.place(point);
        let rows = self.scale.vertices_around(&place, &page.uppers[block as usize % page_blocks]);
        out.fill(0.0);
        let mut total = 0.0;
        for (row, weight) in rows.into_iter().zip(place.weights()) {
            if row != NO_VERTEX
                && weight > 0.0
                && let Some((codes, row)) = self.find(row)
            {
                codes.add_to(row, weight, out);
                total += weight;
            }
        }
        if total > 0.0 {
            out.iter_mut().for_each(|x| *x /= total);
        }
        total > 0.0
    }

    /// All vertices that frames saw with features, in the order of their rows.
    pub(super) fn vertices(&self) -> impl Iterator<Item = CodedVertex<'_>> {
        let (vertices, side) = (self.scale.vertices(), self.scale.side());
        self.pages.pages().flat_map(move |page| {
            let rows = page.codes.iter().flat_map(|codes| {
                let seen = move |row: &usize| codes.square(*row) > 0.0;
                (0..codes.rows()).filter(seen).map(move |row| (codes, row))
            });
            rows.map(move |(codes, row)| {
                let (cell, i) = (page.cells[row / vertices], row % vertices);
                let local = [i % side, i / side % side, i / (side * side)];
                let lattice = std::array::from_fn(|a| cell[a] * side as i32 + local[a] as i32);
                CodedVertex { lattice, codes, row }
            })
        })
    }

    /// All that the view holds.
    pub(super) fn state(&self) -> ViewCodesState {
        let mut state = ViewCodesState::default();
        let Some((contract, dictionary)) = &self.learned else { return state };
        state.learned = Some((contract.clone(), dictionary.state().atoms));
        let (vertices, width) = (self.scale.vertices(), dictionary.len());
        let nothing = KeptCodes::new(self.form, self.terms, self.page_blocks() * vertices);
        for page in self.pages.pages() {
            let left = self.blocks - state.cells.len();
            let blocks = self.page_blocks().min(left);
            let codes = page.codes.as_ref().unwrap_or(&nothing);
            state.cells.extend(page.cells.iter().take(blocks));
            (0..blocks * vertices).for_each(|row| codes.store(row, width, &mut state.codes));
        }
        state
    }

    /// Takes up a stored state into empty codes; the band that its blocks belong to.
    pub(super) fn with_state(&mut self, state: ViewCodesState) -> Option<Band> {
        let band = Band::with_cells(self.scale, &state.cells)?;
        let Some((contract, atoms)) = state.learned else {
            return state.cells.is_empty().then_some(band);
        };
        contract.check("contract").ok()?;
        let dictionary = dictionary_of(&contract, &atoms).ok()?;
        let (form, terms, width) = (self.form, self.terms, dictionary.len());
        state.codes.fits(form, terms, band.rows(), width).then_some(())?;
        let mut rows = vec![0.0; band.rows() * width];
        for (row, code) in rows.chunks_exact_mut(width.max(1)).enumerate() {
            state.codes.read(form, terms, row, code);
        }
        let code = |row: usize| {
            let code = &rows[row * width..(row + 1) * width];
            code.iter().any(|x| *x != 0.0).then_some(code)
        };
        let blocks = 0..band.blocks() as u32;
        self.write(&band, Some((contract, Arc::new(dictionary))), blocks, code);
        Some(band)
    }
}

/// Atoms that stay as they are; of none, an empty dictionary.
fn dictionary_of(contract: &Contract, atoms: &[f32]) -> Result<Dictionary> {
    if atoms.is_empty() {
        return Ok(Dictionary::new(contract.dimension, Default::default())?.atoms());
    }
    Dictionary::fixed(atoms, contract.dimension)
}
