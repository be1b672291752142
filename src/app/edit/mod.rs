//! Non-destructive edits of the displayed and exported scene, with undo.
//!
//! The model itself never changes. Edits are stored beside it as sets of splats ([`marks`]), a crop box and
//! a selection with a history ([`history`]). [`visible`] derives the displayed splats,
//! [`marks`] those excluded from exports; [`past`] stores earlier states of the scene.
//!
//! While training continues, edits refer to splats by slot. Splats created later belong to no set; the crop
//! box applies to them too. If the budget merges components, a freed slot is reused for a new splat
//! elsewhere. A splat that is no longer where it was marked therefore does not count as marked.

pub mod editor;
pub mod history;
pub mod marks;
pub mod past;
pub mod visible;
