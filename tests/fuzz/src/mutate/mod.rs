//! Changes inputs so that they are looked at still: lengths and checksums follow what is changed.

mod mcap;
mod png;
mod protobuf;
mod sections;

use libfuzzer_sys::fuzzer_mutate;

use crate::bodies::Layout;

/// Changes the first `size` bytes of `data`, which has room for `max_size`; how many they are then.
pub(crate) fn mutate(
    layout: Layout,
    data: &mut [u8],
    size: usize,
    max_size: usize,
    seed: u32,
) -> usize {
    let mut dice = Dice(u64::from(seed) << 1 | 1);
    // Now and then without any care: what is torn must be read too.
    let changed = match layout {
        _ if dice.one_in(16) => None,
        Layout::Plain => None,
        Layout::Protobuf(head) => protobuf::change(&data[..size], head, &mut dice),
        Layout::Map => sections::change(&data[..size], &mut dice),
        Layout::Mcap => mcap::change(&data[..size], &mut dice),
        Layout::Image => png::change(&data[..size], &mut dice),
    };
    match changed {
        Some(bytes) if bytes.len() <= max_size => {
            data[..bytes.len()].copy_from_slice(&bytes);
            bytes.len()
        }
        _ => fuzzer_mutate(data, size, max_size),
    }
}

/// Random numbers of one change.
pub(crate) struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        // xorshift64*.
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    /// A number below `bound`, which is not 0.
    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }

    fn one_in(&mut self, bound: usize) -> bool {
        self.below(bound) == 0
    }
}

/// Changes bytes of any meaning and of any length.
fn change_bytes(bytes: &mut Vec<u8>, dice: &mut Dice) {
    if dice.one_in(2) && bytes.len() >= 4 {
        return change_number(bytes, dice);
    }
    let size = bytes.len();
    bytes.resize(size + 64, 0);
    let room = bytes.len();
    let size = fuzzer_mutate(bytes, size, room);
    bytes.truncate(size);
}

/// Changes a number of four bytes, or of one, among others: into another one of them, into one beside it,
/// or into one that many forget.
fn change_number(bytes: &mut [u8], dice: &mut Dice) {
    const FORGOTTEN: [u32; 16] = [
        0,
        1,
        2,
        7,
        255,
        256,
        65_535,
        1 << 20,
        1 << 28,
        i32::MAX as u32,
        1 << 31,
        u32::MAX,
        0x7fc0_0000, // NaN
        0x7f80_0000, // infinity
        0x7149_f2ca, // 1e30
        0x8000_0001, // the negative number next to 0
    ];
    if bytes.len() < 4 || dice.one_in(8) {
        if !bytes.is_empty() {
            let at = dice.below(bytes.len());
            bytes[at] = dice.next() as u8;
        }
        return;
    }
    let numbers = bytes.len() / 4;
    let (at, other) = (4 * dice.below(numbers), 4 * dice.below(numbers));
    let number =
        |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let new = match dice.below(5) {
        0 => number(other),
        1 => number(at).wrapping_add(1 + dice.below(16) as u32),
        2 => number(at).wrapping_sub(1 + dice.below(16) as u32),
        3 => number(at) ^ 1 << dice.below(32),
        _ => FORGOTTEN[dice.below(FORGOTTEN.len())],
    };
    bytes[at..at + 4].copy_from_slice(&new.to_le_bytes());
}
