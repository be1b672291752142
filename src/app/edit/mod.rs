//! Non-destructive edits of the displayed and exported scene, with undo.
//!
//! The model itself never changes. Edits are stored beside it as marks of splats and a crop box
//! ([`marks`]). [`visible`] derives the displayed splats; [`past`] stores earlier states of the scene.
//!
//! While training continues, marks refer to splats by slot. Splats created later have no mark; the crop box
//! applies to them too. If the budget merges components, a freed slot is reused for a new splat elsewhere.
//! A splat that is no longer where it was marked is therefore treated as unmarked.

pub mod editor;
pub mod marks;
pub mod past;
pub mod visible;
