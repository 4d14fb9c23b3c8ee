//! The readers of what comes from outside, held against the inputs of `tests/data/fuzz`: what once made
//! them fail, and what the fuzzer found that goes another way through them. README.md says how it is run.

mod bodies;

use std::path::PathBuf;

use bodies::{TARGETS, Target};

fn target(name: &str) -> &'static Target {
    TARGETS.iter().find(|target| target.name == name).expect("a target of this name")
}

/// Every input that is kept is read: an error is fine, a panic is none. Good ones are read to their end.
fn replay(name: &str) {
    let target = target(name);
    let seeds = (target.seeds)();
    let refused: Vec<usize> = (0..seeds.len()).filter(|i| !(target.read)(&seeds[*i])).collect();
    assert!(refused.is_empty(), "seeds {refused:?} of {name} are not read to their end");
    let long: Vec<usize> = (0..seeds.len()).filter(|i| seeds[*i].len() > target.longest).collect();
    assert!(long.is_empty(), "seeds {long:?} of {name} are longer than {} bytes", target.longest);
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/fuzz").join(name);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(!files.is_empty(), "nothing is kept in {}", folder.display());
    for file in files {
        let bytes = std::fs::read(&file).unwrap();
        let read = std::panic::catch_unwind(|| (target.read)(&bytes));
        assert!(read.is_ok(), "{} is not read without a panic", file.display());
    }
}

macro_rules! replayed {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            replay(stringify!($name));
        })*

        #[test]
        fn every_target_is_replayed() {
            assert_eq!(TARGETS.map(|target| target.name), [$(stringify!($name)),*]);
        }
    };
}

replayed! { wire ask http cdr images journal maps mirror files }
