//! Element types of sections.

use crate::model::attributes::StoredModel;
use bytemuck::Pod;

/// Type of a section's elements. The discriminant is the code of the type in the file.
// The last three extend the published codes (`files.md`, Checkpoint container).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ElementType {
    /// UTF-8 text in JSON.
    Bytes = 0,
    F64 = 1,
    F32 = 2,
    U32 = 3,
    U64 = 4,
    I64 = 5,
    /// 128-bit signed integers, low 64 bits first.
    I128 = 6,
    I32 = 7,
    U16 = 8,
}

pub(super) trait Stored: Pod {
    const ELEMENT: ElementType;
}

macro_rules! stored {
    ($($type:ty => $element:ident),*) => {
        $(impl Stored for $type {
            const ELEMENT: ElementType = ElementType::$element;
        })*
    };
}

stored!(u8 => Bytes, f64 => F64, f32 => F32, u32 => U32, u64 => U64, i64 => I64, i128 => I128, i32 => I32, u16 => U16);

impl ElementType {
    pub(super) fn of_code(code: u32) -> Option<Self> {
        use ElementType::{Bytes, F32, F64, I32, I64, I128, U16, U32, U64};
        [Bytes, F64, F32, U32, U64, I64, I128, I32, U16].into_iter().find(|e| *e as u32 == code)
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::Bytes => 1,
            Self::U16 => 2,
            Self::F32 | Self::U32 | Self::I32 => 4,
            Self::F64 | Self::U64 | Self::I64 => 8,
            Self::I128 => 16,
        }
    }
}

/// Contents of a checkpoint. This module does not interpret the JSON texts, which `pipeline` writes and
/// reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Every setting that affects the result, as JSON.
    pub config: String,
    /// Program, time and dataset, as JSON.
    pub meta: String,
    /// Everything besides the settings that affects the last bits of the result, as JSON.
    pub numerics: String,
    /// Reports of the frames trained on so far, as JSON.
    pub history: Option<String>,
    /// Progress of the run.
    pub cursor: Cursor,
    /// Model of either preset, with all its sufficient statistics.
    pub model: StoredModel,
}

/// Progress of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Number of frames trained on.
    pub frames: u64,
    /// Number of points trained on, over all frames.
    pub points: u64,
    /// Visited frames (trained on or skipped) in order, as indices in their dataset split. Each pass
    /// lists a frame at most once.
    pub visited: Vec<u32>,
}

/// Checkpoint read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedCheckpoint {
    /// Validated contents.
    pub checkpoint: Checkpoint,
    /// Format version, major and minor.
    pub version: (u16, u16),
    /// Size of the file in bytes.
    pub bytes: u64,
}
