//! Damaged checkpoints: an error that names the place, never a panic, and memory stays in proportion.

use super::super::allocations::largest_during;
use super::raw::{self, edited, resealed};
use super::{assert_refused, fixed64, means_f32, sample, samples};
use vbgs_studio::export::checkpoint::{Defect, parse, to_bytes};
use vbgs_studio::math::rng::{Purpose, Rng};

fn good() -> Vec<u8> {
    to_bytes(&sample(means_f32(), fixed64()))
}

#[test]
fn truncation_at_every_byte() {
    for checkpoint in samples() {
        let bytes = to_bytes(&checkpoint);
        for end in 0..bytes.len() {
            let defect = parse(&bytes[..end]).expect_err("a shorter file");
            let is_named = match end {
                0 => matches!(defect, Defect::NotACheckpoint { .. }),
                _ => matches!(defect, Defect::Truncated { found, .. } if found == end as u64),
            };
            assert!(is_named, "cut at {end}: {defect}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert_refused(&longer, &["header", "expected", "bytes"]);
    }
}

#[test]
fn every_flipped_bit_is_seen() {
    let bytes = good();
    let sections = raw::sections(&bytes);
    let table_end = 24 + 32 * sections.len() + 4;
    for bit in 0..8 * table_end {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let defect = parse(&damaged).expect_err("a flipped bit");
        match bit / 8 {
            0..8 => {
                let is_named = matches!(defect, Defect::NotACheckpoint { .. } | Defect::TextMode);
                assert!(is_named, "{bit}: {defect}");
            }
            8..10 => assert!(matches!(defect, Defect::Version { .. }), "{bit}: {defect}"),
            _ => assert!(!defect.to_string().is_empty()),
        }
    }
    // Every byte of the padding and about a thousand bits of the sections.
    let mut offset = table_end;
    for section in &sections {
        let start = offset.next_multiple_of(64);
        for byte in offset..start {
            let mut damaged = bytes.clone();
            damaged[byte] = 1;
            assert_refused(&damaged, &["zeros", "something else"]);
        }
        offset = start + section.content.len();
        let mut rng = Rng::new(3, Purpose::Synthetic, start as u64);
        for _ in 0..1000 / sections.len() {
            let bit = rng.below(8 * section.content.len());
            let mut damaged = bytes.clone();
            damaged[start + bit / 8] ^= 1 << (bit % 8);
            let tag = std::str::from_utf8(&section.tag).unwrap();
            let defect = assert_refused(&damaged, &[tag, "checksum", ".bak"]);
            assert!(matches!(defect, Defect::Checksum { place } if place == tag));
        }
    }
}

#[test]
fn what_is_no_checkpoint_says_what_it_is() {
    assert_refused(b"", &["expected a checkpoint", "found an empty file"]);
    assert_refused(b"ply\nformat ascii 1.0\nelement vertex 1\n", &["found a PLY file"]);
    assert_refused(
        b"glTF\x02\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0",
        &["found a GLB file"],
    );
    assert_refused(b"a shopping list, rather long", &["found a file starting \"a shopping list"]);
    assert_refused(b"short", &["found a file starting \"short\""]);
    let bytes = good();
    let as_text = |from: &[u8], to: &[u8]| {
        let mut damaged = to.to_vec();
        damaged.extend_from_slice(&bytes[from.len()..]);
        damaged
    };
    for damaged in [
        as_text(b"\x89VBGS\r\n", b"\x89VBGS\n"),
        as_text(b"\x89VBGS\r\n", b"\x89VBGS\r\r\n"),
        as_text(b"\x89", b"\t"),
        as_text(b"\x89", "\u{FFFD}".as_bytes()),
        as_text(b"\x89", "\u{89}".as_bytes()),
    ] {
        assert_refused(&damaged, &["damaged by a transfer in text mode", "binary mode"]);
    }
}

#[test]
fn versions_to_come() {
    let bytes = good();
    let sections = raw::sections(&bytes);
    let with = |tag: [u8; 4], version| {
        let mut sections = sections.clone();
        // An unknown element type of an optional section must not matter.
        sections.push(raw::RawSection { tag, element: 99, content: vec![1, 2, 3] });
        raw::file(&sections, version)
    };
    let parts = ["written by version 2.0", "reads 1", "newer program"];
    assert_refused(&raw::file(&sections, (2, 0)), &parts);
    let ignored = parse(&with(*b"xtra", (1, 9))).unwrap();
    assert_eq!(ignored.version, (1, 9));
    assert_eq!(ignored.checkpoint, parse(&bytes).unwrap().checkpoint);
    let parts = ["`XTRA`", "1.9", "newer program"];
    assert_refused(&with(*b"XTRA", (1, 9)), &parts);
    let mut damaged = with(*b"xtra", (1, 9));
    *damaged.last_mut().unwrap() ^= 1;
    assert_refused(&damaged, &["xtra", "checksum"]);
}

#[test]
fn sections_must_be_there_once_and_of_the_right_type_and_size() {
    let bytes = good();
    let sections = raw::sections(&bytes);
    for (i, section) in sections.iter().enumerate() {
        let tag = std::str::from_utf8(&section.tag).unwrap();
        let mut rest = sections.clone();
        rest.remove(i);
        let file = raw::file(&rest, (1, 0));
        match tag {
            // Carries consist of ids (CARI) and limbs (CARL): one without the other is refused.
            "HIST" => assert!(parse(&file).unwrap().checkpoint.history.is_none()),
            "CARI" | "CARL" => assert!(parse(&file).is_err()),
            _ => drop(assert_refused(&file, &[tag, "expected this section", "none"])),
        }
        let twice = [&sections[..], &sections[i..=i]].concat();
        assert_refused(&raw::file(&twice, (1, 0)), &[tag, "one such section", "two"]);
        if !["CONF", "META", "NUMX", "HIST"].contains(&tag) {
            let other =
                edited(&bytes, &section.tag, |s| s.element = if s.element == 1 { 4 } else { 1 });
            let refused = parse(&other).unwrap_err().to_string();
            assert!(refused.contains("elements"), "{refused}");
        }
        if !["CONF", "META", "NUMX", "HIST", "CURS"].contains(&tag) {
            let short = edited(&bytes, &section.tag, |s| s.content.truncate(s.content.len() - 8));
            assert!(parse(&short).is_err(), "{tag}");
            let odd = edited(&bytes, &section.tag, |s| s.content.push(0));
            assert_refused(&odd, &[tag, "whole elements"]);
        }
    }
}

#[test]
fn absurd_sizes_take_no_memory() {
    let bytes = good();
    let entry = |i: usize, field: usize| 24 + 32 * i + field;
    let u64s = |v: u64| v.to_le_bytes().to_vec();
    let cases = [
        (12, u32::MAX.to_le_bytes().to_vec(), "at most 64 sections"),
        (12, 65u32.to_le_bytes().to_vec(), "at most 64 sections"),
        (16, u64s(u64::MAX), "cut short"),
        (16, u64s(1), "expected 1 bytes"),
        (entry(6, 16), u64s(1 << 63), "a place within the file"),
        (entry(6, 16), u64s(u64::MAX), "a place within the file"),
        (entry(6, 8), u64s(u64::MAX - 63), "a place within the file"),
        (entry(6, 8), u64s(1 << 63), "a place within the file"),
        (entry(6, 8), u64s(0), "an offset of"),
        (entry(6, 8), u64s(65), "divisible by 64"),
        (entry(6, 16), u64s(9), "whole elements of 8 bytes"),
        (entry(6, 28), vec![1], "0 in the reserved field"),
    ];
    for (at, with, part) in cases {
        let damaged = resealed(&bytes, at, &with);
        let (refused, largest) = largest_during(|| parse(&damaged).expect_err(part).to_string());
        assert!(refused.contains(part), "{part:?} is missing in: {refused}");
        assert!(largest < 1 << 20, "{largest} bytes for: {refused}");
    }
    // Offsets and lengths of the table may be arbitrary: parsing must check them before allocating.
    let mut rng = Rng::new(5, Purpose::Synthetic, 0);
    for _ in 0..3000 {
        let at = entry(rng.below(raw::sections(&bytes).len()), [8, 16][rng.below(2)]);
        let value = rng.next_u64() >> rng.below(64);
        let damaged = resealed(&bytes, at, &u64s(value));
        let (result, largest) = largest_during(|| parse(&damaged).is_err());
        assert!(result || damaged == bytes, "entry byte {at} as {value}");
        assert!(largest < 1 << 20, "{largest} bytes");
    }
}

#[test]
fn a_count_without_its_bytes_takes_no_memory() {
    // DIRI has one weight more than there are means and sums.
    let bytes = edited(&good(), b"DIRI", |s| s.content.extend_from_slice(&0.1f64.to_le_bytes()));
    assert_refused(&bytes, &["MINI", "expected 126 elements", "found 120"]);
    let none = edited(&good(), b"DIRI", |s| s.content.clear());
    assert_refused(&none, &["DIRI", "expected 1 to 20000000 components", "found 0"]);
}
