//! What the user takes out of view and out of files, and how that is taken back.
//!
//! The model is never changed: edits are kept beside it, as sets of splats ([`marks`]), a box and a
//! selection ([`edits`]), with a history of both ([`history`]). [`visible`] makes of them what painters
//! get, [`left_out`] says what files do not get; [`past`] keeps what the scene was before.
//!
//! Edits follow a scene that is trained on by the numbers of its splats. What is born later is in no set;
//! the box takes new splats out too. Where the budget has components merged, the number of one that is no
//! more goes to a new one elsewhere: a splat that is no longer where it was marked is not marked any more.

pub mod editor;
pub mod edits;
pub mod history;
pub mod left_out;
pub mod marks;
pub mod past;
pub mod screen_box;
pub mod threshold;
pub mod visible;
