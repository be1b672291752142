//! Text and archives from outside the program, checked before they are printed, parsed or unpacked.

use std::borrow::Cow;
use std::io::{Error, Read, Result as IoResult, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use zip::ZipArchive;
use zip::result::ZipResult;

/// Largest memory of JSON and of its parsed values, bytes. A list of 90,000 frames with a matrix each takes
/// as much.
pub const MAX_JSON_MEMORY: usize = 208 << 20;

/// Size of a JSON text, found without parsing it. A few kilobytes of compressed text may hold millions of
/// empty objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JsonOutline {
    /// Largest number of nested arrays and objects.
    pub depth: usize,
    /// Estimate of the memory of the parsed values in bytes, without the texts in them.
    pub memory: usize,
    /// Estimate of the memory of the texts in them, bytes.
    pub texts: usize,
}

impl JsonOutline {
    /// Measures a text, which may be damaged.
    pub fn of(json: &[u8]) -> Self {
        // Sizes of `serde_json::Value`: a value, the smallest block of a text, the first growth of an array, a
        // node of a map.
        const VALUE: usize = 32;
        const TEXT: usize = 32;
        const ARRAY: usize = 144;
        const ENTRY: usize = 64;
        const OBJECT: usize = 656;
        let (mut outline, mut depth) = (Self::default(), 0usize);
        let (mut is_string, mut is_escaped) = (false, false);
        for &byte in json {
            if is_string {
                is_string = is_escaped || byte != b'"';
                is_escaped = !is_escaped && byte == b'\\';
                outline.texts += 1;
                continue;
            }
            outline.memory += match byte {
                b',' => VALUE,
                b':' => ENTRY,
                b'[' => ARRAY,
                b'{' => OBJECT,
                _ => 0,
            };
            match byte {
                b'"' => {
                    is_string = true;
                    outline.texts += TEXT;
                }
                b'[' | b'{' => depth += 1,
                b']' | b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            outline.depth = outline.depth.max(depth);
        }
        outline
    }
}

/// Returns a text in which characters that control a terminal or the direction of text are escaped. Line
/// feeds and tabs stay.
pub fn displayable(text: &str) -> Cow<'_, str> {
    escaped(text, |plain, c| plain.extend(c.escape_default()))
}

/// Returns a JSON text with the same characters escaped as [`displayable`] escapes, in the form of JSON.
pub fn displayable_json(json: &str) -> Cow<'_, str> {
    // All of them are below 2^16.
    escaped(json, |plain, c| plain.push_str(&format!("\\u{:04x}", u32::from(c))))
}

fn escaped(text: &str, escape: fn(&mut String, char)) -> Cow<'_, str> {
    let is_control = |c: char| match c {
        '\n' | '\t' => false,
        // Marks, embeddings, overrides and isolates of text direction.
        '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}' => true,
        c => c.is_control(),
    };
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let mut plain = String::with_capacity(text.len());
    for c in text.chars() {
        match is_control(c) {
            true => escape(&mut plain, c),
            false => plain.push(c),
        }
    }
    Cow::Owned(plain)
}

/// First bytes of a member's header in the directory of an archive.
const HEADER: [u8; 4] = *b"PK\x01\x02";

/// Opens a zip archive. `None` if its directory, or what is tried as such, has more than `most` members, each of
/// which takes 700 bytes of memory.
pub fn open_zip<R: Read + Seek>(
    source: R,
    most: u64,
) -> Option<ZipResult<ZipArchive<CountedHeaders<R>>>> {
    // The first header is read twice, to find the start of the archive.
    let left = Arc::new(AtomicU64::new(most.saturating_add(2)));
    let zip = ZipArchive::new(CountedHeaders { source, left: left.clone() });
    // Members may hold archives, whose headers do not count.
    (left.swap(u64::MAX, Ordering::Relaxed) != 0).then_some(zip)
}

/// Source of an archive that fails once more headers of members than a limit were read. Counts in records at
/// the end do not bound them: an archive may hold several such records, and at any place.
#[derive(Debug)]
pub struct CountedHeaders<R> {
    source: R,
    /// Number of headers that may still be read; 0 after too many.
    left: Arc<AtomicU64>,
}

impl<R: Read> Read for CountedHeaders<R> {
    fn read(&mut self, bytes: &mut [u8]) -> IoResult<usize> {
        let n = self.source.read(bytes)?;
        // Each header is read by a call of its own.
        if bytes.get(..n).is_some_and(|read| read.starts_with(&HEADER)) {
            let left = self.left.load(Ordering::Relaxed).saturating_sub(1);
            self.left.store(left, Ordering::Relaxed);
            if left == 0 {
                return Err(Error::other("more members than the limit"));
            }
        }
        Ok(n)
    }
}

impl<R: Seek> Seek for CountedHeaders<R> {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.source.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_get_no_controls_from_files() {
        assert_eq!(displayable("ä\tb\nc"), "ä\tb\nc");
        let text = displayable("a\u{1b}]0;title\u{7}\u{9b}2J\r\u{202e}b");
        assert_eq!(text, "a\\u{1b}]0;title\\u{7}\\u{9b}2J\\r\\u{202e}b");
    }

    #[test]
    fn escaped_json_means_the_same() {
        let name = "a\u{9b}2J\u{202e}\u{7f}\"\n";
        let json = serde_json::to_string(name).unwrap();
        let shown = displayable_json(&json);
        assert!(shown.is_ascii() && displayable(&shown) == shown, "{shown}");
        assert_eq!(serde_json::from_str::<String>(&shown).ok().as_deref(), Some(name));
    }

    #[test]
    fn outlines_bound_what_parsers_allocate() {
        let outline = |json: &str| JsonOutline::of(json.as_bytes());
        // Braces and commas in texts do not count, and quotes in them do not end them.
        let text = r#""{[,\"{\\""#;
        let texts = 32 + text.len() - 1;
        assert_eq!(outline(text), JsonOutline { depth: 0, memory: 0, texts });
        assert_eq!(outline(r#"{"a": [1, 2, {}]}"#).depth, 3);
        assert_eq!(outline("]]]]").depth, 0);
        assert_eq!(outline("[[]][[]]").depth, 2);
        // An object, an entry, an array and a value.
        assert_eq!(outline(r#"{"a":[1,2]}"#).memory, 656 + 64 + 144 + 32);
        let frame =
            r#"{"file_path": "a", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},"#;
        let JsonOutline { memory, texts, .. } = outline(frame);
        assert!(90_000 * (frame.len() + memory + texts) < MAX_JSON_MEMORY, "{memory} {texts}");
        assert!(outline(&"{},".repeat(1 << 20)).memory > MAX_JSON_MEMORY);
    }
}
