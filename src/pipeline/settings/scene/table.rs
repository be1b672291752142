//! Table of the scene preset's settings.

use crate::dataset::calibration::Calibration;
use crate::dataset::surface::{PixelSampling, Sensor};
use crate::model::scene::splat_rule::SplatKind;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::{MAX_TEXTURE_MB, RAY_SEARCH};
use crate::train::scene::photometric::rule::{MAX_WAITING, PhotometricMode};
use crate::train::scene::units::{Budget, StructuralScale};
use crate::train::setting::table::settings;
use crate::train::setting::value::{SettingValue, ValueError, named_values};
use crate::train::setting::{MAX_COMPONENTS, Preset};
use std::ffi::OsStr;
use std::path::Path;

settings! {
    /// User settings of a scene, from a RON file, the command line or the window; `None` keeps the preset's
    /// value.
    pub struct SceneOverrides of SceneRun, Preset::Scene,
        such as "(scale: \"2.5px\", refine: false)";

    /// Seed of every random stream.
    seed: u64 {
        default "0";
        at |run| run.seed;
    }
    /// Maximum distance of a point from its component's seed, in world units or pixels (2.5px). Pixels are
    /// measured at the 95 % quantile of distance.
    scale: StructuralScale {
        option "--scale" "H";
        label "Structural scale";
        default by "2px to 2.5px, by the size of depth images";
        range "a positive length", |scale| scale.is_positive();
        at |run| run.scale;
    }
    /// Maximum number of components, or megabytes such as 20MB; the least useful components are merged.
    budget: Budget {
        option "--budget" "N";
        label "Budget";
        default "2000000";
        range "1 to {MAX_COMPONENTS} components",
            |budget| (1..=MAX_COMPONENTS).contains(&budget.components());
        get |run| Some(run.budget.unwrap_or(Budget::Components(run.engine.max_components)));
        set |run, budget| {
            run.budget = Some(budget);
            run.engine.max_components = budget.components();
        };
    }
    /// Photometric training: one Gauss-Newton step per frame on its photograph. Needs 496 extra bytes per
    /// component, which are not counted towards a budget in MB.
    photometric: PhotometricMode {
        option "--photometric" "MODE";
        label "Photometric";
        default "light";
        get |run| Some(PhotometricMode::of(run.engine.photometric));
        set |run, mode| run.engine.photometric = mode.rule();
    }
    /// Shuffle buffer, in photographs (0 = off, at most 64 MB). Photographs are trained on in random order,
    /// which decorrelates neighbouring views.
    shuffle_buffer: usize {
        label "Shuffle buffer";
        default by "60; none without photometric training";
        range "0 to {MAX_WAITING} photographs", |n| *n <= MAX_WAITING;
        get |run| run.engine.photometric.map(|rule| rule.shuffle_buffer);
        set |run, n| {
            // Without photometric training, `check_photometric` refuses the value.
            if let Some(rule) = &mut run.engine.photometric {
                rule.shuffle_buffer = n;
            }
        };
    }
    /// Memory for textures, in MB (0 = off). Textures show the detail of photographs that splats are too coarse
    /// for. Where the memory is too little, all texels become coarser.
    textures: usize {
        label "Textures (MB)";
        default by "200; none without photometric training and with plain splats";
        range "0 to {MAX_TEXTURE_MB} MB", |mb| *mb <= MAX_TEXTURE_MB as usize;
        get |run| Some(run.engine.texture_mb as usize);
        set |run, mb| run.engine.texture_mb = mb as u32;
    }
    /// Kind of splats: native renders best in this program; plain is exported without loss to any viewer.
    splats: SplatKind {
        label "Splats";
        default "native";
        get |run| Some(SplatKind::of(&run.engine.splat_rule));
        set |run, kind| {
            // The default rule is native.
            if kind == SplatKind::Plain {
                run.engine.splat_rule = run.engine.splat_rule.plain();
            }
        };
    }
    /// Depth sensor; determines the noise model and thresholds.
    sensor: Sensor {
        default by "the dataset's files";
        at |run| run.surface.sensor;
    }
    /// Camera calibration, a RON file.
    calibration: Calibration {
        option "--calibration" "FILE.ron";
        default by "what is known of the layout";
        get |run| run.surface.calibration.clone();
        set |run, calibration| run.surface.calibration = Some(calibration);
    }
    /// Pixels that become points: every one, or every other pixel of every other row.
    /// Weights compensate for omitted pixels.
    sampling: PixelSampling {
        label "Sampling";
        default by "every; quarter for real cameras of 150,000 pixels or more";
        at |run| run.surface.sampling;
    }
    /// Use the depth of a plane fitted around each pixel instead of the measured depth.
    plane_fit: bool {
        label "Fit planes";
        default "true";
        at |run| run.surface.plane_fit;
    }
    /// Drop pixels between two surfaces, to which no plane can be fitted.
    flying_pixels: bool {
        label "Drop flying pixels";
        default by "on; off for computed depth";
        at |run| run.surface.flying_pixels;
    }
    /// Drop surfaces seen at grazing angles.
    cosine: bool {
        label "Drop slanted surfaces";
        default "true";
        at |run| run.surface.cosine;
    }
    /// Move points along their rays towards their component's plane.
    refine: bool {
        default "true";
        at |run| run.engine.refine;
    }
    /// Correct each frame's pose to fit the scene.
    align: bool {
        default by "on for real cameras";
        at |run| run.engine.align;
    }
    /// Fit each frame's exposure to the scene.
    gain: bool {
        default by "on for real cameras";
        at |run| run.engine.gain;
    }
    /// Search along the ray, within the sensor noise, for a component if none is near the point. Avoids
    /// duplicate layers of a surface.
    ray_search: bool {
        label "Ray search";
        default by "on for real cameras";
        get |run| Some(run.engine.ray_search > 0.0);
        set |run, on| run.engine.ray_search = if on { RAY_SEARCH } else { 0.0 };
    }
    /// Fill cracks between splats in rendering: above a threshold, a pixel's coverage counts as full.
    crack_filling: bool {
        default by "on; off with plain splats";
        get |run| Some(run.engine.splat_rule.full_coverage < 1.0);
        set |run, fills| {
            if !fills {
                run.engine.splat_rule.full_coverage = 1.0;
            }
        };
    }
    /// Colour gradient across each splat.
    gradient: bool {
        default by "on; off with plain splats";
        at |run| run.engine.splat_rule.gradient;
    }
    /// Colour that depends on the view direction.
    directional: bool {
        default "true";
        at |run| run.engine.splat_rule.directional;
    }
}

named_values!(by text StructuralScale, Budget);
named_values!(by name PixelSampling {
    "every" "Every" "Every pixel becomes a point";
    "quarter" "Quarter" "Every other pixel of every other row";
});
named_values!(by name SplatKind {
    "native" "Native" "Flat tops, colour gradients and filled cracks: sharpest in this program";
    "plain" "Plain" "As every viewer draws them: export is lossless";
});

named_values!(by name Sensor {
    "inverse8-ray" "inverse8-ray" "8-bit depth along the ray, as in NeRF-synthetic scenes";
    "kinect" "kinect" "Structured light";
    "lidar" "lidar" "Time-of-flight sensor of phones and tablets";
    "exact" "exact" "Computed depth without noise";
});

impl SettingValue for Calibration {
    const IS_FILE: bool = true;

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        Self::read(Path::new(text)).map_err(|error| ValueError::File(error.into()))
    }
}
