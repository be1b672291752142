//! Attribute values behind accessors, buffer views and buffers, validated before they are read.
//!
//! Every offset and length is checked against the available bytes before anything is read or allocated,
//! because files are untrusted. The permitted attribute types follow the extension's text exactly: a wrong
//! `normalized` would change every value.

use super::schema::{Accessor, Root};
use super::{COLOR_0, OPACITY, POSITION, ROTATION, SCALE, SH_0, SH_1};
use crate::export::error::{Fault, shorten};

const I8: u32 = 5120;
const U8: u32 = 5121;
const I16: u32 = 5122;
const U16: u32 = 5123;
const F32: u32 = 5126;

/// Permitted types of an attribute: vector types with their widths, and component types with their
/// `normalized` flag (`export.md`, GLB; `COLOR_0` as in glTF 2.0, 3.7.2.1).
struct Rule {
    kinds: &'static [(&'static str, usize)],
    components: &'static [(u32, bool)],
}

const VEC3: &[(&str, usize)] = &[("VEC3", 3)];
const FLOATS: &[(u32, bool)] = &[(F32, false)];

fn attribute_rule(semantic: &str) -> Rule {
    match semantic {
        ROTATION => {
            Rule { kinds: &[("VEC4", 4)], components: &[(F32, false), (I8, true), (I16, true)] }
        }
        SCALE => Rule {
            kinds: VEC3,
            components: &[
                (F32, false),
                (U8, false),
                (U16, false),
                (U8, true),
                (U16, true),
                (I8, false),
                (I16, false),
                (I8, true),
                (I16, true),
            ],
        },
        OPACITY => {
            Rule { kinds: &[("SCALAR", 1)], components: &[(F32, false), (U8, true), (U16, true)] }
        }
        COLOR_0 => Rule {
            kinds: &[("VEC3", 3), ("VEC4", 4)],
            components: &[(F32, false), (U8, true), (U16, true)],
        },
        POSITION | SH_0 => Rule { kinds: VEC3, components: FLOATS },
        _ if SH_1.contains(&semantic) => Rule { kinds: VEC3, components: FLOATS },
        _ => Rule { kinds: &[], components: &[] },
    }
}

pub(super) struct Column<'a> {
    /// Bytes from the start of the first row to the end of the last.
    bytes: &'a [u8],
    stride: usize,
    component: u32,
    normalized: bool,
    /// Number of rows, one per splat or point.
    pub count: usize,
    /// Index and attribute of the accessor, for messages.
    pub place: String,
}

impl<'a> Column<'a> {
    /// Opens accessor `index` as the attribute `semantic`.
    pub fn open(
        root: &Root,
        buffers: &'a [impl AsRef<[u8]>],
        index: usize,
        semantic: &str,
    ) -> Result<Self, Fault> {
        let place = format!("accessor {index} ({semantic})");
        let fault = |expected: &str, found: String| Fault::malformed(&place, expected, found);
        let accessor = root.accessors.get(index).ok_or_else(|| {
            fault("an accessor of that number", format!("{} accessors", root.accessors.len()))
        })?;
        let row_bytes = row_bytes(accessor, semantic, &place)?;
        let view_index = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), None) => view,
            _ => return Err(unsupported(format!("{place} is sparse"))),
        };
        let (data, stride) = view_bytes(root, buffers, view_index, &place)?;
        let stride = stride.unwrap_or(row_bytes);
        if stride < row_bytes {
            return Err(fault(&format!("a byteStride of {row_bytes} or more"), stride.to_string()));
        }
        let needed = match accessor.count {
            0 => Some(0),
            n => (n - 1).checked_mul(stride).and_then(|bytes| bytes.checked_add(row_bytes)),
        };
        let bytes = needed.and_then(|n| slice(data, accessor.byte_offset, n)).ok_or_else(|| {
            fault(
                &format!("{} rows inside bufferView {view_index}", accessor.count),
                format!("{} bytes", data.len()),
            )
        })?;
        let Accessor { component_type: component, normalized, count, .. } = *accessor;
        Ok(Self { bytes, stride, component, normalized, count, place })
    }

    pub fn is_signed_integer(&self) -> bool {
        matches!(self.component, I8 | I16)
    }

    /// Returns the first `N` components of a row; the type must have at least `N`.
    pub fn get<const N: usize>(&self, row: usize) -> [f64; N] {
        let size = component_size(self.component);
        let row = self.bytes.get(row * self.stride..).unwrap_or_default();
        let bytes = |i: usize| row.get(i * size..(i + 1) * size).unwrap_or_default();
        std::array::from_fn(|i| self.component(bytes(i)))
    }

    fn component(&self, bytes: &[u8]) -> f64 {
        // Divided by the largest positive value of the type, as in glTF 2.0, 3.11; −128 is clamped to −1.
        let (value, largest) = match (self.component, bytes) {
            (I8, &[a]) => (f64::from(a as i8), 127.0),
            (U8, &[a]) => (f64::from(a), 255.0),
            (I16, &[a, b]) => (f64::from(i16::from_le_bytes([a, b])), 32767.0),
            (U16, &[a, b]) => (f64::from(u16::from_le_bytes([a, b])), 65535.0),
            (_, &[a, b, c, d]) => (f64::from(f32::from_le_bytes([a, b, c, d])), 1.0),
            _ => (f64::NAN, 1.0),
        };
        if self.normalized { (value / largest).max(-1.0) } else { value }
    }
}

/// Returns the bytes of a buffer view and its stride, if stated.
fn view_bytes<'a>(
    root: &Root,
    buffers: &'a [impl AsRef<[u8]>],
    index: usize,
    place: &str,
) -> Result<(&'a [u8], Option<usize>), Fault> {
    let view = root.buffer_views.get(index).ok_or_else(|| {
        Fault::malformed(place, "a bufferView of that number", format!("number {index}"))
    })?;
    // Compression extensions have it in their name, such as `EXT_meshopt_compression`.
    if let Some(name) = view.extensions.keys().find(|name| name.contains("compression")) {
        return Err(unsupported(format!("{place} is compressed ({})", shorten(name))));
    }
    let (start, length) = (view.byte_offset, view.byte_length);
    let buffer = buffers.get(view.buffer).map(AsRef::as_ref);
    match buffer.and_then(|bytes| slice(bytes, start, length)) {
        Some(data) => Ok((data, view.byte_stride)),
        None => {
            let expected = format!("bufferView {index} inside buffer {}", view.buffer);
            Err(Fault::malformed(place, expected, format!("{length} bytes from {start}")))
        }
    }
}

/// Returns the bytes per row, if the accessor's type is permitted for the attribute.
fn row_bytes(accessor: &Accessor, semantic: &str, place: &str) -> Result<usize, Fault> {
    let rule = attribute_rule(semantic);
    let width = rule.kinds.iter().find(|(kind, _)| *kind == accessor.kind).map(|(_, n)| n);
    let component = (accessor.component_type, accessor.normalized);
    match (width, rule.components.contains(&component)) {
        (Some(width), true) => Ok(width * component_size(accessor.component_type)),
        _ => {
            let kinds: Vec<&str> = rule.kinds.iter().map(|(kind, _)| *kind).collect();
            let components: Vec<String> =
                rule.components.iter().map(|&(c, normalized)| describe(c, normalized)).collect();
            let expected = format!("{} of {}", kinds.join("/"), components.join("/"));
            let (component, normalized) = component;
            let kind = shorten(&accessor.kind);
            let found = format!("{kind} of {}", describe(component, normalized));
            Err(Fault::malformed(place, expected, found))
        }
    }
}

fn describe(component: u32, normalized: bool) -> String {
    format!("{}{component}", if normalized { "normalized " } else { "" })
}

fn component_size(component: u32) -> usize {
    match component {
        I8 | U8 => 1,
        I16 | U16 => 2,
        _ => 4,
    }
}

fn slice(bytes: &[u8], start: usize, length: usize) -> Option<&[u8]> {
    bytes.get(start..start.checked_add(length)?)
}

fn unsupported(feature: String) -> Fault {
    Fault::Unsupported { feature, advice: "export plain, uncompressed attributes" }
}
