//! Map files: sections with their lengths and checksums.

use super::{Dice, change_bytes, change_number};

/// Magic and version.
const START: usize = 12;

/// Changes one section, most often a number of it. `None`: it is no map file.
pub(super) fn change(data: &[u8], dice: &mut Dice) -> Option<Vec<u8>> {
    let mut sections = parse(data)?;
    if sections.is_empty() {
        return None;
    }
    let at = dice.below(sections.len());
    match dice.below(32) {
        0 => drop(sections.remove(at)),
        1 => {
            let other = dice.below(sections.len());
            let payload = sections[other].1.clone();
            sections[at].1 = payload;
        }
        2 => change_bytes(&mut sections[at].1, dice),
        3 => {
            // An element more, or less, of some size.
            let (payload, size) = (&mut sections[at].1, [1, 2, 4, 12, 16, 32][dice.below(6)]);
            let length = payload.len();
            payload.resize(
                if dice.one_in(2) { length + size } else { length.saturating_sub(size) },
                0,
            );
        }
        _ => {
            for _ in 0..=dice.below(3) {
                change_number(&mut sections[at].1, dice);
            }
        }
    }
    Some(write(&data[..START], &sections))
}

type Section = ([u8; 4], Vec<u8>);

fn parse(data: &[u8]) -> Option<Vec<Section>> {
    let (start, mut rest) = data.split_at_checked(START)?;
    if !start.starts_with(b"ORENXMAP") {
        return None;
    }
    let mut sections = Vec::new();
    while let Some(([t0, t1, t2, t3, length @ .., _, _, _, _], after)) =
        rest.split_first_chunk::<16>()
    {
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let (payload, after) = after.split_at_checked(length)?;
        rest = after;
        if [*t0, *t1, *t2, *t3] != *b"END." {
            sections.push(([*t0, *t1, *t2, *t3], payload.to_vec()));
        }
    }
    Some(sections)
}

fn write(start: &[u8], sections: &[Section]) -> Vec<u8> {
    let mut out = start.to_vec();
    let mut put = |tag: [u8; 4], payload: &[u8]| {
        let mut head = tag.to_vec();
        head.extend((payload.len() as u64).to_le_bytes());
        let mut crc = crc32fast::Hasher::new();
        crc.update(&head);
        crc.update(payload);
        out.extend(head);
        out.extend(crc.finalize().to_le_bytes());
        out.extend(payload);
    };
    sections.iter().for_each(|(tag, payload)| put(*tag, payload));
    put(*b"END.", &(sections.len() as u32).to_le_bytes());
    out
}
