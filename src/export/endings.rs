//! File extensions of models, for dialogs, help and messages.

/// Extensions of the files that [`super::read()`] accepts. It detects the format from the content; dialogs
/// filter by these.
pub const READ_ENDINGS: [&str; 5] = ["ply", "glb", "gltf", "spz", "splat"];
/// Extensions of the files that [`super::write()`] writes, the default first.
pub const WRITTEN_ENDINGS: [&str; 3] = ["ply", "glb", "spz"];

/// Formats extensions for a sentence: `.ply, .glb or .spz`.
pub fn listed(endings: &[&str]) -> String {
    match endings {
        [] => String::new(),
        [only] => format!(".{only}"),
        [others @ .., last] => {
            let others: Vec<String> = others.iter().map(|ending| format!(".{ending}")).collect();
            format!("{} or .{last}", others.join(", "))
        }
    }
}
