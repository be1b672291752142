//! PLY files: splats in the 3DGS layout and coloured points. This file holds the header: elements, properties,
//! comments.
//!
//! The parser is hand-written: its messages state the line, and it limits the header size before it
//! searches for the end of the header.

mod body;
mod compressed;
pub(super) mod read;
pub(super) mod write;

use crate::export::error::{Fault, shorten};
use std::borrow::Cow;
use std::collections::HashSet;

/// Number of degree 1 harmonic coefficients per colour channel.
const N_REST_DEGREE_1: usize = 3;
/// Number of harmonic coefficients of degrees 1 to 3 together, per colour channel.
const N_REST_DEGREE_3: usize = 15;
/// Maximum header size in bytes.
// The limit of SuperSplat (`files.md`, PLY of splats); 62 properties take 1.5 KB.
pub(super) const MAX_HEADER_BYTES: usize = 128 * 1024;

#[derive(Debug)]
pub(super) struct PlyHeader {
    pub encoding: Encoding,
    pub elements: Vec<PlyElement>,
    pub comments: Vec<String>,
    pub body_offset: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug)]
pub(super) struct PlyElement {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl PlyElement {
    /// Removes the prefixes of CloudCompare, such as `scalar_` in `scalar_scale_0`, unless another property has
    /// the name without it.
    fn strip_prefixes(&mut self) {
        let names: HashSet<String> = self.properties.iter().map(|p| p.name.clone()).collect();
        for property in &mut self.properties {
            let name = property.name.strip_prefix("scalar_").unwrap_or(&property.name);
            let name = name.strip_prefix("scal_").unwrap_or(name);
            if !names.contains(name) {
                property.name = name.to_owned();
            }
        }
    }

    /// Returns the element as messages name it.
    pub fn place(&self) -> String {
        format!("element {}", shorten(&self.name))
    }

    /// Returns the index of the property with this name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|property| property.name == name)
    }
}

#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

/// Kind of a property: one value per row, or a length followed by that many values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { length: Scalar, item: Scalar },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    /// Returns the value that represents full intensity of a colour channel of this type.
    pub fn full_channel(self) -> f64 {
        match self {
            Scalar::F32 | Scalar::F64 => 1.0,
            Scalar::I16 | Scalar::U16 => 65535.0,
            Scalar::I8 | Scalar::U8 | Scalar::I32 | Scalar::U32 => 255.0,
        }
    }
}

impl PlyHeader {
    pub fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut header = PlyHeader {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
            comments: Vec::new(),
            body_offset: 0,
        };
        let mut has_format = false;
        let mut number = 0;
        loop {
            number += 1;
            let line = Line { number, text: next_line(bytes, &mut header.body_offset)? };
            let mut words = line.text.split_ascii_whitespace();
            match words.next() {
                Some("ply") if number == 1 => {}
                Some("end_header") if has_format => {
                    header.elements.iter_mut().for_each(PlyElement::strip_prefixes);
                    return Ok(header);
                }
                Some("format") => {
                    header.encoding = line.encoding()?;
                    has_format = true;
                }
                Some("comment") => {
                    let text = line.text.trim_start().trim_start_matches("comment");
                    header.comments.push(text.trim().to_owned());
                }
                // Old scanners write `obj_info`, editors leave empty lines; both are irrelevant.
                Some("obj_info") | None => {}
                Some("element") => header.elements.push(line.element()?),
                Some("property") => match header.elements.last_mut() {
                    Some(element) => element.properties.push(line.property()?),
                    None => return Err(line.fault("an element before its properties")),
                },
                Some("end_header") => {
                    return Err(line.fault("a line \"format …\" before the end of the header"));
                }
                Some(_) => {
                    return Err(line.fault("format, comment, element, property or end_header"));
                }
            }
        }
    }
}

struct Line<'a> {
    number: usize,
    text: Cow<'a, str>,
}

impl Line<'_> {
    fn encoding(&self) -> Result<Encoding, Fault> {
        match self.words().as_slice() {
            ["format", "ascii", "1.0"] => Ok(Encoding::Ascii),
            ["format", "binary_little_endian", "1.0"] => Ok(Encoding::LittleEndian),
            ["format", "binary_big_endian", "1.0"] => Ok(Encoding::BigEndian),
            _ => Err(self.fault("format ascii, binary_little_endian or binary_big_endian 1.0")),
        }
    }

    fn element(&self) -> Result<PlyElement, Fault> {
        let expected = "element NAME COUNT";
        match self.words().as_slice() {
            ["element", name, count] => Ok(PlyElement {
                name: (*name).to_owned(),
                count: count.parse().map_err(|_| self.fault(expected))?,
                properties: Vec::new(),
            }),
            _ => Err(self.fault(expected)),
        }
    }

    fn property(&self) -> Result<Property, Fault> {
        let scalar = |name: &str| {
            Scalar::parse(name).ok_or_else(|| self.fault("a type such as float, double or uchar"))
        };
        let (name, kind) = match self.words().as_slice() {
            ["property", "list", length, item, name] => {
                let length = scalar(length)?;
                // A fraction is not a length.
                if matches!(length, Scalar::F32 | Scalar::F64) {
                    return Err(self.fault("an integer type for the length of a list"));
                }
                (*name, Kind::List { length, item: scalar(item)? })
            }
            ["property", kind, name] => (*name, Kind::Scalar(scalar(kind)?)),
            _ => return Err(self.fault("property TYPE NAME")),
        };
        Ok(Property { name: name.to_owned(), kind })
    }

    fn words(&self) -> Vec<&str> {
        self.text.split_ascii_whitespace().collect()
    }

    fn fault(&self, expected: &str) -> Fault {
        Fault::malformed(
            format!("header line {}", self.number),
            expected,
            format!("\"{}\"", shorten(&self.text)),
        )
    }
}

fn next_line<'a>(bytes: &'a [u8], offset: &mut usize) -> Result<Cow<'a, str>, Fault> {
    let end = bytes.len().min(MAX_HEADER_BYTES).max(*offset);
    let searched = bytes.get(*offset..end).unwrap_or_default();
    // A line without its break is truncated.
    let mut parts = searched.splitn(2, |&b| b == b'\n');
    let (Some(line), Some(_)) = (parts.next(), parts.next()) else {
        let found = match bytes.len() > MAX_HEADER_BYTES {
            true => format!("no end within {MAX_HEADER_BYTES} bytes"),
            false => "the end of the file".to_owned(),
        };
        return Err(Fault::malformed("header", "a line \"end_header\"", found));
    };
    *offset += line.len() + 1;
    // Comments may have any encoding, which must not prevent reading the model.
    Ok(String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line)))
}
