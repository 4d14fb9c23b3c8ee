//! Segments of a journal: records, and those of a chunk behind its checksum.

use super::{Dice, change_bytes, change_number, protobuf};

const MAGIC: usize = 8;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
/// Before the records of a chunk that is not compressed.
const CHUNK_HEAD: usize = 40;
/// Before the contents of a message.
const MESSAGE_HEAD: usize = 22;

type Record = (u8, Vec<u8>);

/// Changes one record. `None`: there is none.
pub(super) fn change(data: &[u8], dice: &mut Dice) -> Option<Vec<u8>> {
    let (magic, rest) = data.split_at_checked(MAGIC)?;
    let (mut records, torn) = parse(rest);
    if records.is_empty() {
        return None;
    }
    change_one(&mut records, dice);
    let mut out = magic.to_vec();
    write(&records, &mut out);
    if !dice.one_in(8) {
        out.extend(torn);
    }
    Some(out)
}

fn change_one(records: &mut Vec<Record>, dice: &mut Dice) {
    let at = dice.below(records.len());
    match dice.below(24) {
        0 => drop(records.remove(at)),
        1 => records.insert(at, records[at].clone()),
        2 => records[at].0 = dice.below(16) as u8,
        3 => {
            let other = dice.below(records.len());
            records.swap(at, other);
        }
        4 => change_bytes(&mut records[at].1, dice),
        _ if records[at].0 == CHUNK && records[at].1.len() > CHUNK_HEAD => {
            let body = &mut records[at].1;
            let (mut inner, torn) = parse(&body[CHUNK_HEAD..]);
            if !inner.is_empty() {
                change_one(&mut inner, dice);
            }
            let mut stored = Vec::new();
            write(&inner, &mut stored);
            stored.extend(torn);
            let length = (stored.len() as u64).to_le_bytes();
            body.truncate(CHUNK_HEAD);
            body[16..24].copy_from_slice(&length);
            body[24..28].copy_from_slice(&crc32fast::hash(&stored).to_le_bytes());
            body[32..40].copy_from_slice(&length);
            body.extend(stored);
        }
        _ if records[at].0 == MESSAGE && !dice.one_in(8) => {
            if let Some(changed) = protobuf::change(&records[at].1, MESSAGE_HEAD, dice) {
                records[at].1 = changed;
            }
        }
        _ => change_number(&mut records[at].1, dice),
    }
}

/// Whole records, and what is behind them.
fn parse(mut bytes: &[u8]) -> (Vec<Record>, &[u8]) {
    let mut records = Vec::new();
    while let Some(([opcode, length @ ..], rest)) = bytes.split_first_chunk::<9>()
        && let Some((body, rest)) =
            usize::try_from(u64::from_le_bytes(*length)).ok().and_then(|n| rest.split_at_checked(n))
    {
        records.push((*opcode, body.to_vec()));
        bytes = rest;
    }
    (records, bytes)
}

fn write(records: &[Record], out: &mut Vec<u8>) {
    for (opcode, body) in records {
        out.push(*opcode);
        out.extend((body.len() as u64).to_le_bytes());
        out.extend(body);
    }
}
