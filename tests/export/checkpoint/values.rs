//! Impossible numbers are refused by section, component and axis, even under valid checksums.

use super::raw::edited;
use super::{assert_refused, fixed64, fixed128, means_f32, means_f64, mixture, sample};
use vbgs_studio::export::checkpoint::{Checkpoint, parse, to_bytes};
use vbgs_studio::model::paper::state::{Carry, InitialMeans, ModelState, Totals};

fn with_model(edit: impl FnOnce(&mut ModelState), totals: Totals) -> Vec<u8> {
    let mut checkpoint = sample(means_f32(), totals);
    edit(mixture(&mut checkpoint).2);
    to_bytes(&checkpoint)
}

#[test]
fn means_and_weights() {
    for wild in [f32::NAN, f32::INFINITY] {
        let set = |model: &mut ModelState| {
            let InitialMeans::F32 { space, .. } = &mut model.means else { unreachable!() };
            space[17][1] = wild;
        };
        let parts = ["MINI[component 17, y]", "a finite number", &wild.to_string()];
        assert_refused(&with_model(set, fixed64()), &parts);
    }
    let mut checkpoint = sample(means_f64(), fixed128());
    let InitialMeans::F64 { color, .. } = &mut mixture(&mut checkpoint).2.means else {
        unreachable!()
    };
    color[3][2] = f64::NEG_INFINITY;
    assert_refused(&to_bytes(&checkpoint), &["MINI[component 3, blue]", "found -inf"]);
    for wild in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let bytes = with_model(|model| model.alpha_init[7] = wild, fixed64());
        assert_refused(&bytes, &["DIRI[component 7, alpha]", "a positive number"]);
    }
}

#[test]
fn sums_that_no_points_have() {
    let refused = |edit: &dyn Fn(&mut [i128; 13]), part| {
        let Totals::Fixed128(mut rows) = fixed128() else { unreachable!() };
        edit(&mut rows[12]);
        assert_refused(&with_model(|_| (), Totals::Fixed128(rows)), &[part]);
    };
    refused(&|row| row[0] = -1, "STAN[component 12, N]: expected 0 or more, found -1");
    refused(&|row| row[7] = -5, "STA2[component 12, yy]: expected 0 or more, found -5");
    refused(&|row| row[6] = row[4].max(row[9]) * 2, "STA2[component 12, xz]: expected at most");
    let negative = |rows: &mut Vec<[i64; 13]>, carries: &mut Vec<Carry>| {
        rows[4][0] = 100;
        let mut limbs = [0; 13];
        limbs[0] = -1;
        carries.insert(0, Carry { id: 4, limbs });
    };
    let Totals::Fixed64 { mut rows, mut carries } = fixed64() else { unreachable!() };
    negative(&mut rows, &mut carries);
    let bytes = with_model(|_| (), Totals::Fixed64 { rows, carries });
    assert_refused(&bytes, &["STAN[component 4, N]: expected 0 or more", "-18446744073709"]);
}

#[test]
fn carries_belong_to_components_in_order() {
    let refused = |ids: [u32; 2], part| {
        let Totals::Fixed64 { rows, mut carries } = fixed64() else { unreachable!() };
        carries.iter_mut().zip(ids).for_each(|(carry, id)| carry.id = id);
        assert_refused(&with_model(|_| (), Totals::Fixed64 { rows, carries }), &["CARI", part]);
    };
    refused([11, 5], "ascending order");
    refused([5, 5], "ascending order");
    refused([5, 20], "components below 20");
}

#[test]
fn cursor_prior_and_normalisation() {
    let refused = |edit: &dyn Fn(&mut Checkpoint), parts: &[&str]| {
        let mut checkpoint = sample(means_f32(), fixed64());
        edit(&mut checkpoint);
        assert_refused(&to_bytes(&checkpoint), parts);
    };
    refused(&|c| c.cursor.frames = 5, &["CURS", "at most 4 trained frames", "5"]);
    refused(&|c| mixture(c).0.scale[1] = 0.0, &["NORM", "a positive scale"]);
    refused(&|c| mixture(c).0.offset[0] = f64::NAN, &["NORM", "finite"]);
    refused(&|c| mixture(c).1.u0_space = -1.0, &["PRIR", "positive numbers", "-1"]);
    let bytes = to_bytes(&sample(means_f32(), fixed64()));
    let short = edited(&bytes, b"CURS", |s| s.content.truncate(8));
    assert_refused(&short, &["CURS", "2 numbers or more"]);
    let large =
        edited(&bytes, b"CURS", |s| s.content.extend_from_slice(&(1u64 << 32).to_le_bytes()));
    assert_refused(&large, &["CURS", "32 bits"]);
    let text = edited(&bytes, b"CONF", |s| s.content[0] = 0xFF);
    assert_refused(&text, &["CONF", "UTF-8"]);
}

#[test]
fn rounding_is_no_defect() {
    // A single point on the diagonal gives the largest possible off-diagonal moments.
    let (d, r) = (0.1f32, 0.7f32);
    let row = [
        r,
        r * d,
        r * d,
        r * d,
        r * d * d,
        (r * d) * d * 1.000001,
        r * d * d,
        r * d * d,
        r * d * d,
        r * d * d,
        0.0,
        0.0,
        0.0,
    ];
    let Totals::Fixed64 { mut rows, carries } = fixed64() else { unreachable!() };
    rows[1] = row.map(|v| (f64::from(v) * 2f64.powi(40)) as i64);
    rows[2] = [1; 13];
    rows[2][5] = 3; // rounding of a component with almost no responsibility
    assert!(parse(&with_model(|_| (), Totals::Fixed64 { rows, carries })).is_ok());
}
