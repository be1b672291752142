//! Table of the scene preset's settings.

use crate::dataset::calibration::Calibration;
use crate::dataset::surface::{PixelSampling, Sensor};
use crate::model::scene::splat_rule::SplatKind;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::{BirthRule, RAY_SEARCH, SumForm, VisibilityRule};
use crate::train::scene::photometric::rule::{MAX_WAITING, PhotometricMode};
use crate::train::scene::spacing::NearSpacing;
use crate::train::scene::units::{Budget, StructuralScale};
use crate::train::setting::table::settings;
use crate::train::setting::value::{Choice, SettingValue, ValueError, named_values};
use crate::train::setting::{MAX_COMPONENTS, Preset};
use std::ffi::OsStr;
use std::path::Path;

settings! {
    /// User settings of a scene, from a RON file, the command line or the window; `None` keeps the preset's
    /// value.
    pub struct SceneOverrides of SceneRun, Preset::Scene,
        such as "(scale: \"2.5px\", births: seeds)";

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
        default "2.5px";
        range "a positive length", |scale| scale.is_positive();
        at |run| run.scale;
    }
    /// Rule that creates components.
    births: BirthRule {
        label "Births";
        default "seeds";
        at |run| run.engine.births;
    }
    /// Maximum number of components, or megabytes such as 20MB; the least useful are merged. With a lattice
    /// it limits drawn and exported ones; up to eight times as many are stored.
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
    /// Photometric training: one Gauss-Newton step per frame on its photograph. Needs 496 bytes per
    /// component, which a budget in MB does not count.
    photometric: PhotometricMode {
        option "--photometric" "MODE";
        label "Photometric";
        default by "light; off with lattices";
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
            if let Some(rule) = &mut run.engine.photometric {
                rule.shuffle_buffer = n;
            }
        };
    }
    /// Kind of splats: native renders best in this program; plain is exported without loss to any viewer.
    splats: SplatKind {
        label "Splats";
        default "native";
        get |run| Some(SplatKind::of(&run.engine.splat_rule));
        set |run, kind| {
            if kind == SplatKind::Plain {
                run.engine.splat_rule = run.engine.splat_rule.plain();
            }
        };
    }
    /// Visibility count of a component: by projection into every frame, or by the frames that gave it points.
    visibility: VisibilityRule {
        default by "projected; returned with lattices";
        at |run| run.engine.visibility;
    }
    /// Arithmetic of the sufficient statistics.
    sums: SumForm {
        default "mixed";
        at |run| run.engine.sums;
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
    /// Pixels that become points: every one, every other row, or every other pixel of every other row.
    /// Weights make up for those left out.
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
    /// Drop pixels between two surfaces, which no plane fits.
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
        default by "on; off with lattices";
        at |run| run.engine.refine;
    }
    /// Correct each frame's pose to fit the scene.
    align: bool {
        default by "on for real cameras; off with lattices";
        at |run| run.engine.align;
    }
    /// Fit each frame's exposure to the scene.
    gain: bool {
        default by "on for real cameras; off with lattices";
        at |run| run.engine.gain;
    }
    /// Use smaller components where cameras come close: ten pixels wide, but at least two thirds of the
    /// structural scale.
    near_detail: bool {
        label "Near detail";
        default by "on for real cameras; off with lattices";
        get |run| Some(run.engine.near.is_some());
        set |run, on| run.engine.near = on.then_some(NearSpacing::ROOM);
    }
    /// Search along the ray, within the sensor noise, for a component if none is near the point. Avoids
    /// duplicate layers of a surface.
    ray_search: bool {
        label "Ray search";
        default by "on for real cameras; off with lattices";
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
named_values!(by name VisibilityRule, SumForm);
named_values!(by name PixelSampling {
    "every" "Every" "Every pixel becomes a point";
    "quarter" "Quarter" "Every other pixel of every other row";
});

impl SettingValue for BirthRule {
    fn choices() -> Vec<Choice> {
        const LATTICE: &str = "Cells of a lattice; the result does not depend on the order of \
                               frames";
        let at_seeds = "Where a point has no seed within the structural scale";
        vec![
            Choice { name: "seeds", label: "Seeds", help: at_seeds },
            Choice { name: "lattice", label: "Cubic", help: LATTICE },
            Choice { name: "body-centred", label: "Body-centred", help: LATTICE },
        ]
    }

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        text.to_string_lossy().parse().map_err(|_| {
            let text = text.display();
            ValueError::Text(format!("expected seeds, lattice or body-centred, found `{text}`"))
        })
    }
}

impl SettingValue for SplatKind {
    fn choices() -> Vec<Choice> {
        let native = "Flat tops, colour gradients and filled cracks: sharpest in this program";
        let plain = "As every viewer draws them: export is lossless";
        vec![
            Choice { name: "native", label: "Native", help: native },
            Choice { name: "plain", label: "Plain", help: plain },
        ]
    }

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        text.to_string_lossy().parse().map_err(|_| {
            ValueError::Text(format!("expected native or plain, found `{}`", text.display()))
        })
    }
}

impl SettingValue for Sensor {
    fn choices() -> Vec<Choice> {
        let choice = |name, help| Choice { name, label: name, help };
        vec![
            choice("inverse8-ray", "8-bit depth along the ray, as in NeRF-synthetic scenes"),
            choice("kinect", "Structured light"),
            choice("lidar", "Time-of-flight sensor of phones and tablets"),
            choice("exact", "Computed depth without noise"),
        ]
    }

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        match text.to_str() {
            Some("inverse8-ray") => Ok(Self::Inverse8Ray),
            Some("kinect") => Ok(Self::Kinect),
            Some("lidar") => Ok(Self::Lidar),
            Some("exact") => Ok(Self::Exact { noise: 0.0 }),
            _ => Err(ValueError::Text("expected inverse8-ray, kinect, lidar or exact".to_owned())),
        }
    }
}

impl SettingValue for Calibration {
    const IS_FILE: bool = true;

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        Self::read(Path::new(text)).map_err(|error| ValueError::File(error.into()))
    }
}
