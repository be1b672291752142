//! What breaks a rule today. Every list must shrink: an entry that no longer breaks its rule fails
//! the test until it is taken out, and nothing may be added.

use std::collections::BTreeSet;

/// Files that depend on each other, the members of a circle in the order of their names.
pub const CIRCLES: &[&[&str]] = &[
    &["app/kept.rs", "app/training.rs", "app/viewer/settings.rs"],
    &[
        "app/studio.rs",
        "app/viewer/mod.rs",
        "app/viewer/painter.rs",
        "app/viewer/toolbar.rs",
        "app/window.rs",
    ],
    &[
        "cli/args/calibrate.rs",
        "cli/args/eval.rs",
        "cli/args/mod.rs",
        "cli/args/train.rs",
        "cli/bench/args.rs",
        "cli/bench/mod.rs",
        "cli/precision_search.rs",
        "cli/quality.rs",
        "cli/settings.rs",
        "cli/train.rs",
    ],
    &[
        "dataset/blender.rs",
        "dataset/candidate.rs",
        "dataset/formats.rs",
        "dataset/mod.rs",
        "dataset/range.rs",
        "dataset/seven_scenes.rs",
        "dataset/synthetic/mod.rs",
    ],
    &[
        "dataset/surface/emit.rs",
        "dataset/surface/fit.rs",
        "dataset/surface/mod.rs",
        "dataset/surface/occluders.rs",
        "dataset/surface/painter.rs",
        "dataset/surface/planes.rs",
    ],
    &[
        "dataset/synthetic/write.rs",
        "dataset/synthetic/write_blender.rs",
        "dataset/synthetic/write_seven_scenes.rs",
    ],
    &["eval/metrics.rs", "eval/ssim.rs"],
    &["eval/report.rs", "eval/views.rs"],
    &["export/checkpoint/container.rs", "export/checkpoint/error.rs"],
    &[
        "export/glb/read.rs",
        "export/glb/write.rs",
        "export/mod.rs",
        "export/ply/points.rs",
        "export/ply/read.rs",
        "export/ply/write.rs",
    ],
    &["math/simd/avx2.rs", "math/simd/mod.rs", "math/simd/portable.rs"],
    &["pipeline/bench/accuracy/forms.rs", "pipeline/bench/accuracy/mod.rs"],
    &["pipeline/bench/render/forms.rs", "pipeline/bench/render/mod.rs"],
    &[
        "pipeline/bench/scaling/forms.rs",
        "pipeline/bench/scaling/mod.rs",
        "pipeline/bench/scaling/room.rs",
    ],
    &[
        "pipeline/calibrate/camera_search.rs",
        "pipeline/calibrate/depth_search.rs",
        "pipeline/calibrate/exposure_search.rs",
        "pipeline/calibrate/mod.rs",
    ],
    &["pipeline/checkpoint/merge/mod.rs", "pipeline/checkpoint/merge/start.rs"],
    &["pipeline/precision_search/forms.rs", "pipeline/precision_search/mod.rs"],
    &["pipeline/scene/mod.rs", "pipeline/scene/sample.rs"],
    &["render/cpu/exact.rs", "render/cpu/prepare.rs", "render/cpu/projected.rs"],
    &["render/finish.rs", "render/options.rs"],
    &["render/gpu/allocation.rs", "render/gpu/scene.rs"],
    &[
        "render/gpu/chooser.rs",
        "render/gpu/renderer.rs",
        "render/gpu/tiles/buffers.rs",
        "render/gpu/tiles/capacity.rs",
        "render/gpu/tiles/mod.rs",
        "render/gpu/tiles/plan.rs",
        "render/gpu/tiles/sort.rs",
        "render/gpu/timer.rs",
    ],
    &["train/candidates/lists.rs", "train/candidates/search.rs"],
    &[
        "train/scene/accumulate.rs",
        "train/scene/births.rs",
        "train/scene/config.rs",
        "train/scene/engine.rs",
        "train/scene/trainer.rs",
    ],
];

/// Public type names that more than one place defines.
pub const DUPLICATE_TYPES: &[&str] = &[
    "Alignment",
    "Asked",
    "Combination",
    "Command",
    "Comparison",
    "Device",
    "Exact",
    "FrameMs",
    "GpuPainter",
    "Look",
    "Means",
    "Method",
    "Order",
    "PaintError",
    "Painter",
    "Path",
    "Search",
    "Second",
    "Selection",
    "Split",
    "Stage",
    "Summary",
    "Surroundings",
    "Variant",
    "View",
];

/// Functions that are too long, by file and name.
pub const LONG_FUNCTIONS: &[&str] = &["cli/train.rs run", "render/gpu/tiles/plan.rs new"];

/// Files that are too long.
pub const LONG_FILES: &[&str] = &["app/studio.rs", "app/worker/mod.rs", "model/totals.rs"];

/// What is wrong where a list is not exactly what was found; `why` explains a new entry.
pub fn compare(
    found: &BTreeSet<String>,
    known: &[&str],
    why: impl Fn(&str) -> Vec<String>,
) -> String {
    let mut complaint = String::new();
    for new in found.iter().filter(|entry| !known.contains(&entry.as_str())) {
        complaint += &format!("  new: {new:?}\n");
        why(new).iter().for_each(|line| complaint += &format!("    {line}\n"));
    }
    for gone in known.iter().filter(|entry| !found.contains(**entry)) {
        complaint += &format!("  mended, take it out of tests/house/known.rs: {gone:?}\n");
    }
    complaint
}

#[test]
fn lists_must_be_exact() {
    let found = ["a".to_owned(), "b".to_owned()].into();
    let why = |entry: &str| vec![format!("because of {entry}")];
    assert_eq!(compare(&found, &["a", "b"], why), "");
    assert_eq!(compare(&found, &["a"], why), "  new: \"b\"\n    because of b\n");
    assert!(compare(&found, &["a", "b", "c"], why).contains("mended"));
}

#[test]
fn lists_are_in_order_and_without_repeats() {
    for list in [DUPLICATE_TYPES, LONG_FUNCTIONS, LONG_FILES].iter().chain(CIRCLES) {
        assert!(list.is_sorted_by(|a, b| a < b), "{list:?}");
    }
    assert!(CIRCLES.is_sorted_by(|a, b| a < b), "{CIRCLES:?}");
}
