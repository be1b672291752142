//! Every WGSL file is valid, and its structs have the memory layout of their Rust counterparts.

use std::collections::BTreeMap;
use std::mem::offset_of;
use std::path::Path;
use vbgs_studio::model::splat::appearance::GRADIENT_LIMIT;
use vbgs_studio::render::compare::OUTSIDE_BRIGHTNESS;
use vbgs_studio::render::finish::RAMP;
use vbgs_studio::render::gpu::constants::{PAINT_NORMAL, with_constants};
use vbgs_studio::render::gpu::layout::{
    Composite, GpuAppearance, GpuSplat, GpuView, SparseAppearance, SparseSplat, shader,
};
use vbgs_studio::render::gpu::mixture::layout as mixture;
use vbgs_studio::render::gpu::photometric::layout as photometric;
use vbgs_studio::render::gpu::points::layout as points;
use vbgs_studio::render::gpu::tiles::buffers as tiles;
use vbgs_studio::render::{
    ALPHA_CAP, ALPHA_CUT, Antialias, FOOTPRINT_PX2, LOW_PASS_PX2, Lens, MAX_SCALE_FLOOR_RATIO,
    POINT_SCALE, REFERENCE_VARIANCE, SCALE_FLOOR, TILE, TRANSMITTANCE_STOP,
};
use wgpu::naga::back::PipelineConstants;
use wgpu::naga::back::pipeline_constants::process_overrides;
use wgpu::naga::{
    Expression, Handle, Literal, Module, TypeInner, back::spv, front::wgsl, proc::Layouter, valid,
};

/// Parses and validates a shader after the constants it shares with Rust.
fn validated(name: &str, shader: &str) -> Module {
    let source = &with_constants(shader);
    let module =
        wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
    // No optional capability, so the shader runs on every backend.
    let info = valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
    // Sets all pipeline constants to 1, which enables every code path.
    let names = module.overrides.iter().filter_map(|(_, constant)| constant.name.clone());
    let values: PipelineConstants = names.map(|name| (name, 1.0)).collect();
    let (module, info) = process_overrides(&module, &info, None, &values).unwrap();
    // The SPIR-V backend, which every Vulkan device uses, refuses some valid modules.
    spv::write_vec(&module, &info, &spv::Options::default(), None)
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    module.into_owned()
}

/// Files that others include, in order; each is valid after those before it.
const SHARED: [&str; 2] = ["common.wgsl", "record.wgsl"];

fn read(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders").join(name))
        .unwrap()
}

#[test]
fn every_file_is_valid_and_used() {
    let mut record = String::new();
    for name in SHARED {
        record += &read(name);
        validated(name, &record);
    }
    let used = [shader::COMPOSITE, shader::MESHES, shader::SCATTER];
    let mut n_files = 0;
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders")).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        if SHARED.contains(&name.as_str()) || entry.file_type().unwrap().is_dir() {
            continue;
        }
        let text = read(&name);
        let whole = used.iter().find(|whole| whole.ends_with(&text));
        let whole = whole.unwrap_or_else(|| panic!("{name} is in no pipeline"));
        let prefix = whole.strip_suffix(&text).unwrap();
        let bases = ["", &read("common.wgsl")];
        assert!(bases.contains(&prefix), "{name}: unknown base files");
        assert!(!validated(&name, whole).entry_points.is_empty(), "{name} has no entry point");
        n_files += 1;
    }
    assert_eq!(n_files, used.len());
}

/// The constants in front of every shader have the same bits as in Rust.
#[test]
fn shared_constants_keep_their_bits() {
    let module = validated("constants", "");
    let found: BTreeMap<&str, Vec<u32>> = module
        .constants
        .iter()
        .map(|(_, constant)| (constant.name.as_deref().unwrap(), words(&module, constant.init)))
        .collect();
    let bits = |value: f64| vec![(value as f32).to_bits()];
    for (name, expected) in [
        ("ALPHA_CAP", bits(ALPHA_CAP)),
        ("ALPHA_CUT", bits(ALPHA_CUT)),
        ("TRANSMITTANCE_STOP", bits(TRANSMITTANCE_STOP)),
        ("LOW_PASS", bits(LOW_PASS_PX2)),
        ("FOOTPRINT", bits(FOOTPRINT_PX2)),
        ("REFERENCE_VARIANCE", bits(REFERENCE_VARIANCE)),
        ("SCALE_FLOOR", bits(SCALE_FLOOR)),
        ("FLATTEST", bits(MAX_SCALE_FLOOR_RATIO)),
        ("POINT_SCALE", bits(POINT_SCALE)),
        ("GRADIENT_LIMIT", bits(GRADIENT_LIMIT)),
        ("OUTSIDE", vec![OUTSIDE_BRIGHTNESS.to_bits()]),
        ("RAMP", RAMP.as_flattened().iter().map(|v| v.to_bits()).collect()),
        ("TILE", vec![TILE as u32]),
        ("ANTIALIAS_REFERENCE", vec![Antialias::Reference as u32]),
        ("LENS_FISHEYE", vec![Lens::Fisheye as u32]),
        ("PAINT_NORMAL", vec![PAINT_NORMAL]),
    ] {
        assert_eq!(found[name], expected, "{name}");
    }
}

/// Bits of the numbers in a constant.
fn words(module: &Module, expression: Handle<Expression>) -> Vec<u32> {
    match &module.global_expressions[expression] {
        Expression::Literal(Literal::U32(value)) => vec![*value],
        Expression::Literal(Literal::F32(value)) => vec![value.to_bits()],
        Expression::Compose { components, .. } => {
            components.iter().flat_map(|&part| words(module, part)).collect()
        }
        other => panic!("{other:?} is no number"),
    }
}

/// Size and field offsets of every struct in the shared file, by naga's rules.
fn wgsl_layouts() -> BTreeMap<String, (usize, Vec<(String, usize)>)> {
    let module = validated("common.wgsl", &read("common.wgsl"));
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).unwrap();
    let mut layouts = BTreeMap::new();
    for (handle, kind) in module.types.iter() {
        if let TypeInner::Struct { members, .. } = &kind.inner {
            let fields =
                members.iter().map(|m| (m.name.clone().unwrap(), m.offset as usize)).collect();
            let size = layouter[handle].to_stride() as usize;
            layouts.insert(kind.name.clone().unwrap(), (size, fields));
        }
    }
    layouts
}

macro_rules! rust_layout {
    ($name:literal, $type:ty, $($field:ident),*) => {
        ($name, (size_of::<$type>(), vec![$((stringify!($field), offset_of!($type, $field))),*]))
    };
}

#[test]
fn shared_structs_agree_with_rust() {
    let ours = [
        rust_layout!("Splat", GpuSplat, mean, opacity, color, flags, rotation, scale),
        rust_layout!("SparseSplat", SparseSplat, splat, index),
        rust_layout!(
            "View",
            GpuView,
            right,
            near,
            down,
            paint,
            forward,
            scale,
            centre,
            opacity_cut,
            centre_rest,
            renderer,
            focal,
            principal,
            viewport,
            tangent_min,
            tangent_max,
            depth_range,
            antialias,
            lens,
            is_antialiased
        ),
        rust_layout!("Appearance", GpuAppearance, gradient, directional, observed, cone),
        rust_layout!("SparseAppearance", SparseAppearance, appearance, index),
        rust_layout!(
            "Composite",
            Composite,
            background,
            mode,
            area_min,
            area_max,
            amount,
            second_full_coverage,
            exposure,
            full_coverage,
            second_exposure
        ),
    ];
    let theirs = wgsl_layouts();
    assert_eq!(theirs.len(), ours.len(), "structs in common.wgsl: {:?}", theirs.keys());
    for (name, (size, fields)) in ours {
        let fields: Vec<_> = fields.into_iter().map(|(f, at)| (f.to_owned(), at)).collect();
        assert_eq!(theirs[name], (size, fields), "{name}");
    }
    assert_eq!(size_of::<GpuSplat>(), 64, "`rendering.md`, Splat record");
    assert_eq!(size_of::<GpuAppearance>(), 108, "`rendering.md`, Splat record");
    assert!(size_of::<GpuView>() <= 256, "`rendering.md`, Splat record");
}

/// Files of the tile path that others include.
const SHARED_BY_TILES: [&str; 3] = ["stages.wgsl", "footprint.wgsl", "packed.wgsl"];

#[test]
fn every_file_of_the_tile_path_is_valid_and_used() {
    let used = [tiles::SORT, tiles::PREPROCESS, tiles::BIN, tiles::RASTER];
    let modules = used.map(|whole| validated("tiles", whole));
    assert!(modules.iter().all(|module| !module.entry_points.is_empty()));
    let record = SHARED.map(read).concat();
    assert!(tiles::PREPROCESS.starts_with(&record) && tiles::RASTER.starts_with(&record));
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/tiles");
    let mut n_files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let text = read(&format!("tiles/{name}"));
        let n_uses = used.iter().filter(|whole| whole.contains(&text)).count();
        assert!(n_uses == 1 || (n_uses > 1 && SHARED_BY_TILES.contains(&name.as_str())), "{name}");
        n_files += 1;
    }
    assert_eq!(n_files, used.len() + SHARED_BY_TILES.len());

    // Sizes that `tiles/buffers.rs` and `tiles/sort.rs` allocate.
    for (module, name, size) in [
        (&modules[0], "Digit", 32),
        (&modules[1], "Packed", 64),
        (&modules[1], "PackedGradient", 48),
        (&modules[1], "Footprint", 16),
    ] {
        assert_eq!(stride(module, name), size, "{name}");
    }
}

/// Array stride of a struct, in bytes.
fn stride(module: &Module, name: &str) -> u32 {
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).unwrap();
    let of_name = |kind: &wgpu::naga::Type| kind.name.as_deref() == Some(name);
    let (handle, _) = module.types.iter().find(|(_, kind)| of_name(kind)).unwrap();
    layouter[handle].to_stride()
}

#[test]
fn every_file_of_the_comparison_is_valid_and_used() {
    let used = [photometric::DRAW, photometric::WALK, photometric::ADD];
    let modules = used.map(|whole| validated("photometric", whole));
    assert!(modules.iter().all(|module| module.entry_points.len() == 1));
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/photometric");
    let mut n_files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let text = read(&format!("photometric/{name}"));
        assert!(used.iter().any(|whole| whole.contains(&text)), "{name}");
        n_files += 1;
    }
    assert_eq!(n_files, 5);
    // Sizes in `photometric/layout.rs`.
    for (name, size) in [("Frame", 40), ("Splat", 80), ("Measured", 24), ("Pixel", 64)] {
        assert_eq!(stride(&modules[0], name), size, "{name}");
    }
    assert_eq!(stride(&modules[1], "Place"), 12);
}

#[test]
fn the_files_of_a_pass_are_valid() {
    let module = validated("mixture", mixture::PASS);
    assert_eq!(module.entry_points.len(), 1);
    let cells = read("mixture/cells.wgsl");
    assert_eq!(mixture::PASS, cells.clone() + &read("mixture/pass.wgsl"));
    let index = validated("index", mixture::INDEX);
    assert_eq!(index.entry_points.len(), 5);
    assert_eq!(mixture::INDEX, cells + &read("mixture/index.wgsl"));
    // Sizes in `mixture/layout.rs`.
    assert_eq!(stride(&module, "Frame"), 96);
    for (name, size) in [("Index", 48), ("Mean", 32)] {
        assert_eq!(stride(&index, name), size, "{name}");
    }
}

#[test]
fn the_files_of_points_are_valid() {
    let used = [
        (points::FILE, &["settings", "cells", "file"][..]),
        (points::FIND, &["settings", "cells", "find"]),
        (points::SUM, &["settings", "sum"]),
    ];
    for (whole, parts) in used {
        let parts = parts.iter().map(|part| read(&format!("points/{part}.wgsl")));
        assert_eq!(whole, parts.collect::<String>());
        let module = validated("points", whole);
        assert_eq!(module.entry_points.len(), 1);
        // Sizes in `points/layout.rs`, and of points in frames.
        assert_eq!([stride(&module, "Settings"), stride(&module, "Point")], [64, 64]);
    }
    assert_eq!(stride(&validated("points", points::FIND), "Seed"), 16);
}
