//! PNG files behind whatever comes before them: chunks with their checksums.

use super::{Dice, change_bytes, change_number};

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

type Chunk = ([u8; 4], Vec<u8>);

/// Changes one chunk. `None`: it is no PNG.
pub(super) fn change(data: &[u8], dice: &mut Dice) -> Option<Vec<u8>> {
    let start = data.windows(SIGNATURE.len()).position(|window| window == SIGNATURE)?;
    let (head, mut rest) = data.split_at(start + SIGNATURE.len());
    let mut chunks: Vec<Chunk> = Vec::new();
    while let Some(([l0, l1, l2, l3, kind @ ..], after)) = rest.split_first_chunk::<8>()
        && let Some((payload, after)) =
            after.split_at_checked(u32::from_be_bytes([*l0, *l1, *l2, *l3]) as usize)
    {
        chunks.push((*kind, payload.to_vec()));
        rest = after.get(4..).unwrap_or_default();
    }
    if chunks.is_empty() {
        return None;
    }
    let at = dice.below(chunks.len());
    match dice.below(16) {
        0 => drop(chunks.remove(at)),
        1 => chunks.insert(at, chunks[at].clone()),
        2 => {
            const KINDS: [&[u8; 4]; 10] = [
                b"PLTE", b"tRNS", b"gAMA", b"iCCP", b"acTL", b"fcTL", b"fdAT", b"zTXt", b"iTXt",
                b"eXIf",
            ];
            chunks[at].0 = *KINDS[dice.below(KINDS.len())];
        }
        3 | 4 if chunks[at].1.len() >= 4 => change_number(&mut chunks[at].1, dice),
        _ => change_bytes(&mut chunks[at].1, dice),
    }
    let mut out = head.to_vec();
    for (kind, payload) in &chunks {
        let mut crc = crc32fast::Hasher::new();
        crc.update(kind);
        crc.update(payload);
        out.extend((payload.len() as u32).to_be_bytes());
        out.extend(kind);
        out.extend(payload);
        out.extend(crc.finalize().to_be_bytes());
    }
    Some(out)
}
