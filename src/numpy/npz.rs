//! Several named arrays in a zip archive, as `numpy.savez` writes and `numpy.load` reads them.

use std::io::{Read, Seek, Write};

use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::element::{Element, Value};
use super::npy::{ArrayReader, write_header, write_values};
use crate::error::{Error, Result};

/// An `.npz` file that is read array by array.
pub struct Archive<R> {
    zip: ZipArchive<R>,
    name: String,
}

impl<R: Read + Seek> Archive<R> {
    /// Reads the directory; `name` is what errors call the file.
    pub fn new(source: R, name: impl Into<String>) -> Result<Self> {
        let name = name.into();
        let zip = ZipArchive::new(source).map_err(|e| Error::corrupt(&name, e.to_string()))?;
        Ok(Self { zip, name })
    }

    /// Opens one array.
    pub fn array(&mut self, key: &str) -> Result<ArrayReader<impl Read + '_>> {
        let name = format!("{}[{key}]", self.name);
        match self.zip.by_name(&format!("{key}.npy")) {
            Ok(member) => ArrayReader::new(member, name),
            Err(ZipError::FileNotFound) => {
                Err(Error::invalid(&self.name, format!("has no array '{key}'")))
            }
            Err(e) => Err(Error::corrupt(&name, e.to_string())),
        }
    }

    /// One array of shape (N) or (N, `width`) for `width` > 1, flattened.
    pub fn rows<T: Value>(&mut self, key: &str, width: usize) -> Result<Vec<T>> {
        let file = self.name.clone();
        let array = self.array(key)?;
        let fits = match *array.shape() {
            [_] => width == 1,
            [_, columns] => columns == width && width > 1,
            _ => false,
        };
        if !fits {
            let wanted = if width == 1 { "(N)".to_owned() } else { format!("(N, {width})") };
            return Err(Error::invalid(
                format!("{file}[{key}]"),
                format!("has shape {:?}, but {wanted} is needed", array.shape()),
            ));
        }
        array.into_values()
    }
}

/// Writes an `.npz` file, uncompressed: measured fields hardly compress, and speed matters.
pub struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    /// Starts the archive.
    pub fn new(out: W) -> Self {
        Self { zip: ZipWriter::new(out) }
    }

    /// Starts an array and returns where its `shape` little-endian elements go.
    pub fn start(
        &mut self,
        key: &str,
        element: Element,
        shape: &[usize],
    ) -> std::io::Result<&mut impl Write> {
        let bytes = shape.iter().product::<usize>() as u64 * element.bytes() as u64;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            // Sizes beyond 4 GiB need the long form, announced before the first byte.
            .large_file(bytes > u64::from(u32::MAX) - 1024);
        self.zip.start_file(format!("{key}.npy"), options)?;
        write_header(&mut self.zip, element, shape)?;
        Ok(&mut self.zip)
    }

    /// Writes an array.
    pub fn add<T: Value>(
        &mut self,
        key: &str,
        shape: &[usize],
        values: &[T],
    ) -> std::io::Result<()> {
        write_values(self.start(key, T::ELEMENT, shape)?, values)
    }

    /// Writes the directory.
    pub fn finish(self) -> std::io::Result<W> {
        Ok(self.zip.finish()?)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use proptest::prelude::*;

    use super::*;

    fn sample() -> Vec<u8> {
        let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
        writer.add("sdf", &[2], &[0.5f32, f32::NAN]).expect("memory");
        writer.add("gradient", &[2, 3], &[1.0f32, 0.0, 0.0, 0.0, 1.0, 0.0]).expect("memory");
        writer.add("state", &[2], &[1u8, 0]).expect("memory");
        writer.finish().expect("memory").into_inner()
    }

    fn read_all(bytes: &[u8]) -> Result<(Vec<f32>, Vec<f32>, Vec<u8>)> {
        let mut archive = Archive::new(Cursor::new(bytes), "q.npz")?;
        Ok((archive.rows("sdf", 1)?, archive.rows("gradient", 3)?, archive.rows("state", 1)?))
    }

    #[test]
    fn arrays_round_trip_by_name() {
        let (sdf, gradient, state) = read_all(&sample()).expect("good");
        assert!(sdf[0] == 0.5 && sdf[1].is_nan());
        assert_eq!(gradient, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(state, [1, 0]);
    }

    #[test]
    fn deflated_members_are_read() {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        zip.start_file("near.npy", options).expect("memory");
        crate::numpy::write_array(&mut zip, &[3], &[true, false, true]).expect("memory");
        let bytes = zip.finish().expect("memory").into_inner();
        let mut archive = Archive::new(Cursor::new(bytes), "gt.npz").expect("directory");
        assert_eq!(archive.rows::<bool>("near", 1).expect("near"), [true, false, true]);
    }

    #[test]
    fn missing_arrays_and_wrong_shapes_name_the_array() {
        let mut archive = Archive::new(Cursor::new(sample()), "q.npz").expect("good");
        let missing = archive.rows::<f32>("points", 3).expect_err("no such array").to_string();
        assert!(missing.contains("q.npz") && missing.contains("'points'"), "{missing}");
        let shape = archive.rows::<f32>("sdf", 3).expect_err("(2) is not (N, 3)").to_string();
        assert!(shape.contains("q.npz[sdf]") && shape.contains("(N, 3)"), "{shape}");
    }

    #[test]
    fn a_flipped_data_bit_is_noticed() {
        let good = sample();
        let half = 0.5f32.to_le_bytes();
        let at = good.windows(4).position(|w| w == half).expect("the value 0.5");
        let mut bad = good.clone();
        bad[at] ^= 1;
        assert!(read_all(&bad).is_err(), "the CRC must catch it");
    }

    #[test]
    fn truncation_is_an_error_at_every_length() {
        let good = sample();
        for length in 0..good.len() {
            assert!(read_all(&good[..length]).is_err(), "{length} of {} bytes", good.len());
        }
    }

    proptest! {
        #[test]
        fn bit_flips_never_panic(at in any::<prop::sample::Index>(), bit in 0u8..8) {
            let mut bytes = sample();
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            let _ = read_all(&bytes);
        }
    }
}
