//! The file format under truncation, damage and forged lengths.

use std::path::Path;

use proptest::prelude::*;
use serde::{Deserialize, Serialize};

use super::sections::{END, MAGIC};
use super::{Sections, Tag};
use crate::error::Status;

const HEAD: Tag = Tag(*b"HEAD");
const ROWS: Tag = Tag(*b"ROWS");
const MOMENTS: Tag = Tag(*b"adam");
const ALL: [Tag; 3] = [HEAD, MOMENTS, ROWS];

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Record {
    name: String,
    epoch: u64,
    scales: Vec<f32>,
    parent: Option<u32>,
}

fn record(epoch: u64) -> Record {
    Record { name: "kitchen".into(), epoch, scales: vec![0.5, -0.25], parent: Some(7) }
}

fn file(epoch: u64, rows: &[[f32; 4]], moments: &[u32]) -> Vec<u8> {
    let mut sections = Sections::new();
    sections.put_record(HEAD, &record(epoch)).unwrap();
    sections.put_array(ROWS, rows).unwrap();
    sections.put_array(MOMENTS, moments).unwrap();
    let mut bytes = Vec::new();
    sections.write_to(&mut bytes).unwrap();
    bytes
}

fn read(bytes: &[u8], wanted: &[Tag]) -> crate::error::Result<Sections<'static>> {
    Sections::read_from(bytes, bytes.len() as u64, Path::new("m.orenx"), wanted)
}

/// A section as the format lays it out, with a right checksum.
fn section(tag: Tag, length: u64, payload: &[u8]) -> Vec<u8> {
    let mut head = tag.0.to_vec();
    head.extend(length.to_le_bytes());
    let mut crc = crc32fast::Hasher::new();
    crc.update(&head);
    crc.update(payload);
    head.extend(crc.finalize().to_le_bytes());
    head.extend(payload);
    head
}

fn forged(sections: &[Vec<u8>]) -> Vec<u8> {
    [&MAGIC[..], &1u32.to_le_bytes(), &sections.concat()].concat()
}

fn end(count: u32) -> Vec<u8> {
    section(END, 4, &count.to_le_bytes())
}

fn message(bytes: &[u8]) -> String {
    read(bytes, &ALL).expect_err("damage must be noticed").to_string()
}

proptest! {
    #[test]
    fn what_is_put_is_taken(
        epoch: u64,
        rows in prop::collection::vec(prop::array::uniform4(-1e9f32..1e9), 0..50),
        moments: Vec<u32>,
    ) {
        let bytes = file(epoch, &rows, &moments);
        let mut sections = read(&bytes, &ALL).unwrap();
        prop_assert_eq!(sections.take_record::<Record>(HEAD).unwrap(), record(epoch));
        prop_assert_eq!(sections.take_array::<[f32; 4]>(ROWS).unwrap(), rows);
        prop_assert_eq!(sections.take_array::<u32>(MOMENTS).unwrap(), moments);
        prop_assert_eq!(sections.tags().count(), 0);
    }

    #[test]
    fn any_flipped_bits_are_noticed(flips in prop::collection::btree_set(0usize..3000, 1..8)) {
        let mut bytes = file(3, &[[1.0, 2.0, 3.0, 4.0]; 8], &[5; 16]);
        let bits = bytes.len() * 8;
        let flips: std::collections::BTreeSet<usize> = flips.iter().map(|f| f % bits).collect();
        for flip in flips {
            bytes[flip / 8] ^= 1 << (flip % 8);
        }
        prop_assert!(read(&bytes, &ALL).is_err());
        prop_assert!(read(&bytes, &[HEAD, ROWS]).is_err(), "also in what is passed over");
    }

    #[test]
    fn garbage_is_refused(bytes: Vec<u8>, with_magic: bool) {
        let bytes = if with_magic { forged(&[bytes]) } else { bytes };
        prop_assert!(read(&bytes, &ALL).is_err());
    }

    #[test]
    fn a_forged_record_is_an_error_or_a_value(payload: Vec<u8>) {
        let bytes = forged(&[section(HEAD, payload.len() as u64, &payload), end(1)]);
        let mut sections = read(&bytes, &ALL).unwrap();
        if let Err(error) = sections.take_record::<Record>(HEAD) {
            prop_assert_eq!(error.status(), Status::DataLoss);
        }
    }
}

#[test]
fn every_single_flipped_bit_and_every_truncation_is_noticed() {
    let bytes = file(3, &[[1.0, 2.0, 3.0, 4.0]; 2], &[5, 6]);
    for bit in 0..bytes.len() * 8 {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&flipped, &ALL).is_err(), "bit {bit}");
    }
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length], &ALL).is_err(), "the first {length} bytes");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert_eq!(message(&longer), "m.orenx: section END. is damaged: 1 bytes follow it");
}

#[test]
fn a_file_that_shrinks_while_it_is_read_is_damaged() {
    let bytes = file(3, &[[1.0; 4]; 8], &[5; 16]);
    for length in 0..bytes.len() {
        let result =
            Sections::read_from(&bytes[..length], bytes.len() as u64, Path::new("m"), &ALL);
        assert!(result.is_err(), "the first {length} bytes");
    }
}

#[test]
fn damage_names_its_section() {
    let good = section(ROWS, 4, &[1, 2, 3, 4]);
    let mut bad = good.clone();
    *bad.last_mut().unwrap() ^= 1;
    let cases = [
        (forged(&[bad, end(1)]), "section ROWS is damaged: its checksum does not match"),
        (forged(&[good.clone(), good.clone(), end(2)]), "ROWS is damaged: it is there twice"),
        (forged(&[good.clone(), end(2)]), "section END. is damaged: it does not count 1 sections"),
        (forged(&[good]), "m.orenx is damaged: it ends before its closing section"),
        (forged(&[section(Tag(*b"A\0BC"), 0, &[])]), r"section A\x00BC is damaged"),
    ];
    for (bytes, expected) in cases {
        assert!(message(&bytes).contains(expected), "{}", message(&bytes));
    }
}

#[test]
fn a_forged_length_is_refused_before_anything_is_allocated() {
    for length in [5, 1 << 40, u64::MAX] {
        let bytes = forged(&[section(ROWS, length, &[1, 2, 3, 4])]);
        let expected =
            format!("section ROWS is damaged: it claims {length} bytes where 4 are left");
        assert!(message(&bytes).contains(&expected), "{}", message(&bytes));
    }
    // A string and a vector inside a record that claim more than there is.
    for claimed in [1u64 << 20, 1 << 40, u64::MAX] {
        let payload = claimed.to_le_bytes();
        let bytes = forged(&[section(HEAD, 8, &payload), end(1)]);
        let name = read(&bytes, &ALL).unwrap().take_record::<String>(HEAD);
        assert_eq!(name.unwrap_err().status(), Status::DataLoss);
        let list = read(&bytes, &ALL).unwrap().take_record::<Vec<u64>>(HEAD);
        assert_eq!(list.unwrap_err().status(), Status::DataLoss);
    }
}

#[test]
fn too_many_sections_are_refused() {
    let tag = |i: usize| {
        Tag([b'x', b'A' + (i / 400) as u8, b'!' + (i % 400 / 20) as u8, b'!' + (i % 20) as u8])
    };
    let mut all: Vec<Vec<u8>> = (0..300).map(|i| section(tag(i), 0, &[])).collect();
    all.push(end(300));
    assert!(message(&forged(&all)).contains("256th"));
}

#[test]
fn foreign_and_newer_files_are_told_apart_from_damage() {
    let foreign = read(b"\x89PNG\r\n\x1a\n and so on", &ALL).unwrap_err();
    assert_eq!(foreign.to_string(), "m.orenx: is not an orenx map");
    assert_eq!(read(b"", &ALL).unwrap_err().status(), Status::InvalidArgument);

    let mut newer = file(3, &[], &[]);
    newer[8] = 2;
    assert!(message(&newer).contains("written by a newer orenx (format 2; this one reads 1)"));
    newer[8] = 0;
    assert!(message(&newer).contains("format 0 does not exist"));
}

#[test]
fn optional_sections_are_passed_over_and_needed_ones_are_not() {
    let bytes = file(3, &[[1.0; 4]], &[5]);
    let sections = read(&bytes, &[HEAD, ROWS]).unwrap();
    assert_eq!(sections.tags().collect::<Vec<_>>(), [HEAD, ROWS]);
    let error = read(&bytes, &[HEAD, MOMENTS]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "m.orenx: section ROWS is not known here; a newer orenx wrote it"
    );
}

#[test]
fn wrong_types_are_damage_not_numbers() {
    let bytes = file(3, &[[1.0; 4]], &[1, 2, 3]);
    let mut sections = read(&bytes, &ALL).unwrap();
    let array = sections.take_array::<[f32; 16]>(ROWS).unwrap_err();
    assert!(array.to_string().contains("do not divide into elements of 64"), "{array}");
    let short = sections.take_record::<u64>(MOMENTS).unwrap_err();
    assert!(short.to_string().contains("4 bytes too many"), "{short}");
    let again = sections.take_array::<u32>(MOMENTS).unwrap_err();
    assert_eq!(again.to_string(), "m.orenx: section adam is damaged: it is missing");
}

#[test]
fn a_name_is_used_once_and_is_printable() {
    let mut sections = Sections::new();
    sections.put_array(ROWS, &[1.0f32]).unwrap();
    for tag in [ROWS, END, Tag(*b"a b ")] {
        let error = sections.put_array(tag, &[1.0f32]).unwrap_err();
        assert_eq!(error.status(), Status::Internal, "{tag}");
    }
}

#[test]
fn a_large_record_comes_back() {
    let values: Vec<u64> = (0..9_000_000).collect(); // more than the small bound
    let mut sections = Sections::new();
    sections.put_record(ROWS, &values).unwrap();
    assert!(sections.take_record::<Vec<u64>>(ROWS).unwrap() == values);
}

#[test]
fn files_go_to_the_disk_and_come_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.orenx");
    let rows: Vec<[f32; 4]> = (0..100_000).map(|i| [i as f32; 4]).collect();
    let mut sections = Sections::new();
    sections.put_array(ROWS, &rows).unwrap();
    sections.write(&path).unwrap();
    let first = std::fs::read(&path).unwrap();
    sections.write(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), first, "the same content gives the same bytes");
    assert_eq!(Sections::read(&path, &[ROWS]).unwrap().take_array::<[f32; 4]>(ROWS).unwrap(), rows);

    let folder = Sections::read(dir.path(), &[]).unwrap_err();
    assert!(folder.to_string().contains("must be a file"), "{folder}");
    let missing = Sections::read(&dir.path().join("b.orenx"), &[]).unwrap_err();
    assert_eq!(missing.status(), Status::NotFound);
}
