//! Configurations of the tables: parts of the scene preset added one by one or left out one at a
//! time, and structural scales.
//!
//! Each part is represented by a change that disables it. A row whose change has no effect on a dataset
//! is left out. The changes use the constants of the ablation in the docs (`scene.md`, Effect of each
//! part), so that rows are comparable.

use crate::dataset::Dataset;
use crate::dataset::calibration::Calibration;
use crate::dataset::surface::Sensor;
use crate::dataset::surface::sensor::Thresholds;
use crate::model::scene::splat_rule::DensityOpacity;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::scene::{SceneError, SceneOverrides, SceneRun};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::units::StructuralScale;
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Table {
    /// Parts added one by one: each row adds a part to the row above.
    Cumulative,
    /// Parts left out: each row changes one setting of the preset.
    LeaveOneOut,
    /// Quality over number of components: each row has another structural scale.
    Scale,
    /// Quality over number of components: each row merges the preset's components down to a budget.
    Budget,
}

#[derive(Clone, Debug)]
pub struct SceneVariant {
    pub table: Table,
    pub name: String,
    pub run: SceneRun,
}

type PresetChange = (&'static str, fn(&mut SceneRun));

/// Parts of the preset with the changes that disable them, in table order (`scene.md`, Effect of each
/// part).
const PARTS: [PresetChange; 14] = [
    ("plane fit and its filter", |run| {
        run.surface.plane_fit = false;
        run.surface.flying_pixels = false;
    }),
    ("cosine filter", |run| run.surface.cosine = false),
    ("calibration", uncalibrated),
    ("density opacity and flat tops", constant_opacity),
    ("tight inliers", loose_inliers),
    ("gain per frame", |run| run.engine.gain = false),
    ("pose correction", |run| run.engine.align = false),
    ("depth refinement", |run| run.engine.refine = false),
    ("colour by direction", |run| run.engine.splat_rule.directional = false),
    ("colour gradient", |run| run.engine.splat_rule.gradient = false),
    // At 1 only fully covered pixels count as full, so nothing is filled.
    ("closing", |run| run.engine.splat_rule.full_coverage = 1.0),
    ("photographs", without_photographs),
    ("textures", |run| run.engine.texture_mb = 0),
    ("poses of photographs", |run| {
        run.engine.photographs_at_points = run.engine.align && run.engine.photometric.is_some();
    }),
];

/// Further changes of the preset, other than leaving out one part.
const CHANGES: [PresetChange; 8] = [
    ("one colour per component", |run| {
        run.engine.splat_rule.gradient = false;
        run.engine.splat_rule.directional = false;
    }),
    ("opacity from the number of points only", opacity_of_count),
    ("plain splats", |run| {
        run.engine.splat_rule = run.engine.splat_rule.plain();
        run.engine.texture_mb = 0;
    }),
    ("no prior of the covariance", |run| run.engine.splat_rule.prior_points = 0.0),
    ("loose inliers, no calibration", |run| {
        loose_inliers(run);
        uncalibrated(run);
    }),
    ("photographs in full", |run| run.engine.photometric = PhotometricMode::Full.rule()),
    ("photographs without coverage", |run| {
        // Without photographs there is no rule to change.
        run.engine.photometric.iter_mut().for_each(|rule| rule.coverage = 0.0);
    }),
    ("textures of twice the pitch", |run| {
        run.engine.texture_steps = u32::from(run.engine.texture_mb > 0);
    }),
];

/// Configurations of the views bench with their changes of the preset.
pub const VIEW_VARIANTS: [PresetChange; 4] = [
    ("points alone", without_photographs),
    ("no textures", |run| run.engine.texture_mb = 0),
    ("default", |_| {}),
    ("full", |run| run.engine.photometric = PhotometricMode::Full.rule()),
];

/// Returns the configurations of the views bench.
pub fn view_variants(base: &SceneRun) -> [(&'static str, SceneRun); VIEW_VARIANTS.len()] {
    VIEW_VARIANTS.map(|(name, change)| {
        let mut run = base.clone();
        change(&mut run);
        (name, run)
    })
}

fn without_photographs(run: &mut SceneRun) {
    run.engine.photometric = None;
    // Unused, but rows with equal settings share their training.
    run.engine.texture_mb = 0;
}

/// Offset that the sensor's profile adds to decoded 8-bit ray depth (`dataset.md`, Sensors), world
/// units.
const INVERSE8_OFFSET: f64 = 0.004;

/// Disables the colour camera and the correction of depth bias.
fn uncalibrated(run: &mut SceneRun) {
    let depth_offset = match run.surface.sensor {
        Sensor::Inverse8Ray => -INVERSE8_OFFSET,
        _ => 0.0,
    };
    // The sensor's profile adds the bias regardless of calibration, so an offset reverts it.
    let none = Calibration { depth_offset, ..Calibration::NONE };
    if run.surface.calibration.is_some() || depth_offset != 0.0 {
        run.surface.calibration = Some(none);
    }
}

/// Applies the opacity rule of the bench's first row (`pipeline.md`, Accuracy bench). Components with at
/// least 30 points are drawn as plain Gaussians of opacity 0.95.
fn constant_opacity(run: &mut SceneRun) {
    let native = &mut run.engine.splat_rule;
    // Such a small density saturates at once: opacity is τ wherever there are points.
    native.opacity = DensityOpacity { tau: 0.95, rho0: 1e-12, doubt: 1.0, least: 0.0 };
    native.least_points = 30.0;
    native.scale = 1.7;
}

/// Sets the opacity to `τ·(1 − exp(−N/300))` for `N` points, independent of visibility counts.
fn opacity_of_count(run: &mut SceneRun) {
    // So large that the visibility counts have no effect.
    const DOUBT: f64 = 1e12;
    let opacity = &mut run.engine.splat_rule.opacity;
    *opacity = DensityOpacity { doubt: DOUBT, rho0: 300.0 / DOUBT, ..*opacity };
}

/// Sets loose inlier thresholds (`dataset.md`, Plane fit) for 8-bit ray depth, whose default thresholds
/// are tighter.
fn loose_inliers(run: &mut SceneRun) {
    if run.surface.sensor == Sensor::Inverse8Ray {
        run.surface.thresholds =
            Some(Thresholds { inlier: 1.0, residual: 0.6, deviation: 1.0, cosine: 0.4 });
    }
}

/// Returns the rows of the first two tables for a preset. Changes without effect on the dataset are
/// left out.
pub fn parts(base: &SceneRun) -> Vec<SceneVariant> {
    let with = |changes: &[PresetChange]| {
        let mut run = base.clone();
        changes.iter().for_each(|(_, change)| change(&mut run));
        run
    };
    let mut rows = vec![SceneVariant {
        table: Table::Cumulative,
        name: "measured depth, constant opacity".to_owned(),
        run: with(&PARTS),
    }];
    for (i, (name, _)) in PARTS.iter().enumerate() {
        let run = with(&PARTS[i + 1..]);
        // A part without effect on this dataset would repeat the row above.
        if rows.last().is_none_or(|row| row.run != run) {
            rows.push(SceneVariant { table: Table::Cumulative, name: format!("+ {name}"), run });
        }
    }
    let all = SceneVariant { table: Table::LeaveOneOut, name: "all".to_owned(), run: base.clone() };
    rows.push(all);
    let without = PARTS.iter().map(|&(name, change)| (format!("no {name}"), change));
    let changed = CHANGES.iter().map(|&(name, change)| (name.to_owned(), change));
    for (name, change) in without.chain(changed) {
        let mut run = base.clone();
        change(&mut run);
        if run != *base {
            rows.push(SceneVariant { table: Table::LeaveOneOut, name, run });
        }
    }
    rows
}

/// Budgets as fractions of the number of components created without a budget.
const BUDGETS: [f64; 4] = [0.9, 0.7, 0.5, 0.3];

/// Returns one row per component budget; components are merged until they fit the budget. `born` is the
/// number of components created without a budget.
pub fn budgets(base: &SceneRun, born: usize) -> Vec<SceneVariant> {
    let of_share = |share: f64| {
        let mut run = base.clone();
        // A budget of zero is not a valid setting.
        run.engine.max_components = ((born as f64 * share) as usize).max(1);
        let name = format!("budget {}", run.engine.max_components);
        SceneVariant { table: Table::Budget, name, run }
    };
    BUDGETS.map(of_share).to_vec()
}

/// Returns rows with the structural scale of `base` times each factor, with and without photographs.
/// Scales below the depth noise are left out.
pub fn scales(
    dataset: &Dataset,
    plan: &Plan,
    base: &SceneRun,
    factors: &[f64],
) -> Result<Vec<SceneVariant>, SceneError> {
    let mut rows = Vec::new();
    for photometric in [None, Some(PhotometricMode::Off)] {
        for factor in factors {
            let scale = Some(StructuralScale::World(base.engine.h * factor));
            let overrides = SceneOverrides { scale, photometric, ..Default::default() };
            match SceneRun::new(dataset, plan, &overrides) {
                Ok(run) => {
                    let of_points = photometric.map_or("", |_| "points alone, ");
                    let name = format!("{of_points}h = {:.3}", run.engine.h);
                    rows.push(SceneVariant { table: Table::Scale, name, run });
                }
                Err(SceneError::BelowNoise { .. }) => {}
                Err(error) => return Err(error),
            }
        }
    }
    Ok(rows)
}
