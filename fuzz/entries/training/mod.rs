//! Trainers as a robot's program uses them: arbitrary frames, settings of either preset and order of calls.

mod paper;
mod scene;

use super::bytes::Bytes;
use glam::{DMat4, DQuat, DVec3};
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, StoredModel, parse, to_bytes};
use vbgs_studio::math::camera::Intrinsics;

const MAX_COMMANDS: usize = 24;
/// Smallest first byte of an input for the paper preset.
pub const FIRST_OF_PAPER: u8 = 128;

/// Reads settings, then executes commands until the bytes end.
pub fn training(data: &[u8]) {
    steps_wider(data);
}

/// Like [`training`]. Returns the number of steps by which the scene's structural scale was coarsened.
pub fn steps_wider(data: &[u8]) -> u32 {
    let mut input = Bytes(data);
    match input.byte() {
        kind @ 0..FIRST_OF_PAPER => scene::train(kind, input),
        kind => {
            paper::train(kind - FIRST_OF_PAPER, input);
            0
        }
    }
}

/// Reads a frame as from a camera driver; `None` if it is refused.
fn frame(input: &mut Bytes) -> Option<Frame> {
    let [width, height] = [1 + u32::from(input.byte() % 16), 1 + u32::from(input.byte() % 12)];
    let n = (width * height) as usize;
    let mut intrinsics = Intrinsics::from_horizontal_fov(width, height, 1.0);
    if input.flag() {
        intrinsics.fx = input.number().into();
        intrinsics.cy = input.number().into();
    }
    let turn = DVec3::new(input.number().into(), input.number().into(), 0.0);
    let place = DVec3::new(input.number().into(), 0.0, input.number().into());
    let pose = DMat4::from_rotation_translation(DQuat::from_scaled_axis(turn), place);
    let lengths: Vec<f32> = match input.byte() % 3 {
        // A plane, and arbitrary depths in front of it.
        0 => {
            let (length, slope, odd) = (input.number(), input.number(), input.number());
            let at = usize::from(input.byte());
            let plane = (0..n).map(|i| length + slope * (i % width as usize) as f32 / 64.0);
            plane.enumerate().map(|(i, length)| if i == at { odd } else { length }).collect()
        }
        1 => (0..n).map(|_| input.number()).collect(),
        _ => vec![input.number(); n],
    };
    let color: Vec<u8> = match input.flag() {
        true => (0..3 * n).map(|_| input.byte()).collect(),
        false => vec![input.byte(); 3 * n],
    };
    let depth = DepthBuffer {
        lengths: &lengths,
        kind: if input.flag() { DepthKind::Z } else { DepthKind::RayDistance },
        trusted: [0.0, f64::INFINITY],
    };
    Frame::from_memory("0", intrinsics, pose, ColorBuffer::Rgb8(&color), Some(depth)).ok()
}

/// Returns the model as read from its checkpoint.
fn read_back(model: StoredModel, frames: u64) -> StoredModel {
    let text = || "{}".to_owned();
    let visited = (0..frames as u32).collect();
    let cursor = Cursor { frames, points: 0, visited };
    let checkpoint =
        Checkpoint { config: text(), meta: text(), numerics: text(), history: None, cursor, model };
    let bytes = to_bytes(&checkpoint);
    let read =
        parse(&bytes).unwrap_or_else(|defect| panic!("a model that cannot be read: {defect}"));
    read.checkpoint.model
}
