//! File formats of meshes.

use crate::export::error::{ExportError, Fault};
use crate::export::local_origin::OriginCarrier;
use std::path::Path;

/// File format of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary PLY with `red green blue`.
    Ply,
    /// glTF 2.0 with linear `COLOR_0`, y-up.
    Glb,
    /// Text; colours follow the coordinates, as MeshLab and Blender read them.
    Obj,
}

impl MeshFormat {
    /// All formats.
    pub const ALL: [MeshFormat; 3] = [MeshFormat::Ply, MeshFormat::Glb, MeshFormat::Obj];

    /// File extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => "ply",
            MeshFormat::Glb => "glb",
            MeshFormat::Obj => "obj",
        }
    }

    /// How files of this format store the local origin.
    pub fn origin_carrier(self) -> OriginCarrier {
        match self {
            MeshFormat::Glb => OriginCarrier::Transform,
            MeshFormat::Ply | MeshFormat::Obj => OriginCarrier::Comment,
        }
    }

    /// Derives the format from a file extension, case-insensitive.
    ///
    /// # Errors
    /// [`Fault::UnknownMeshExtension`] for any other extension.
    pub fn from_path(path: &Path) -> Result<Self, ExportError> {
        let found = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let known = Self::ALL.into_iter().find(|format| format.extension() == found);
        known.ok_or_else(|| Fault::UnknownMeshExtension { found }.with_path(path))
    }
}
