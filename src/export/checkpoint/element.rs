//! What sections are made of.

use bytemuck::Pod;

/// Type of a section's elements; the discriminant is its code in the file. The last three are this
/// program's additions to the published codes (`export.md`, Checkpoint container).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ElementType {
    /// Bytes of UTF-8 text: JSON.
    Bytes = 0,
    /// Floats of double precision, 8 bytes each.
    F64 = 1,
    /// Floats of single precision, 4 bytes each.
    F32 = 2,
    /// Unsigned integers of 4 bytes.
    U32 = 3,
    /// Unsigned integers of 8 bytes.
    U64 = 4,
    /// Signed integers of 8 bytes.
    I64 = 5,
    /// Signed 128-bit: the low 64 bits, then the high ones.
    I128 = 6,
    /// Signed integers of 4 bytes.
    I32 = 7,
    /// Unsigned integers of 2 bytes.
    U16 = 8,
}

/// Rust types that are elements.
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
