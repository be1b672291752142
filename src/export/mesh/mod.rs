//! Triangle mesh from the plane segments of a scene's components (`export.md`, Mesh), weighted by their
//! points.
//!
//! ```
//! use glam::{DMat3, DVec3};
//! use vbgs_studio::export::mesh::{Surfel, triangulate};
//! use vbgs_studio::math::sym3::Sym3;
//!
//! // A patch of a plane, seen from above.
//! let surfel = |x: i32, y: i32| Surfel {
//!     mean: DVec3::new(0.1 * f64::from(x), 0.1 * f64::from(y), 0.53),
//!     normal: DVec3::Z,
//!     covariance: Sym3::from_mat3(DMat3::from_diagonal(DVec3::new(0.004, 0.004, 1e-6))),
//!     color: DVec3::new(1.0, 0.5, 0.0),
//!     evidence: 50.0,
//! };
//! let surfels: Vec<Surfel> = (0..10).flat_map(|x| (0..10).map(move |y| surfel(x, y))).collect();
//! let mesh = triangulate(&surfels, 0.05)?;
//! assert!(mesh.positions.iter().all(|p| (p.z - 0.53).abs() < 1e-6));
//! assert!(mesh.triangles.len() > 500);
//! # Ok::<(), vbgs_studio::export::Fault>(())
//! ```

mod field;
mod format;
pub(super) mod nets;
mod text;
mod write;

pub use field::Surfel;
pub use format::MeshFormat;
pub use nets::{TriangleMesh, triangulate};
pub use write::{MeshSummary, write_mesh};
