//! `orenx classify`: the class of each point of a file.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use clap::Args;
use glam::Vec3;

use super::answerer::Answerer;
use super::credentials::CredentialArgs;
use super::encoder::EncoderArgs;
use super::open::MapName;
use crate::error::{Error, Result};
use crate::numpy::{ArchiveWriter, ArrayReader};
use crate::service::Sought;
use crate::storage::write_file;

/// Points asked for at a time, whatever the size of the file.
const PIECE_POINTS: usize = 1 << 14;
/// The largest file of classes: 4096 lines of the longest names.
const MAX_BYTES: u64 = 4 << 20;

/// Say which of some classes is at each point
#[derive(Debug, Args)]
pub struct ClassifyArgs {
    /// Map file, or the URL of a server, as in http://127.0.0.1:7611 or grpc://127.0.0.1:7610
    pub map: String,
    /// An .npy file of points, (N, 3) f32 or f64, world metres
    #[arg(long, value_name = "FILE.npy")]
    pub points: PathBuf,
    /// A text file with the name of a class in each line
    #[arg(long, value_name = "FILE")]
    pub classes: PathBuf,
    /// Where the answers go: class, the line from 0 or -1 where nothing is known, and score, its cosine
    #[arg(long, value_name = "FILE.npz")]
    pub out: PathBuf,
    #[command(flatten)]
    name: MapName,
    #[command(flatten)]
    encoder: EncoderArgs,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl ClassifyArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let prompts = class_names(&self.classes)?;
        let answerer = Answerer::open(&self.map, &self.name, &self.encoder, &self.credentials)?;
        let words = Sought::Words { prompts, negatives: Some(Vec::new()) };
        let classes = answerer.sought(words, "classes")?;
        let (class, score) = classify_file(&answerer, &self.points, &classes)?;
        write_file(&self.out, |file| {
            let mut archive = ArchiveWriter::new(file);
            archive.add("class", &[class.len()], &class)?;
            archive.add("score", &[score.len()], &score)?;
            archive.finish().map(drop)
        })?;
        let known = class.iter().filter(|class| **class >= 0).count();
        println!("{}: {} points, {known} with a class", self.out.display(), class.len());
        Ok(())
    }
}

/// The lines of a file.
fn class_names(path: &Path) -> Result<Vec<String>> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > MAX_BYTES {
        let problem = format!("{size} bytes; the limit is {MAX_BYTES}");
        return Err(Error::invalid("classes", problem));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    let names: Vec<String> = text.lines().map(|line| line.trim().to_owned()).collect();
    match names.iter().position(String::is_empty) {
        Some(at) => Err(Error::invalid("classes", format!("line {} is empty", at + 1))),
        None if names.is_empty() => Err(Error::invalid("classes", "the file has no line")),
        None => Ok(names),
    }
}

fn classify_file(
    answerer: &Answerer,
    points: &Path,
    classes: &Sought,
) -> Result<(Vec<i32>, Vec<f32>)> {
    let file = File::open(points).map_err(|e| Error::io(points, e))?;
    let mut reader = ArrayReader::new(BufReader::new(file), points.display().to_string())?;
    let [rows, 3] = *reader.shape() else {
        let problem = format!("has shape {:?}, but (N, 3) is needed", reader.shape());
        return Err(Error::invalid("points", problem));
    };
    let (mut class, mut score) = (Vec::new(), Vec::new());
    while class.len() < rows {
        let flat: Vec<f32> = reader.next_values(PIECE_POINTS.min(rows - class.len()) * 3)?;
        let points: Vec<Vec3> = flat.chunks_exact(3).map(Vec3::from_slice).collect();
        let (classes_there, scores) = answerer.classify(&points, classes)?;
        class.extend(classes_there);
        score.extend(scores);
    }
    reader.finish()?;
    Ok((class, score))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_class() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("classes.txt");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("written");
            class_names(&path)
        };
        assert_eq!(read("red chair\n table \r\n").expect("two"), ["red chair", "table"]);
        assert_eq!(read("table").expect("one"), ["table"]);
        for (text, words) in [("", "no line"), ("table\n\nchair\n", "line 2 is empty")] {
            let error = read(text).expect_err(words);
            assert!(error.to_string().contains(words) && error.exit_code() == 2, "{error}");
        }
    }
}
