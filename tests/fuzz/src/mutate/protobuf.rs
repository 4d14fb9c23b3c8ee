//! Messages of Protobuf, field by field, without knowing what they mean.

use super::{Dice, change_bytes, change_number};

enum Value {
    Varint(u64),
    Fixed(Vec<u8>),
    Bytes(Vec<u8>),
    Message(Vec<Field>),
}

struct Field {
    number: u32,
    value: Value,
}

/// Messages in messages deeper than this are bytes.
const DEEPEST: usize = 6;

/// Changes one field of the message behind the first `head` bytes. `None`: it is none.
pub(super) fn change(data: &[u8], head: usize, dice: &mut Dice) -> Option<Vec<u8>> {
    let (head, message) = data.split_at_checked(head)?;
    let mut fields = parse(message, 0)?;
    change_message(&mut fields, dice);
    let mut out = head.to_vec();
    write(&fields, &mut out);
    Some(out)
}

fn change_message(fields: &mut Vec<Field>, dice: &mut Dice) {
    if fields.is_empty() || dice.one_in(24) {
        let value = Value::Varint(dice.next());
        fields.push(Field { number: 1 + dice.below(12) as u32, value });
        return;
    }
    let at = dice.below(fields.len());
    match dice.below(24) {
        0 => drop(fields.remove(at)),
        1 => fields[at].number = 1 + dice.below(16) as u32,
        2 => {
            let mut copy = Vec::new();
            write(&fields[at..=at], &mut copy);
            fields.extend(parse(&copy, 0).unwrap_or_default());
        }
        3 => {
            let other = dice.below(fields.len());
            fields.swap(at, other);
        }
        _ => change_value(&mut fields[at].value, dice),
    }
}

fn change_value(value: &mut Value, dice: &mut Dice) {
    match value {
        Value::Varint(number) => {
            let mut bytes = number.to_le_bytes();
            change_number(&mut bytes, dice);
            *number = u64::from_le_bytes(bytes);
            if dice.one_in(2) {
                *number &= 0xff;
            }
        }
        Value::Fixed(bytes) => {
            if bytes.len() == 8 && dice.one_in(2) {
                const FORGOTTEN: [f64; 8] =
                    [0.0, -0.0, 1.0, -1.0, f64::NAN, f64::INFINITY, 1e300, 1e7];
                *bytes = FORGOTTEN[dice.below(FORGOTTEN.len())].to_le_bytes().into();
            } else {
                change_number(bytes, dice);
            }
        }
        Value::Bytes(bytes) => change_bytes(bytes, dice),
        Value::Message(fields) => change_message(fields, dice),
    }
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0u64;
    for shift in 0..10 {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7f) << (7 * shift).min(63);
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

fn parse(mut bytes: &[u8], depth: usize) -> Option<Vec<Field>> {
    let mut fields = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let number = u32::try_from(key >> 3).ok().filter(|number| (1..1 << 20).contains(number))?;
        let value = match key & 7 {
            0 => Value::Varint(varint(&mut bytes)?),
            kind @ (1 | 5) => {
                let (value, rest) = bytes.split_at_checked(if kind == 1 { 8 } else { 4 })?;
                bytes = rest;
                Value::Fixed(value.to_vec())
            }
            2 => {
                let length = usize::try_from(varint(&mut bytes)?).ok()?;
                let (value, rest) = bytes.split_at_checked(length)?;
                bytes = rest;
                let inner = if depth < DEEPEST { parse(value, depth + 1) } else { None };
                match inner.filter(|fields| !fields.is_empty()) {
                    Some(fields) => Value::Message(fields),
                    None => Value::Bytes(value.to_vec()),
                }
            }
            _ => return None,
        };
        fields.push(Field { number, value });
    }
    Some(fields)
}

fn put_varint(mut number: u64, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn write(fields: &[Field], out: &mut Vec<u8>) {
    for Field { number, value } in fields {
        let mut key = |kind: u64| put_varint(u64::from(*number) << 3 | kind, out);
        match value {
            Value::Varint(number) => {
                key(0);
                put_varint(*number, out);
            }
            Value::Fixed(bytes) => {
                key(if bytes.len() == 8 { 1 } else { 5 });
                out.extend(bytes);
            }
            Value::Bytes(bytes) => {
                key(2);
                put_varint(bytes.len() as u64, out);
                out.extend(bytes);
            }
            Value::Message(fields) => {
                key(2);
                let mut inner = Vec::new();
                write(fields, &mut inner);
                put_varint(inner.len() as u64, out);
                out.extend(inner);
            }
        }
    }
}
