//! Node tree of a glTF scene, flattened into placed meshes.

use super::schema::{Node, Root};
use crate::export::error::Fault;
use crate::math::sym3::Sym3;
use crate::model::splat::splats::{CovarianceForm, decompose};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec4Swizzles};

/// Largest cosine between two columns that still counts as a right angle.
const SHEAR_TOLERANCE: f64 = 1e-4;

/// Affine transform from a mesh to the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    linear: DMat3,
    translation: DVec3,
}

/// Returns every mesh of the scene, once per node that uses it.
pub(super) fn placed_meshes(root: &Root) -> Result<Vec<(Placement, usize)>, Fault> {
    let mut meshes = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, DMat4)> =
        start_nodes(root)?.into_iter().rev().map(|node| (node, DMat4::IDENTITY)).collect();
    // A stack instead of recursion: a file may nest nodes arbitrarily deep.
    while let Some((index, scene_from_parent)) = stack.pop() {
        let place = || format!("node {index}");
        let (Some(node), Some(is_seen)) = (root.nodes.get(index), seen.get_mut(index)) else {
            let found = format!("{} nodes", root.nodes.len());
            return Err(Fault::malformed(place(), "a node of that number", found));
        };
        // A node reached twice means a cycle or a shared child; the traversal might not end.
        if std::mem::replace(is_seen, true) {
            return Err(Fault::malformed(place(), "a tree of nodes", "a node with two parents"));
        }
        let scene_from_node = scene_from_parent * local_matrix(node);
        if let Some(mesh) = node.mesh {
            meshes.push((Placement::checked(scene_from_node, &place())?, mesh));
        }
        // Reversed, since a stack is last in, first out: meshes keep the order of the file.
        stack.extend(node.children.iter().rev().map(|&child| (child, scene_from_node)));
    }
    Ok(meshes)
}

/// Returns the roots of the default scene, or of the whole file if it has no scenes.
fn start_nodes(root: &Root) -> Result<Vec<usize>, Fault> {
    let index = root.scene.unwrap_or(0);
    match root.scenes.get(index) {
        Some(scene) => Ok(scene.nodes.clone()),
        None if root.scenes.is_empty() => {
            let mut is_child = vec![false; root.nodes.len()];
            for child in root.nodes.iter().flat_map(|node| &node.children) {
                if let Some(flag) = is_child.get_mut(*child) {
                    *flag = true;
                }
            }
            let roots = is_child.iter().enumerate().filter(|(_, is_child)| !**is_child);
            Ok(roots.map(|(node, _)| node).collect())
        }
        None => {
            let found = format!("{} scenes", root.scenes.len());
            Err(Fault::malformed(format!("scene {index}"), "a scene of that number", found))
        }
    }
}

fn local_matrix(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    // Normalised, because a quaternion rounded to few digits would scale the splats.
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    DMat4::from_scale_rotation_translation(
        DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
        rotation / rotation.length(),
        DVec3::from_array(node.translation.unwrap_or_default()),
    )
}

impl Placement {
    fn checked(matrix: DMat4, place: &str) -> Result<Self, Fault> {
        let linear = DMat3::from_mat4(matrix);
        let fault = |found: &str| {
            let expected = "a rotation with positive scales and a translation";
            Err(Fault::Unsupported {
                feature: format!("{place}: expected {expected}, found {found}"),
                advice: "apply the node's transform before exporting",
            })
        };
        // Any other last row than (0, 0, 0, 1) is a perspective, which splats cannot represent.
        if !matrix.is_finite() || matrix.row(3).xyz() != DVec3::ZERO {
            return fault("a matrix that is not finite or not affine");
        }
        let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
        // A mirrored matrix is no rotation, and a singular one cannot be inverted.
        if linear.determinant() <= 0.0 {
            return fault("a negative or zero scale, which mirrors or flattens splats");
        }
        let sheared = |a: DVec3, b: DVec3| {
            a.normalize().dot(b.normalize()).abs().partial_cmp(&SHEAR_TOLERANCE)
                != Some(std::cmp::Ordering::Less)
        };
        if sheared(x, y) || sheared(y, z) || sheared(x, z) {
            return fault("shear, which splats cannot represent");
        }
        Ok(Self { linear, translation: matrix.w_axis.xyz() })
    }

    /// Subtracts an origin from the translation.
    pub fn relative_to(self, origin: DVec3) -> Self {
        Self { translation: self.translation - origin, ..self }
    }

    pub fn position(&self, p: DVec3) -> DVec3 {
        self.linear * p + self.translation
    }

    /// Transforms a change of colour per unit direction to the scene.
    pub fn directional(&self, w: DMat3) -> DMat3 {
        // The columns are orthogonal: normalised, they are the rotation.
        let m = self.linear;
        let rotation =
            DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
        w * rotation.transpose()
    }

    /// Returns scales and rotation of `M Σ Mᵀ`, where `Σ` has the given scales and rotation.
    pub fn shape(&self, scale: DVec3, rotation: DQuat) -> (DVec3, DQuat) {
        if self.linear == DMat3::IDENTITY {
            return (scale, rotation); // avoids rounding
        }
        let factor = self.linear * DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
        let covariance = Sym3::from_mat3(factor * factor.transpose());
        decompose(covariance, CovarianceForm::Eigen)
    }
}
