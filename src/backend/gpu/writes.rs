//! Records on their way from the host to their places in pools: one upload a call, as far as it is
//! not very large.

use std::ops::Range;

use super::device::Gpu;
use super::kernel::Kernel;
use super::passes::Passes;
use super::pool::Pool;
use super::shader::Constant;
use crate::error::{Error, Result};

/// Words of an upload, about; more are uploaded in parts.
const SHEET_WORDS: usize = 4 << 20;
/// Words at multiples of which a binding may start on every adapter.
const ALIGNMENT: usize = 64;
/// Words of the records that there are kernels for.
const SIZES: [u32; 5] = [1, 2, 4, 8, 1024];
/// Most workgroups of a pass; they loop.
const GROUPS: usize = 1024;

/// The kernels that write records.
#[derive(Debug)]
pub(super) struct Writer {
    kernels: Vec<Kernel>,
}

/// Records that are to be written. A place may come twice with the same words.
#[derive(Default)]
pub(super) struct Writes<'a> {
    sheets: Vec<Sheet<'a>>,
}

/// What one upload holds.
#[derive(Default)]
struct Sheet<'a> {
    words: Vec<u32>,
    parts: Vec<Part<'a>>,
}

/// Records for one pool.
struct Part<'a> {
    record_words: usize,
    pool: &'a Pool,
    words: Range<usize>,
}

impl<'a> Writes<'a> {
    /// What goes to the GPU, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.sheets.iter().map(|sheet| sheet.words.len() * 4).sum()
    }

    /// Adds records of `N` words, each with the index of its place.
    pub(super) fn add<const N: usize>(
        &mut self,
        pool: &'a Pool,
        records: impl Iterator<Item = (u32, [u32; N])>,
    ) {
        let mut records = records.peekable();
        while records.peek().is_some() {
            if self.sheets.last().is_none_or(|sheet| sheet.words.len() >= SHEET_WORDS) {
                self.sheets.push(Sheet::default());
            }
            let Some(sheet) = self.sheets.last_mut() else { return };
            let start = sheet.words.len().next_multiple_of(ALIGNMENT);
            sheet.words.resize(start, 0);
            while sheet.words.len() < SHEET_WORDS.max(start + 1) {
                let Some((place, words)) = records.next() else { break };
                sheet.words.push(place);
                sheet.words.extend(words);
            }
            let words = start..sheet.words.len();
            sheet.parts.push(Part { record_words: N, pool, words });
        }
    }

    /// Adds blocks of records of two words, as many in each, which lie block after block.
    pub(super) fn add_pairs(
        &mut self,
        pool: &'a Pool,
        blocks: impl Iterator<Item = (u32, Vec<[u32; 2]>)>,
    ) {
        let mut blocks = blocks.peekable();
        let each = blocks.peek().map_or(0, |(_, pairs)| pairs.len() as u32);
        if each.is_multiple_of(4) {
            // By fours: less to tell of places.
            let quads = blocks.flat_map(|(block, pairs)| {
                let quads: Vec<[u32; 8]> = bytemuck::pod_collect_to_vec(&pairs);
                (block * (each / 4)..).zip(quads)
            });
            return self.add(pool, quads);
        }
        self.add(pool, blocks.flat_map(|(block, pairs)| (block * each..).zip(pairs)));
    }
}

impl Writer {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let kernel =
            |words: &u32| Kernel::new(gpu, "mirror/write", &[("WORDS", Constant::U32(*words))]);
        Ok(Self { kernels: SIZES.iter().map(kernel).collect::<Result<_>>()? })
    }

    /// Records that everything is written.
    pub(super) fn record(&self, gpu: &Gpu, passes: &mut Passes, writes: Writes<'_>) -> Result<()> {
        for Sheet { words, parts } in writes.sheets {
            let Some(upload) = gpu.upload("records", &words)? else { continue };
            for Part { record_words, pool, words } in parts {
                let kernel = SIZES.iter().position(|&size| size as usize == record_words);
                let Some(kernel) = kernel.and_then(|i| self.kernels.get(i)) else {
                    let problem = format!("no kernel writes records of {record_words} words");
                    return Err(Error::Internal(problem));
                };
                let records = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &upload,
                    offset: words.start as u64 * 4,
                    size: wgpu::BufferSize::new(words.len() as u64 * 4),
                });
                let buffers = [("records", records), ("pool", pool.binding())];
                let groups = words.len().div_ceil(64).min(GROUPS) as u32;
                kernel.bind(gpu, &buffers)?.dispatch(passes, groups);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::gpu::Adapters;

    #[test]
    fn records_come_to_their_places_in_any_number_of_uploads() {
        let gpu = Gpu::open(Adapters::Any).expect("an adapter");
        let writer = Writer::new(&gpu).expect("kernels");
        let count = SHEET_WORDS as u32 / 3 + 7;
        let mut pools = [2u64, 4].map(|words| Pool::new(&gpu, "pool", 4 * words).expect("room"));
        for pool in &mut pools {
            pool.grow(&gpu, count.into()).expect("room");
        }
        let mut writes = Writes::default();
        writes.add(&pools[0], (0..count).map(|i| (count - 1 - i, [i, i ^ 5])));
        writes.add(&pools[1], [(3, [1, 2, 3, 4]), (9, [5, 6, 7, 8])].into_iter());
        assert_eq!(writes.sheets.len(), 2);
        let mut passes = Passes::new(&gpu, None);
        writer.record(&gpu, &mut passes, writes).expect("passes");
        gpu.queue.submit([passes.encoder.finish()]);
        let found = gpu.read::<[u32; 2]>(&pools[0].buffer, count as usize).expect("words");
        let place = |i: usize| count - 1 - i as u32;
        assert!(found.iter().enumerate().all(|(i, w)| *w == [place(i), place(i) ^ 5]));
        let found = gpu.read::<[u32; 4]>(&pools[1].buffer, 10).expect("words");
        assert_eq!((found[3], found[4], found[9]), ([1, 2, 3, 4], [0; 4], [5, 6, 7, 8]));
    }
}
