//! The precision in which a trainer keeps points and means.

use crate::math::points::Points;
use crate::math::real::Real;
use crate::model::mixture::InitialModel;
use crate::model::state::Means;

/// `f32`, which the fused kernels read, or `f64`, the oracle.
pub trait Scalar: Real {
    /// Points and model in f32, if that is what they are kept in.
    fn as_narrow<'a>(
        points: &'a Points<Self>,
        model: &'a InitialModel<Self>,
    ) -> Option<(&'a Points<f32>, &'a InitialModel<f32>)>;

    /// Rows rounded to f32, in `memory` where they have to be copied.
    fn narrow_rows<'a>(rows: &'a [[Self; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]];

    /// Means of this precision, as checkpoints hold them.
    fn means(space: &[[Self; 3]], color: &[[Self; 3]]) -> Means;
}

impl Scalar for f32 {
    fn as_narrow<'a>(
        points: &'a Points<f32>,
        model: &'a InitialModel<f32>,
    ) -> Option<(&'a Points<f32>, &'a InitialModel<f32>)> {
        Some((points, model))
    }

    fn narrow_rows<'a>(rows: &'a [[f32; 3]], _: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        rows
    }

    fn means(space: &[[f32; 3]], color: &[[f32; 3]]) -> Means {
        Means::F32 { space: space.to_vec(), color: color.to_vec() }
    }
}

impl Scalar for f64 {
    fn as_narrow<'a>(
        _: &'a Points<f64>,
        _: &'a InitialModel<f64>,
    ) -> Option<(&'a Points<f32>, &'a InitialModel<f32>)> {
        None
    }

    fn narrow_rows<'a>(rows: &'a [[f64; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        memory.clear();
        memory.extend(rows.iter().map(|row| row.map(|v| v as f32)));
        memory
    }

    fn means(space: &[[f64; 3]], color: &[[f64; 3]]) -> Means {
        Means::F64 { space: space.to_vec(), color: color.to_vec() }
    }
}
