//! Storage precision of a trainer's points and means.

use crate::math::real::Real;
use crate::model::paper::mixture::InitialModel;
use crate::model::paper::state::InitialMeans;
use crate::observation::points::Points;

/// `f32`, required by the fused kernels, or `f64`, the reference.
pub trait PaperScalar: Real {
    /// Returns the points if stored in f32.
    fn narrow_points(points: &Points<Self>) -> Option<&Points<f32>>;

    /// Returns a frame's points in this precision, converted into `memory` if needed.
    fn points<'a>(points: &'a Points<f32>, memory: &'a mut Points<Self>) -> &'a Points<Self>;

    /// Returns the model if stored in f32.
    fn narrow_model(model: &InitialModel<Self>) -> Option<&InitialModel<f32>>;

    /// Returns rows rounded to f32, copied into `memory` if needed.
    fn narrow_rows<'a>(rows: &'a [[Self; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]];

    /// Converts means to the checkpoint's representation.
    fn means(space: &[[Self; 3]], color: &[[Self; 3]]) -> InitialMeans;
}

impl PaperScalar for f32 {
    fn narrow_points(points: &Points<f32>) -> Option<&Points<f32>> {
        Some(points)
    }

    fn points<'a>(points: &'a Points<f32>, _: &'a mut Points<f32>) -> &'a Points<f32> {
        points
    }

    fn narrow_model(model: &InitialModel<f32>) -> Option<&InitialModel<f32>> {
        Some(model)
    }

    fn narrow_rows<'a>(rows: &'a [[f32; 3]], _: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        rows
    }

    fn means(space: &[[f32; 3]], color: &[[f32; 3]]) -> InitialMeans {
        InitialMeans::F32 { space: space.to_vec(), color: color.to_vec() }
    }
}

impl PaperScalar for f64 {
    fn narrow_points(_: &Points<f64>) -> Option<&Points<f32>> {
        None
    }

    fn points<'a>(points: &'a Points<f32>, memory: &'a mut Points<f64>) -> &'a Points<f64> {
        points.cast_into(memory);
        memory
    }

    fn narrow_model(_: &InitialModel<f64>) -> Option<&InitialModel<f32>> {
        None
    }

    fn narrow_rows<'a>(rows: &'a [[f64; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        memory.clear();
        memory.extend(rows.iter().map(|row| row.map(|v| v as f32)));
        memory
    }

    fn means(space: &[[f64; 3]], color: &[[f64; 3]]) -> InitialMeans {
        InitialMeans::F64 { space: space.to_vec(), color: color.to_vec() }
    }
}
