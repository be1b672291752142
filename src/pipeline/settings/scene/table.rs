//! The table of the scene preset's settings.

use super::run::SceneRun;
use crate::dataset::calibration::Calibration;
use crate::dataset::surface::{PixelSampling, Sensor};
use crate::model::scene::splat_rule::SplatKind;
use crate::train::scene::config::{BirthRule, RAY_SEARCH, VisibilityRule};
use crate::train::scene::photometric::rule::{MAX_WAITING, PhotometricMode};
use crate::train::scene::spacing::NearSpacing;
use crate::train::scene::sum_form::SumForm;
use crate::train::scene::units::{Budget, StructuralScale};
use crate::train::setting::table::settings;
use crate::train::setting::value::{Choice, SettingValue, ValueError, named_values};
use crate::train::setting::{MAX_COMPONENTS, Preset};
use std::ffi::OsStr;
use std::path::Path;

settings! {
    /// Settings of a scene that a user may change, in a RON file, on the command line or in the
    /// window; `None` keeps the preset's.
    pub struct SceneOverrides of SceneRun, Preset::Scene,
        such as "(scale: \"2.5px\", births: seeds)";

    /// Seed of every random stream.
    seed: u64 {
        option "--seed" "N";
        default "0";
        at |run| run.seed;
    }
    /// Largest distance of a point from the seed of its component: pixels such as 2.5px, at the
    /// distance that 19 of 20 points are nearer than, or world units.
    scale: StructuralScale {
        option "--scale" "H";
        label "Structural scale";
        default "2.5px";
        range "a positive length", |scale| scale.is_positive();
        at |run| run.scale;
    }
    /// Where components are born.
    births: BirthRule {
        option "--births" "RULE";
        label "Births";
        default "seeds";
        at |run| run.engine.births;
    }
    /// Most components of a scene, or megabytes of them such as 20MB; the least useful are merged. Of a
    /// lattice, most that are drawn and exported: it keeps up to eight times as many.
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
    /// Whether splats also learn from the photographs, one step a frame; takes 496 bytes a component
    /// beyond those that a budget in megabytes counts.
    photometric: PhotometricMode {
        option "--photometric" "MODE";
        label "Photometric";
        default by "light; off with lattices";
        get |run| Some(PhotometricMode::of(run.engine.photometric));
        set |run, mode| run.engine.photometric = mode.rule();
    }
    /// Photographs that wait before splats learn from them, at most: for every one that comes, one of
    /// them is drawn at random, so that no view is learnt many times in a row; 0 learns each at once.
    /// No more wait than 64 MB hold.
    shuffle_buffer: usize {
        option "--shuffle-buffer" "N";
        label "Shuffle buffer";
        default by "60; none where photographs are not learnt";
        range "0 to {MAX_WAITING} photographs", |n| *n <= MAX_WAITING;
        get |run| run.engine.photometric.map(|rule| rule.shuffle_buffer);
        set |run, n| {
            if let Some(rule) = &mut run.engine.photometric {
                rule.shuffle_buffer = n;
            }
        };
    }
    /// What splats are: native ones are drawn best by this program; plain ones are what every viewer draws,
    /// and files hold them as they were learnt.
    splats: SplatKind {
        option "--splats" "KIND";
        label "Splats";
        default "native";
        get |run| Some(SplatKind::of(&run.engine.splat_rule));
        set |run, kind| {
            if kind == SplatKind::Plain {
                run.engine.splat_rule = run.engine.splat_rule.plain();
            }
        };
    }
    /// How it is counted how often a component could have been seen: by projecting it into every
    /// frame, or by the frames that brought it points.
    visibility: VisibilityRule {
        option "--visibility" "RULE";
        was "looks";
        default by "projected; returned with lattices";
        at |run| run.engine.visibility;
    }
    /// Arithmetic of the sums.
    sums: SumForm {
        option "--precision" "PRECISION";
        default "mixed";
        at |run| run.engine.sums;
    }
    /// What the depth is from: its noise and thresholds.
    sensor: Sensor {
        option "--sensor" "SENSOR";
        default by "the dataset's files";
        at |run| run.surface.sensor;
    }
    /// Corrections of the cameras, a RON file.
    calibration: Calibration {
        option "--calibration" "FILE.ron";
        default by "what is known of the layout";
        get |run| run.surface.calibration.clone();
        set |run, calibration| run.surface.calibration = Some(calibration);
    }
    /// Which pixels become points: every one, every other row, or every other pixel of every other row;
    /// each point stands for those left out beside it.
    sampling: PixelSampling {
        option "--sampling" "PIXELS";
        label "Sampling";
        default by "every; quarter for real cameras of 150,000 pixels or more";
        at |run| run.surface.sampling;
    }
    /// Depth of the plane fitted around each pixel, instead of the depth as measured.
    plane_fit: bool {
        part "plane-fit";
        label "Fit planes";
        default "true";
        at |run| run.surface.plane_fit;
    }
    /// Dropping pixels that no plane explains.
    flying_pixels: bool {
        part "flying-pixels";
        label "Drop flying pixels";
        default by "on; off for computed depth";
        at |run| run.surface.flying_pixels;
    }
    /// Dropping surfaces seen nearly from their edge.
    cosine: bool {
        part "cosine";
        label "Drop slanted surfaces";
        default "true";
        at |run| run.surface.cosine;
    }
    /// Moving points along their rays towards their component's plane.
    refine: bool {
        part "refine";
        default by "on; off with lattices";
        at |run| run.engine.refine;
    }
    /// Correcting each frame's pose to fit the scene.
    align: bool {
        part "align";
        default by "on for real cameras; off with lattices";
        at |run| run.engine.align;
    }
    /// Fitting each frame's exposure to the scene's.
    gain: bool {
        part "gain";
        default by "on for real cameras; off with lattices";
        at |run| run.engine.gain;
    }
    /// Smaller components where views come near: as wide as ten pixels there, down to two thirds of the
    /// structural scale.
    near_detail: bool {
        part "near-detail";
        label "Near detail";
        default by "on for real cameras; off with lattices";
        get |run| Some(run.engine.near.is_some());
        set |run, on| run.engine.near = on.then_some(NearSpacing::ROOM);
    }
    /// Looking along its ray, as far as the sensor's noise, for the component of a point that none is near
    /// enough for: noise makes no second layer of a surface.
    ray_search: bool {
        part "ray-search";
        label "Ray search";
        default by "on for real cameras; off with lattices";
        get |run| Some(run.engine.ray_search > 0.0);
        set |run, on| run.engine.ray_search = if on { RAY_SEARCH } else { 0.0 };
    }
    /// Filling cracks between splats when they are drawn: from a coverage below 1 on, a pixel counts
    /// as covered in full.
    crack_filling: bool {
        part "crack-filling";
        was "closing";
        default by "on; off with plain splats";
        get |run| Some(run.engine.splat_rule.full_coverage < 1.0);
        set |run, fills| {
            if !fills {
                run.engine.splat_rule.full_coverage = 1.0;
            }
        };
    }
    /// Colour that varies over a splat.
    gradient: bool {
        part "gradient";
        default by "on; off with plain splats";
        at |run| run.engine.splat_rule.gradient;
    }
    /// Colour that depends on the view direction.
    directional: bool {
        part "directional";
        default "true";
        at |run| run.engine.splat_rule.directional;
    }
}

named_values!(by text StructuralScale, Budget);
named_values!(by name VisibilityRule, SumForm);
named_values!(by name PixelSampling {
    "every" "Every" "Every pixel becomes a point";
    "half" "Half" "Every other row";
    "quarter" "Quarter" "Every other pixel of every other row";
});

impl SettingValue for BirthRule {
    fn choices() -> Vec<Choice> {
        const LATTICE: &str = "Cells of a lattice: the order of frames does not matter";
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
        let native =
            "With flat tops and colour gradients, cracks between them filled: sharpest here";
        let plain = "As every viewer draws them: files hold exactly what was learnt";
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
            choice("inverse8-ray", "8-bit depth along the ray, as NeRF-synthetic scenes have it"),
            choice("kinect", "Structured light"),
            choice("lidar", "Time of flight in phones and tablets"),
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
