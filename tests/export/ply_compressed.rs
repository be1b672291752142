//! PlayCanvas' compressed PLY, packed here independently by its description.

use super::{assert_fails, distance, random_splats, read_bytes};
use vbgs_studio::export::{Imported, Note};
use vbgs_studio::model::splat::splats::Splat;

/// Packs splats into a file with `n_rest` coefficients in the element `sh` (0: no element); `colored` adds
/// the colour range to the chunks.
pub fn compressed(splats: &[Splat], n_rest: usize, colored: bool) -> Vec<u8> {
    let n_chunks = splats.len().div_ceil(256);
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment by hand\nelement chunk {n_chunks}\n"
    );
    let triples = |prefix: &str, axes: [&str; 3]| {
        let one = |end: &str| axes.map(|a| format!("property float {end}_{prefix}{a}\n")).concat();
        one("min") + &one("max")
    };
    header += &triples("", ["x", "y", "z"]);
    header += &triples("scale_", ["x", "y", "z"]);
    if colored {
        header += &triples("", ["r", "g", "b"]);
    }
    header += &format!("element vertex {}\n", splats.len());
    for name in ["position", "rotation", "scale", "color"] {
        header += &format!("property uint packed_{name}\n");
    }
    if n_rest > 0 {
        header += &format!("element sh {}\n", splats.len());
        (0..n_rest).for_each(|i| header += &format!("property uchar f_rest_{i}\n"));
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    let mut words = Vec::new();
    for chunk in splats.chunks(256) {
        let of = |field: fn(&Splat) -> [f32; 3]| extremes(chunk, field);
        let position = of(|s| s.mean);
        let scale = of(|s| s.scale.map(f32::ln));
        let color = if colored { of(|s| s.color) } else { [[0.0; 3], [1.0; 3]] };
        let ends = if colored { vec![position, scale, color] } else { vec![position, scale] };
        bytes.extend(ends.as_flattened().as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        for splat in chunk {
            words.push(pack(shares(splat.mean, position), [11, 10, 11]));
            words.push(pack_rotation(splat.rotation));
            words.push(pack(shares(splat.scale.map(f32::ln), scale), [11, 10, 11]));
            let [r, g, b] = shares(splat.color, color);
            words.push(pack([r, g, b, splat.opacity], [8; 4]));
        }
    }
    bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    bytes.extend((0..splats.len() * n_rest).map(|i| if n_rest == 9 { i as u8 } else { 128 }));
    bytes
}

fn extremes(chunk: &[Splat], field: fn(&Splat) -> [f32; 3]) -> [[f32; 3]; 2] {
    let by = |pick: fn(f32, f32) -> f32| {
        let all = chunk.iter().map(field);
        all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i]))).unwrap()
    };
    [by(f32::min), by(f32::max)]
}

fn shares(v: [f32; 3], [min, max]: [[f32; 3]; 2]) -> [f32; 3] {
    std::array::from_fn(|i| (v[i] - min[i]) / (max[i] - min[i]).max(1e-9))
}

fn pack<const N: usize>(shares: [f32; N], bits: [u32; N]) -> u32 {
    let mut word = 0;
    for (share, n) in shares.into_iter().zip(bits) {
        word = word << n | (share * ((1u32 << n) - 1) as f32).round() as u32;
    }
    word
}

fn pack_rotation(q: [f32; 4]) -> u32 {
    let largest = (0..4).max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs())).unwrap();
    let sign = q[largest].signum();
    let others: Vec<f32> = (0..4).filter(|&i| i != largest).map(|i| sign * q[i]).collect();
    let share = |v: f32| v * std::f32::consts::FRAC_1_SQRT_2 + 0.5;
    (largest as u32) << 30 | pack([share(others[0]), share(others[1]), share(others[2])], [10; 3])
}

fn assert_read(model: &Imported, splats: &[Splat]) {
    assert_eq!((model.splats.len(), model.skipped), (splats.len(), 0));
    for (a, b) in splats.iter().zip(model.splats.iter()) {
        // About 1/1000 of the chunk's range, which is 100 units and eight decades of scale.
        assert!(distance(a.mean, b.mean) < 0.06, "{:?} {:?}", a.mean, b.mean);
        assert!(distance(a.scale.map(f32::ln), b.scale.map(f32::ln)) < 0.011);
        assert!(distance(a.color, b.color) < 0.003 && (a.opacity - b.opacity).abs() < 0.003);
        let negative = b.rotation.map(|v| -v);
        let turn = distance(a.rotation, b.rotation).min(distance(a.rotation, negative));
        assert!(turn < 0.003, "{:?} {:?}", a.rotation, b.rotation);
    }
}

#[test]
fn packed_splats_are_read() {
    let splats = random_splats(600, 61);
    for colored in [true, false] {
        let model = read_bytes(&compressed(&splats, 0, colored)).unwrap();
        assert_read(&model, &splats);
        assert!(model.notes.is_empty() && model.splats.view().appearance().is_empty());
        assert_eq!(model.comments, ["by hand"]);
    }
    let model = read_bytes(&compressed(&splats, 45, true)).unwrap();
    assert_eq!(model.notes, [Note::ViewDependentColorIgnored { n_coefficients: 36 }]);
}

#[test]
fn harmonics_stand_channel_by_channel() {
    let splats = random_splats(2, 62);
    let model = read_bytes(&compressed(&splats, 9, true)).unwrap();
    // Bytes 9 to 17 belong to the second splat; its red channel is 9, 10 and 11.
    let value = |byte: f32| ((byte + 0.5) / 256.0 - 0.5) * 8.0;
    let of = |f: f32| 0.488_602_5 * value(f);
    let red = model.splats.view().appearance()[1].directional[0];
    assert!(distance(red, [-of(11.0), -of(9.0), of(10.0)]) < 1e-5, "{red:?}");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let good = compressed(&random_splats(3, 63), 9, true);
    let change = |from: &str, to: &str| {
        let at = good.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&good[..at], to.as_bytes(), &good[at + from.len()..]].concat()
    };
    for (from, to, message) in [
        ("chunk 1", "chunk 9", "element chunk: expected 9 rows of at least 72 bytes"),
        ("chunk 1", "chunk 2", "element vertex: expected 3 rows"),
        ("chunk 1", "chunk 0", "element chunk: expected 1 chunks for 3 splats, found 0"),
        ("vertex 3", "vertex 4", "element sh: expected 3 rows"),
        ("vertex 3", "vertex 2", "element sh: expected 2 rows, as many as element vertex, found 3"),
        ("vertex 3", "vertex 4000000000", "element vertex: expected 4000000000 rows"),
        ("vertex 3", "points 3", "an element vertex beside element chunk"),
        ("sh 3", "sh 30", "element sh: expected 30 rows"),
        ("packed_scale", "scale", "element vertex: expected property packed_scale"),
        ("max_scale_z", "max_scale", "element chunk: expected property max_scale_z"),
        ("property uchar f_rest_8\n", "", "element sh: expected 9, 24 or 45 coefficients, found 8"),
    ] {
        assert_fails(to, &change(from, to), &[message]);
    }
    let mut broken = good.clone();
    let start = good.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    broken[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_fails("nan", &broken, &["expected at least one finite row, found none (3 skipped)"]);
}
