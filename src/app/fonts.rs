//! Fonts beside those of egui: icons of buttons, and fonts of the system for letters that the window's own lack.
//!
//! Egui asks once for each such letter while it lays out a text, such as the name of a file. A separate thread
//! then searches the system's fonts; their files are never read before. Until a font is found, the letter is
//! an empty box.

use super::worker::Waker;
use crate::pipeline::job::Job;
use eframe::egui::{
    Context, FallbackRequest, FontData, FontFamily, FontInsert, FontPriority, FontProvider,
    FontTweak, InsertFontFamily,
};
use fontdb::{Database, FaceInfo, Style, Weight};
use skrifa::{FontRef, MetadataProvider};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum size of a font file that is loaded, bytes. Fonts of all Chinese, Japanese and Korean letters have
/// up to 20 MB.
const MAX_BYTES: usize = 64 << 20;
/// Maximum number of fonts that one search loads.
const MAX_FONTS: usize = 8;
/// Maximum number of letters that are looked for. Further ones stay boxes.
const MAX_LETTERS: usize = 20_000;

/// Icons of buttons, as characters of the font `assets/icons.ttf`. They are in a private plane, so that no other
/// font of the window draws them.
pub mod icon {
    pub const OPEN: &str = "\u{F0000}";
    pub const EXPORT: &str = "\u{F0001}";
    pub const TRAIN: &str = "\u{F0002}";
    pub const PAUSE: &str = "\u{F0003}";
    pub const MORE: &str = "\u{F0004}";
    pub const PREVIOUS: &str = "\u{F0005}";
    pub const NEXT: &str = "\u{F0006}";
    pub const RENDER: &str = "\u{F0007}";
    pub const COMPARE: &str = "\u{F0008}";
    pub const SHOW: &str = "\u{F0009}";
    pub const FOLLOW: &str = "\u{F000A}";
}

/// Adds the icons to the fonts of `context`.
pub fn add_icons(context: &Context) {
    // Icons are centred on the line of text, not on its base line.
    let tweak = FontTweak { y_offset_factor: 0.07, ..FontTweak::default() };
    context.add_font(FontInsert {
        name: "icons".to_owned(),
        data: FontData::from_static(ICONS).tweak(tweak),
        families: [FontFamily::Proportional].map(fallback).into(),
    });
}

const ICONS: &[u8] = include_bytes!("../../assets/icons.ttf");

/// Places a font after all others of a family.
fn fallback(family: FontFamily) -> InsertFontFamily {
    InsertFontFamily { family, priority: FontPriority::Lowest }
}

#[derive(Default)]
pub struct SystemFonts {
    missing: Arc<MissingLetters>,
    search: Option<Job<Findings>>,
    /// Letters that were looked for.
    known: BTreeSet<char>,
    is_lack_reported: bool,
}

/// Letters that no font of the window has.
#[derive(Default)]
struct MissingLetters(Mutex<BTreeSet<char>>);

impl FontProvider for MissingLetters {
    fn font_for(&self, request: &FallbackRequest<'_>) -> Option<FontInsert> {
        let mut letters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if letters.len() < MAX_LETTERS {
            letters.extend(request.cluster.chars().next());
        }
        // The layout must not wait for the files of fonts; the next one has them.
        None
    }
}

struct Findings {
    fonts: Vec<FontInsert>,
    /// Letters that no font of the system has.
    lacking: BTreeSet<char>,
}

impl SystemFonts {
    /// Registers for the missing letters of texts in `context`.
    pub fn watch(&self, context: &Context) {
        context.add_font_provider(self.missing.clone());
    }

    /// Adds fonts that were found, and starts a search if letters are missing. Returns the text of a notice
    /// about the first letters that no font has.
    pub fn update(&mut self, context: &Context, waker: &Waker) -> Option<String> {
        let ended = self.search.as_ref().and_then(Job::poll);
        let lacking = ended.and_then(|findings| {
            self.search = None;
            // A damaged font costs its letters, not the window.
            let Findings { fonts, lacking } = findings.ok()?;
            fonts.into_iter().for_each(|font| context.add_font(font));
            context.request_repaint();
            (!lacking.is_empty() && !self.is_lack_reported).then(|| lack_text(&lacking))
        });
        self.is_lack_reported |= lacking.is_some();
        if self.search.is_none() {
            self.start_search(waker);
        }
        lacking
    }

    fn start_search(&mut self, waker: &Waker) {
        let mut missing = self.missing.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Egui asks again for all of them after a font was added.
        let letters: BTreeSet<char> =
            std::mem::take(&mut *missing).difference(&self.known).copied().collect();
        if letters.is_empty() || self.known.len() > MAX_LETTERS {
            return;
        }
        self.known.extend(&letters);
        // Without a thread the letters stay boxes.
        let search = move || search_system(letters);
        self.search = Job::start_waking("fonts", waker.clone(), search).ok();
    }
}

fn lack_text(letters: &BTreeSet<char>) -> String {
    let first: Vec<String> =
        letters.iter().take(3).map(|letter| format!("U+{:04X}", u32::from(*letter))).collect();
    let more = match letters.len() - first.len() {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    format!(
        "found no font with the letters {}{more}, which are shown as boxes: install a font of their script, such as one of the Noto fonts, and restart the program",
        first.join(", ")
    )
}

/// Reads the system's fonts and chooses as few as possible that have the letters.
fn search_system(mut letters: BTreeSet<char>) -> Findings {
    let mut system = Database::new();
    system.load_system_fonts();
    let mut faces: Vec<&FaceInfo> =
        system.faces().filter(|face| face.style == Style::Normal).collect();
    faces.sort_by_cached_key(|face| plainness(face));
    let mut fonts = Vec::new();
    while fonts.len() < MAX_FONTS {
        let has = |face: &FaceInfo| {
            system.with_face_data(face.id, |data, index| covered(data, index, &letters))
        };
        let all = faces.iter().filter_map(|face| has(face).map(|letters| (*face, letters)));
        // Of equal ones the first, which is the plainest.
        let best = all.reduce(|a, b| if b.1.len() > a.1.len() { b } else { a });
        let Some((face, found)) = best.filter(|(_, found)| !found.is_empty()) else { break };
        letters.retain(|letter| !found.contains(letter));
        fonts.extend(system.with_face_data(face.id, |data, index| insert(face, data, index)));
    }
    Findings { fonts, lacking: letters }
}

/// Sort key of a face: regular and proportional ones without serifs come first.
fn plainness(face: &FaceInfo) -> (u16, bool, bool, String) {
    let name = face.families.first().map_or(&*face.post_script_name, |(name, _)| name);
    let weight = face.weight.0.abs_diff(Weight::NORMAL.0);
    (weight, face.monospaced, name.contains("Serif"), face.post_script_name.clone())
}

/// Returns the letters that the face has outlines of; none if the file is too large or damaged.
fn covered(data: &[u8], index: u32, letters: &BTreeSet<char>) -> BTreeSet<char> {
    let font = FontRef::from_index(data, index).ok().filter(|_| data.len() <= MAX_BYTES);
    let Some(font) = font else { return BTreeSet::new() };
    let (charmap, outlines) = (font.charmap(), font.outline_glyphs());
    let has = |letter: &char| {
        let glyph = charmap.map(*letter).filter(|glyph| glyph.to_u32() > 0);
        glyph.is_some_and(|glyph| outlines.get(glyph).is_some())
    };
    letters.iter().copied().filter(has).collect()
}

fn insert(face: &FaceInfo, data: &[u8], index: u32) -> FontInsert {
    FontInsert {
        // The number, because two files may hold fonts of one name.
        name: format!("{} ({:?})", face.post_script_name, face.id),
        data: FontData::from_blob(Arc::new(data.to_vec()), index),
        families: [FontFamily::Proportional, FontFamily::Monospace].map(fallback).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_icon_has_an_outline_and_the_font_is_small() {
        use icon::{
            COMPARE, EXPORT, FOLLOW, MORE, NEXT, OPEN, PAUSE, PREVIOUS, RENDER, SHOW, TRAIN,
        };
        let icons =
            [COMPARE, EXPORT, FOLLOW, MORE, NEXT, OPEN, PAUSE, PREVIOUS, RENDER, SHOW, TRAIN];
        let icons: BTreeSet<char> = icons.iter().flat_map(|icon| icon.chars()).collect();
        assert_eq!((covered(ICONS, 0, &icons), icons.len()), (icons.clone(), 11));
        assert!(ICONS.len() < 4096, "{} bytes", ICONS.len());
    }

    #[test]
    fn letters_that_no_font_has_are_named_once() {
        // The last code point of a private plane.
        let nobodys = BTreeSet::from(['\u{10FFFD}']);
        let Findings { fonts, lacking } = search_system(nobodys.clone());
        assert!(fonts.is_empty() && lacking == nobodys);
        let text = lack_text(&('\u{e000}'..='\u{e004}').collect());
        assert!(text.contains("U+E000, U+E001, U+E002 and 2 more, which"), "{text}");
        assert!(lack_text(&nobodys).contains("letters U+10FFFD, which"));
    }
}
