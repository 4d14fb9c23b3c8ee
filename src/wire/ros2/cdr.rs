//! Plain CDR (version 1) behind the four bytes that say so, as every ROS 2 payload is.

use cdr_encoding::{from_bytes, to_vec};
use serde::Deserialize;

use super::types::Message;
use crate::error::{Error, Result};
use crate::wire::MAX_MESSAGE_BYTES;

/// The representation identifier and its options.
const HEADER_BYTES: usize = 4;
const BIG_ENDIAN: [u8; 2] = [0, 0];
const LITTLE_ENDIAN: [u8; 2] = [0, 1];
/// Some writers fill up to the next multiple of four or eight.
const PADDING_BYTES: usize = 7;

/// A message out of a payload, in either byte order. Lengths are held against what is there before
/// anything is allocated.
pub fn decode<'a, M: Message + Deserialize<'a>>(payload: &'a [u8]) -> Result<M> {
    let refuse = |problem: String| Error::invalid(M::TYPE.name, problem);
    if payload.len() > MAX_MESSAGE_BYTES {
        let problem = format!("{} bytes; the limit is {MAX_MESSAGE_BYTES}", payload.len());
        return Err(refuse(problem));
    }
    let Some((header, body)) = payload.split_at_checked(HEADER_BYTES) else {
        return Err(refuse(format!("{} bytes hold no CDR header", payload.len())));
    };
    let read = match [header[0], header[1]] {
        LITTLE_ENDIAN => from_bytes::<M, byteorder::LittleEndian>(body),
        BIG_ENDIAN => from_bytes::<M, byteorder::BigEndian>(body),
        [high, low] => {
            return Err(refuse(format!("{high:02x}{low:02x} is neither CDR_LE nor CDR_BE")));
        }
    };
    let (message, used) = read.map_err(|e| refuse(format!("is damaged: {e}")))?;
    let left = body.len() - used;
    if left > PADDING_BYTES {
        return Err(refuse(format!("{left} bytes follow its end: is it of another type?")));
    }
    Ok(message)
}

/// The payload of a message, little-endian.
pub fn encode<M: Message>(message: &M) -> Result<Vec<u8>> {
    let body = to_vec::<M, byteorder::LittleEndian>(message)
        .map_err(|e| Error::Internal(format!("{}: {e}", M::TYPE.name)))?;
    let mut payload = Vec::with_capacity(HEADER_BYTES + body.len());
    payload.extend_from_slice(&LITTLE_ENDIAN);
    payload.extend_from_slice(&[0, 0]);
    payload.extend_from_slice(&body);
    Ok(payload)
}
