//! One array: the header, and values in bounded pieces.
//!
//! Format: "NEP 1 — A simple file format for NumPy arrays", versions 1.0 to 3.0.

use std::io::{Read, Write};

use super::element::{Element, Value};
use crate::error::{Error, Result};

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// NumPy itself refuses longer headers unless told that the file is trusted.
const MAX_HEADER_BYTES: usize = 10_000;
/// Bytes read or written at a time.
const PIECE_BYTES: usize = 1 << 20;
/// The most dimensions that NumPy gives an array.
const MAX_DIMENSIONS: usize = 32;

/// An array that is read piece by piece.
pub struct ArrayReader<R> {
    source: R,
    /// What errors call the array.
    name: String,
    element: Element,
    shape: Vec<usize>,
    /// Elements not yet read.
    left: usize,
}

impl<R: Read> ArrayReader<R> {
    /// Reads the header; `name` is what errors call the array.
    pub fn new(mut source: R, name: impl Into<String>) -> Result<Self> {
        let name = name.into();
        let text = read_header_text(&mut source, &name)?;
        let (element, shape) =
            parse_header(&text).map_err(|problem| Error::corrupt(&name, problem))?;
        let left = shape
            .iter()
            .try_fold(1usize, |n, &side| n.checked_mul(side))
            .filter(|n| n.checked_mul(element.bytes()).is_some())
            .ok_or_else(|| Error::corrupt(&name, format!("shape {shape:?} is too large")))?;
        Ok(Self { source, name, element, shape, left })
    }

    /// The type of the elements in the file.
    pub fn element(&self) -> Element {
        self.element
    }

    /// The lengths of the dimensions.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The next `count` elements, fewer only at the end of the array.
    pub fn next_values<T: Value>(&mut self, count: usize) -> Result<Vec<T>> {
        let count = count.min(self.left);
        let size = self.element.bytes();
        let mut values = Vec::with_capacity(count.min(PIECE_BYTES));
        let mut piece = vec![0; PIECE_BYTES.min(count * size)];
        while values.len() < count {
            let bytes = &mut piece[..PIECE_BYTES.min((count - values.len()) * size)];
            self.source.read_exact(bytes).map_err(|e| self.broken(&e))?;
            for element in bytes.chunks_exact(size) {
                let value = T::decode(self.element, element).ok_or_else(|| {
                    let (found, wanted) = (self.element.descr(), T::ELEMENT.descr());
                    Error::invalid(&self.name, format!("holds {found}, but {wanted} is needed"))
                })?;
                values.push(value);
            }
        }
        self.left -= count;
        Ok(values)
    }

    /// All elements that are left, and the proof that nothing follows them (which is also what
    /// makes a zip member check its CRC).
    pub fn into_values<T: Value>(mut self) -> Result<Vec<T>> {
        let values = self.next_values(self.left)?;
        self.finish()?;
        Ok(values)
    }

    /// Checks that the source ends where the array does.
    pub fn finish(mut self) -> Result<()> {
        let mut one = [0];
        match self.source.read(&mut one) {
            Ok(0) => Ok(()),
            Ok(_) => Err(Error::corrupt(&self.name, "bytes follow the array")),
            Err(e) => Err(self.broken(&e)),
        }
    }

    fn broken(&self, source: &std::io::Error) -> Error {
        let problem = match source.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                format!("ends before its {:?} elements", self.shape)
            }
            _ => source.to_string(),
        };
        Error::corrupt(&self.name, problem)
    }
}

fn read_header_text(source: &mut impl Read, name: &str) -> Result<String> {
    let mut read = |bytes: &mut [u8]| {
        source.read_exact(bytes).map_err(|e| Error::corrupt(name, format!("no npy header: {e}")))
    };
    let mut start = [0; 8];
    read(&mut start)?;
    if &start[..6] != MAGIC {
        return Err(Error::corrupt(name, "is not an npy array"));
    }
    let length = match start[6] {
        1 => {
            let mut bytes = [0; 2];
            read(&mut bytes)?;
            usize::from(u16::from_le_bytes(bytes))
        }
        2 | 3 => {
            let mut bytes = [0; 4];
            read(&mut bytes)?;
            u32::from_le_bytes(bytes) as usize
        }
        version => return Err(Error::corrupt(name, format!("npy version {version} is unknown"))),
    };
    if length > MAX_HEADER_BYTES {
        return Err(Error::corrupt(
            name,
            format!("npy header of {length} bytes (limit {MAX_HEADER_BYTES})"),
        ));
    }
    let mut text = vec![0; length];
    read(&mut text)?;
    String::from_utf8(text).map_err(|_| Error::corrupt(name, "npy header is not text"))
}

/// Reads `{'descr': '<f4', 'fortran_order': False, 'shape': (200000, 3), }`, the form in which
/// NumPy writes its header (a dict literal with sorted keys), spaces aside.
fn parse_header(text: &str) -> std::result::Result<(Element, Vec<usize>), String> {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let malformed = || "malformed npy header".to_owned();
    let body = text.strip_prefix("{'descr':").ok_or_else(malformed)?;
    let (descr, body) = body.split_once(",'fortran_order':").ok_or_else(malformed)?;
    let (fortran, body) = body.split_once(",'shape':(").ok_or_else(malformed)?;
    let (shape, rest) = body.split_once(')').ok_or_else(malformed)?;
    if !matches!(rest, ",}" | "}") {
        return Err(malformed());
    }
    let descr = descr.trim_matches('\'');
    let element = Element::ALL.into_iter().find(|e| e.descr() == descr).ok_or_else(|| {
        let known = Element::ALL.map(Element::descr).join(", ");
        format!("element type {descr:?} is not one of {known}")
    })?;
    let sides = shape.trim_end_matches(',').split(',').filter(|_| !shape.is_empty());
    let shape: Vec<usize> =
        sides.map(str::parse).collect::<std::result::Result<_, _>>().map_err(|_| malformed())?;
    if shape.len() > MAX_DIMENSIONS {
        return Err(malformed());
    }
    match fortran {
        "False" => Ok((element, shape)),
        // With one dimension both orders are the same.
        "True" if shape.len() < 2 => Ok((element, shape)),
        "True" => Err("Fortran order; save numpy.ascontiguousarray(array) instead".to_owned()),
        _ => Err(malformed()),
    }
}

/// Writes the header of an array; `element.bytes()` times the product of `shape` bytes follow.
pub fn write_header(
    out: &mut (impl Write + ?Sized),
    element: Element,
    shape: &[usize],
) -> std::io::Result<()> {
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    // A tuple of one needs its comma, longer ones do without.
    let sides = if shape.len() == 1 { sides.trim_end() } else { sides.trim_end_matches(", ") };
    let descr = element.descr();
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({sides}), }}")
        .into_bytes();
    // The data start at a multiple of 64 bytes; the text ends with a line feed.
    let start = MAGIC.len() + 4;
    text.resize((start + text.len() + 1).next_multiple_of(64) - start - 1, b' ');
    text.push(b'\n');
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    // At most 32 dimensions of 22 characters: far from 65 535.
    out.write_all(&(text.len() as u16).to_le_bytes())?;
    out.write_all(&text)
}

/// Writes values, little-endian, in bounded pieces.
pub fn write_values<T: Value>(
    out: &mut (impl Write + ?Sized),
    values: &[T],
) -> std::io::Result<()> {
    let mut bytes = Vec::with_capacity(PIECE_BYTES.min(size_of_val(values)));
    for piece in values.chunks(PIECE_BYTES / 8) {
        bytes.clear();
        piece.iter().for_each(|value| value.encode(&mut bytes));
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes a whole `.npy` array.
pub fn write_array<T: Value>(
    out: &mut (impl Write + ?Sized),
    shape: &[usize],
    values: &[T],
) -> std::io::Result<()> {
    write_header(out, T::ELEMENT, shape)?;
    write_values(out, values)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes_of<T: Value>(shape: &[usize], values: &[T]) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_array(&mut bytes, shape, values).expect("writing to memory");
        bytes
    }

    #[test]
    fn the_header_is_the_one_that_numpy_writes() {
        // numpy.save(f, numpy.zeros((2, 3), "<f4")), and the shapes () and (5,).
        let bytes = bytes_of(&[2, 3], &[0f32; 6]);
        let text = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
        assert_eq!(bytes.len(), 128 + 24);
        assert_eq!(std::str::from_utf8(&bytes[10..128]).expect("text").trim_end(), text);
        assert_eq!(bytes[127], b'\n');
        for (shape, written) in [(vec![], "'shape': (), }"), (vec![5], "'shape': (5,), }")] {
            let bytes = bytes_of(&shape, &vec![0u8; shape.iter().product()]);
            assert!(String::from_utf8_lossy(&bytes).contains(written), "{shape:?}");
        }
    }

    #[test]
    fn every_type_round_trips_and_doubles_read_as_floats() {
        fn check<T: Value + PartialEq + std::fmt::Debug>(values: &[T]) {
            let bytes = bytes_of(&[values.len()], values);
            let reader = ArrayReader::new(&bytes[..], "a").expect("header");
            assert_eq!(reader.element(), T::ELEMENT);
            assert_eq!(reader.into_values::<T>().expect("values"), values);
        }
        check(&[1.5f32, -0.0, f32::MAX]);
        check(&[true, false]);
        check(&[0u8, 255]);
        check(&[i32::MIN, 7]);
        let mut doubles = Vec::new();
        write_header(&mut doubles, Element::F64, &[2]).expect("memory");
        for value in [0.25f64, -3.0] {
            doubles.extend_from_slice(&value.to_le_bytes());
        }
        let reader = ArrayReader::new(&doubles[..], "a").expect("header");
        assert_eq!(reader.into_values::<f32>().expect("values"), [0.25, -3.0]);
    }

    #[test]
    fn pieces_add_up_to_the_array() {
        let values: Vec<i32> = (0..1000).collect();
        let bytes = bytes_of(&[1000], &values);
        let mut reader = ArrayReader::new(&bytes[..], "a").expect("header");
        let mut read = Vec::new();
        loop {
            let piece = reader.next_values::<i32>(333).expect("piece");
            if piece.is_empty() {
                break;
            }
            read.extend(piece);
        }
        assert_eq!(read, values);
        reader.finish().expect("the end");
    }

    #[test]
    fn defects_are_named() {
        let good = bytes_of(&[4], &[1.0f32; 4]);
        let patched = |from: &str, to: &str| {
            let from = format!("{from:<0$}", to.len());
            let at = good.windows(from.len()).position(|w| w == from.as_bytes()).expect("there");
            let mut bytes = good.clone();
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            bytes
        };
        let mut long = good.clone();
        long.push(0);
        let cases: Vec<(Vec<u8>, &str)> = vec![
            (good[..7].to_vec(), "no npy header"),
            (good[..good.len() - 1].to_vec(), "ends before"),
            (long, "bytes follow"),
            (patched("NUMPY", "NUMPX"), "not an npy array"),
            ([b"\x93NUMPY\x01\x00\x64\x00", &[b'['; 100][..]].concat(), "malformed"),
            (patched("<f4", ">f4"), "element type"),
            (patched("(4,), }", "(4, 4294967)"), "malformed"),
            (patched("(4,), }", "(-4,), }"), "malformed"),
            (patched("False, 'shape': (4,), }", "True, 'shape': (2, 2), }"), "Fortran"),
            (patched("(4,), }", "(9223372036854775807,)}"), "too large"),
        ];
        for (bytes, expected) in cases {
            let result = ArrayReader::new(&bytes[..], "p.npy").and_then(|r| r.into_values::<f32>());
            let message = result.expect_err(expected).to_string();
            assert!(message.contains(expected), "{message} should contain {expected}");
        }
        let reader = ArrayReader::new(&good[..], "a").expect("header");
        let message = reader.into_values::<bool>().expect_err("floats are not flags").to_string();
        assert!(message.contains("|b1"), "{message}");
    }

    #[test]
    fn a_large_shape_without_data_does_not_allocate() {
        let mut bytes = Vec::new();
        write_header(&mut bytes, Element::F32, &[1 << 60]).expect("memory");
        let reader = ArrayReader::new(&bytes[..], "a").expect("header");
        assert!(reader.into_values::<f32>().is_err());
    }

    proptest! {
        #[test]
        fn bit_flips_never_panic(at in 0usize..152, bit in 0u8..8) {
            let mut bytes = bytes_of(&[2, 3], &[1.0f32; 6]);
            bytes[at] ^= 1 << bit;
            if let Ok(reader) = ArrayReader::new(&bytes[..], "a") {
                let _ = reader.into_values::<f32>();
            }
        }
    }
}
