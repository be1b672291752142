//! Names of model files, the one list that dialogs, help and messages are made of.

/// Endings of the files that [`super::read()`] takes; it goes by content, dialogs go by these.
pub const READ_ENDINGS: [&str; 5] = ["ply", "glb", "gltf", "spz", "splat"];
/// Endings of the files that [`super::write()`] makes, the first the usual one.
pub const WRITTEN_ENDINGS: [&str; 3] = ["ply", "glb", "spz"];

/// Endings as a sentence lists them: `.ply, .glb or .spz`.
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
