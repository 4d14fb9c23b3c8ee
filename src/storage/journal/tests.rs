//! Segments under truncation and damage.

use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;

const FIRST_POSITION: u64 = 41;
const NUMBER: u64 = 0xfeed_beef;

fn entries(count: u64) -> Vec<Entry> {
    let room = Synthetic::room(100).with_width(8);
    let entry = |i: u64| Entry {
        position: FIRST_POSITION + i,
        epoch: i,
        frame: room.load(i as usize, i.is_multiple_of(2)).expect("a frame"),
    };
    (0..count).map(entry).collect()
}

/// A segment of five frames in three groups, with and without its end.
fn segment(is_finished: bool) -> (Vec<Entry>, Vec<u8>) {
    let folder = tempfile::tempdir().expect("a folder");
    let entries = entries(5);
    let mut writer =
        SegmentWriter::create(folder.path(), "default", NUMBER, FIRST_POSITION).expect("a segment");
    for group in [&entries[..2], &entries[2..3], &entries[3..]] {
        writer.append(group).expect("written");
    }
    assert_eq!(writer.positions(), FIRST_POSITION..FIRST_POSITION + 5);
    let path = writer.path().to_owned();
    let [(first, found)] = &segments(folder.path()).expect("a folder")[..] else { panic!() };
    assert_eq!((*first, found), (FIRST_POSITION, &path));
    if is_finished {
        assert_eq!(writer.finish(), fs::metadata(&path).expect("a file").len());
        return (entries, fs::read(&path).expect("read"));
    }
    // As a process that is killed leaves it.
    (entries, fs::read(&path).expect("read"))
}

fn read(bytes: &[u8]) -> (Vec<Entry>, Reading) {
    let mut reading = Reading::of(Path::new("s.mcap"), bytes.to_vec(), FIRST_POSITION);
    let entries = std::iter::from_fn(|| reading.next_entry()).collect();
    (entries, reading)
}

/// The number of frames that are there, each as it was written.
fn right(read: &[Entry], written: &[Entry]) -> usize {
    assert!(read.len() <= written.len());
    for (back, entry) in read.iter().zip(written) {
        assert_eq!(format!("{back:?}"), format!("{entry:?}"));
    }
    read.len()
}

#[test]
fn what_is_appended_is_read_in_order() {
    for is_finished in [false, true] {
        let (written, bytes) = segment(is_finished);
        let (back, reading) = read(&bytes);
        assert_eq!(right(&back, &written), 5);
        assert_eq!((reading.end(), reading.journal()), (End::Whole, Some(NUMBER)));
        assert_eq!(reading.next_position(), FIRST_POSITION + 5);
    }
}

#[test]
fn a_finished_segment_says_where_its_chunks_are() {
    let (_, bytes) = segment(true);
    let footer = bytes.len() - 8 - 20;
    assert_eq!(bytes[bytes.len() - 8..], *mcap::MAGIC);
    let start = u64::from_le_bytes(bytes[footer..footer + 8].try_into().expect("8 bytes"));
    let mut summary = &bytes[start as usize..bytes.len() - 8];
    let records: Vec<(u8, &[u8])> =
        std::iter::from_fn(|| mcap::next_record(&mut summary)).collect();
    let kinds: Vec<u8> = records.iter().map(|(opcode, _)| *opcode).collect();
    assert_eq!(kinds, [0x03, 0x04, 0x0b, 0x08, 0x08, 0x08, 0x02]);
    assert_eq!(mcap::Read(records[2].1).u64(), Some(5), "messages");
    for (_, index) in &records[3..6] {
        let at = u64::from_le_bytes(index[16..24].try_into().expect("8 bytes"));
        assert_eq!(bytes[at as usize], mcap::op::CHUNK);
        let index_at = u64::from_le_bytes(index[38..46].try_into().expect("8 bytes"));
        assert_eq!(bytes[index_at as usize], mcap::op::MESSAGE_INDEX);
    }
}

#[test]
fn a_file_that_is_cut_anywhere_has_whole_groups_and_then_ends() {
    let (written, bytes) = segment(false);
    let mut seen = std::collections::BTreeSet::new();
    for length in 0..bytes.len() {
        let (back, reading) = read(&bytes[..length]);
        seen.insert(right(&back, &written));
        match reading.end() {
            End::Torn { at } => assert!(at <= length as u64),
            End::Whole => {}
            End::Damaged { problem, .. } => panic!("{length}: {problem}"),
        }
    }
    assert_eq!(seen, [0, 2, 3, 5].into(), "groups are whole or not there");
    // A file system may have made room that it did not fill.
    let (back, reading) = read(&[&bytes[..], &[0; 5000]].concat());
    assert_eq!((right(&back, &written), reading.end()), (5, End::Torn { at: bytes.len() as u64 }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Whatever is flipped, what is read is what was written, from the first on.
    #[test]
    fn flipped_bits_never_make_a_frame(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0u8..8), 1..4),
        is_finished in any::<bool>(),
    ) {
        static SEGMENTS: std::sync::OnceLock<[(Vec<Entry>, Vec<u8>); 2]> = std::sync::OnceLock::new();
        let (written, bytes) = &SEGMENTS.get_or_init(|| [false, true].map(segment))[usize::from(is_finished)];
        let mut bytes = bytes.clone();
        for (place, bit) in flips {
            let place = place.index(bytes.len());
            bytes[place] ^= 1 << bit;
        }
        let (back, _) = read(&bytes);
        right(&back, written);
    }

    #[test]
    fn noise_is_no_segment(bytes: Vec<u8>, with_magic: bool) {
        let bytes = if with_magic { [&mcap::MAGIC[..], &bytes].concat() } else { bytes };
        prop_assert!(read(&bytes).0.is_empty());
    }
}

/// Every bit of the framing, one at a time: no loss of frames goes unnoticed.
#[test]
fn a_flipped_bit_outside_of_frames_is_noticed_or_harmless() {
    let (written, bytes) = segment(false);
    let (_, plain) = read(&bytes);
    assert_eq!(plain.end(), End::Whole);
    for byte in 0..bytes.len() {
        for bit in [0, 1, 3, 4, 7] {
            let mut flipped = bytes.clone();
            flipped[byte] ^= 1 << bit;
            let (back, reading) = read(&flipped);
            let count = right(&back, &written);
            assert!(count == 5 || reading.end() != End::Whole, "byte {byte}, bit {bit}");
        }
    }
}

#[test]
fn frames_are_written_in_their_order_or_not_at_all() {
    let folder = tempfile::tempdir().expect("a folder");
    let entries = entries(2);
    let mut writer =
        SegmentWriter::create(folder.path(), "default", NUMBER, FIRST_POSITION).expect("a segment");
    writer.append(&entries[..1]).expect("written");
    let before = fs::read(writer.path()).expect("read");
    let error = writer.append([&entries[0]]).expect_err("out of order").to_string();
    assert!(error.contains("is not 42"), "{error}");
    assert_eq!(fs::read(writer.path()).expect("read"), before);
    writer.append(&entries[1..]).expect("the one that follows");
    let again = SegmentWriter::create(folder.path(), "default", NUMBER, FIRST_POSITION);
    assert!(again.is_err(), "no segment is written over");
}
