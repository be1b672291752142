//! Fuzzy matching of names.

/// Score of a name against a search text; `None` unless the name contains its letters in order. Letters that
/// begin a word or follow each other score higher. Spaces and case are ignored.
pub fn score(name: &str, typed: &str) -> Option<u32> {
    let letters = typed.chars().filter(|c| !c.is_whitespace());
    let mut wanted = letters.flat_map(char::to_lowercase).peekable();
    let (mut score, mut run, mut before) = (0, 0, ' ');
    for letter in name.chars().flat_map(char::to_lowercase) {
        if wanted.next_if_eq(&letter).is_some() {
            run += 1;
            score += run + if before.is_alphanumeric() { 0 } else { 3 };
        } else {
            run = 0;
        }
        before = letter;
    }
    wanted.peek().is_none().then_some(score)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_in_order_are_found_and_beginnings_of_words_come_first() {
        assert_eq!(score("Frame scene", "xf"), None);
        assert_eq!(score("Frame scene", "scenes"), None);
        assert_eq!(score("Frame scene", ""), Some(0));
        assert!(score("Frame scene", "FS") > score("Quality of us", "fs"));
        assert!(score("Export", "exp") > score("Next photograph", "exp"));
        assert!(score("Wipe photograph", "wipe photo").is_some());
    }
}
