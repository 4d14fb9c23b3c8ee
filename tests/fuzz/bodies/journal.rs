//! Segments of a journal: MCAP files of frames, as a crash, a bad disk or a stranger leaves them.

use std::path::Path;
use std::sync::OnceLock;

use orenx::storage::{End, Entry, Reading, SegmentWriter};

use super::{Layout, Target, scene};

pub(super) const TARGET: Target =
    Target { name: "journal", read, seeds, layout: Layout::Mcap, longest: 16_384 };

/// The position of the first frame of each segment.
const FIRST: u64 = 41;

fn read(input: &[u8]) -> bool {
    let mut reading = Reading::of(Path::new("s.mcap"), input.to_vec(), FIRST);
    let mut frames = 0;
    let mut is_good = true;
    while let Some(Entry { position, frame, .. }) = reading.next_entry() {
        assert_eq!(position, FIRST + frames, "no gap goes unnoticed");
        frames += 1;
        is_good &= frame.check().is_ok();
    }
    assert_eq!(reading.next_position(), FIRST + frames);
    match reading.end() {
        End::Whole => is_good && frames > 0,
        End::Torn { at } | End::Damaged { at, .. } => {
            assert!(at <= reading.bytes(), "damage is inside of the file");
            false
        }
    }
}

fn seeds() -> Vec<Vec<u8>> {
    static SEEDS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    SEEDS.get_or_init(|| [false, true].map(segment).into()).clone()
}

/// Two frames in two groups, with and without the summary at the end.
fn segment(is_finished: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = SegmentWriter::create(folder.path(), "default", 7, FIRST).unwrap();
    for number in 0..2 {
        let mut frame = scene::frame(number as usize);
        if number == 1 {
            (frame.color, frame.features) = (None, None);
        }
        writer.append([&Entry { position: FIRST + number, epoch: 1, frame }]).unwrap();
    }
    let path = writer.path().to_owned();
    if is_finished {
        writer.finish();
    }
    std::fs::read(path).unwrap()
}
