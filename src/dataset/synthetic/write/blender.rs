//! Writes the synthetic scene in the NeRF-synthetic (Blender) layout.

use super::files::{WriteError, create_folder, write_file, write_png};
use crate::dataset::depth::INVERSE8_RANGE;
use crate::dataset::synthetic::plan::{PlannedSplit, ViewPlan};
use crate::dataset::synthetic::scene::{DEPTH_UNIT, SyntheticScene, quantise};
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::pose::Pose;
use image::ExtendedColorType;
use serde_json::json;
use std::path::Path;
use strum::{EnumString, VariantNames};

/// Depth encoding of the Blender layout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, EnumString, VariantNames)]
pub enum DepthBits {
    #[strum(serialize = "8")]
    /// 8-bit depth `8·(1 − d/255)` m in RGBA images, as in the original dataset. A step is 31 mm.
    Eight,
    #[default]
    #[strum(serialize = "16")]
    /// 16-bit grey images with `integer_depth_scale`; a step is 0.25 mm.
    Sixteen,
}

pub(super) fn write(
    plan: &ViewPlan,
    is_wanted: fn(&PlannedSplit) -> bool,
    out: &Path,
    bits: DepthBits,
    on_frame: &mut dyn FnMut(),
) -> Result<(), WriteError> {
    let k = plan.scene.intrinsics();
    for split in plan.splits.iter().filter(|split| is_wanted(split)) {
        create_folder(&out.join(split.name))?;
        for i in 0..split.poses.len() {
            let SyntheticView { color, depth_z } = plan.render_view(split, i);
            let stem = out.join(split.name).join(format!("r_{i}"));
            write_png(&stem.with_extension("png"), &color, ExtendedColorType::Rgba8)?;
            // NeRF-synthetic naming; readers accept any number.
            let depth_file = stem.with_file_name(format!("r_{i}_depth_0001.png"));
            let along_ray = ray_lengths(&depth_z, &k);
            match bits {
                DepthBits::Eight => {
                    write_png(&depth_file, &inverse8(&along_ray), ExtendedColorType::Rgba8)?;
                }
                DepthBits::Sixteen => {
                    let codes = quantise(&along_ray, DEPTH_UNIT);
                    write_png(&depth_file, &codes, ExtendedColorType::L16)?;
                }
            }
            on_frame();
        }
        // Written last: after an interruption no list names missing images.
        let list = out.join(format!("transforms_{}.json", split.name));
        write_file(&list, frame_list(&plan.scene, split, bits))?;
    }
    Ok(())
}

fn ray_lengths(depth_z: &Image<f64>, k: &Intrinsics) -> Image<f64> {
    let mut lengths = depth_z.clone();
    for (i, length) in lengths.data.iter_mut().enumerate() {
        *length *= k.ray(i % depth_z.width, i / depth_z.width).length();
    }
    lengths
}

fn inverse8(lengths: &Image<f64>) -> Image<[u8; 4]> {
    lengths.map(|length| {
        let code = (255.0 * (1.0 - length / INVERSE8_RANGE)).round();
        // 0 and 255 are decoded as holes.
        let d = if (1.0..255.0).contains(&code) { code as u8 } else { 0 };
        [d, d, d, 255]
    })
}

fn frame_list(scene: &SyntheticScene, split: &PlannedSplit, bits: DepthBits) -> String {
    let (lo, hi) = scene.room().bounds();
    let entry = |(i, pose): (usize, &Pose)| {
        let rows = pose.to_opengl().transpose().to_cols_array_2d();
        // Without the extension, as in the published lists.
        json!({ "file_path": format!("./{}/r_{i}", split.name), "transform_matrix": rows })
    };
    let frames: Vec<_> = split.poses.iter().enumerate().map(entry).collect();
    let mut list = json!({
        "camera_angle_x": scene.field_of_view(),
        // The room exceeds the cube that the layout implies without a range.
        "position_range": [lo.to_array(), hi.to_array()],
        "frames": frames,
    });
    if bits == DepthBits::Sixteen {
        list["integer_depth_scale"] = json!(DEPTH_UNIT);
    }
    format!("{list:#}\n")
}
