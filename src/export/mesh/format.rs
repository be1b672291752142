//! Formats of meshes.

use crate::export::error::{ExportError, Fault};
use crate::export::local_origin::OriginCarrier;
use std::path::Path;

/// A file format for meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary PLY with `red green blue`.
    Ply,
    /// glTF 2.0 with linear `COLOR_0`, y up.
    Glb,
    /// Text, colours behind the coordinates as MeshLab and Blender read them.
    Obj,
}

impl MeshFormat {
    /// Every format.
    pub const ALL: [MeshFormat; 3] = [MeshFormat::Ply, MeshFormat::Glb, MeshFormat::Obj];

    /// The usual file name extension, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => "ply",
            MeshFormat::Glb => "glb",
            MeshFormat::Obj => "obj",
        }
    }

    /// How it says what its positions are relative to.
    pub fn origin_carrier(self) -> OriginCarrier {
        match self {
            MeshFormat::Glb => OriginCarrier::Transform,
            MeshFormat::Ply | MeshFormat::Obj => OriginCarrier::Comment,
        }
    }

    /// The format a file name asks for; case does not matter.
    ///
    /// # Errors
    /// [`Fault::UnknownMeshExtension`] for a name of none.
    pub fn from_path(path: &Path) -> Result<Self, ExportError> {
        let found = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let known = Self::ALL.into_iter().find(|format| format.extension() == found);
        known.ok_or_else(|| Fault::UnknownMeshExtension { found }.at(path))
    }
}
