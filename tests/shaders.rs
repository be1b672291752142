//! Every WGSL file is valid, and its structs lie in memory as Rust's do.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::mem::offset_of;
use std::path::Path;
use vbgs_studio::render::gpu::layout::{Composite, GpuSplat, SparseSplat, View, shader};
use wgpu::naga::{Module, TypeInner, front::wgsl, proc::Layouter, valid};

fn validated(name: &str, source: &str) -> Module {
    let module =
        wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
    // No optional capability: what passes here runs on every backend.
    valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
    module
}

#[test]
fn every_file_is_valid_and_used() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let common = read("common.wgsl");
    validated("common.wgsl", &common);
    let used = [shader::PROJECTED, shader::COMPOSITE, shader::SCATTER];
    let mut n_files = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name == "common.wgsl" {
            continue;
        }
        let source = common.clone() + &read(&name);
        let module = validated(&name, &source);
        assert!(!module.entry_points.is_empty(), "{name} has no entry point");
        assert!(used.contains(&source.as_str()), "{name} is in no pipeline");
        n_files += 1;
    }
    assert_eq!(n_files, used.len());
}

/// Size and field offsets of every struct in the shared file, by naga's rules.
fn wgsl_layouts() -> BTreeMap<String, (usize, Vec<(String, usize)>)> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders").join("common.wgsl");
    let module = validated("common.wgsl", &std::fs::read_to_string(source).unwrap());
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
        rust_layout!("Splat", GpuSplat, mean, opacity, color, flags, rotation, scale, birth),
        rust_layout!("SparseSplat", SparseSplat, splat, index),
        rust_layout!(
            "View",
            View,
            right,
            near,
            down,
            extent_cap,
            forward,
            centre,
            focal,
            principal,
            viewport,
            tangent_min,
            tangent_max
        ),
        rust_layout!("Composite", Composite, background, mode, area_min, area_max, amount),
    ];
    let theirs = wgsl_layouts();
    assert_eq!(theirs.len(), ours.len(), "structs in common.wgsl: {:?}", theirs.keys());
    for (name, (size, fields)) in ours {
        let fields: Vec<_> = fields.into_iter().map(|(f, at)| (f.to_owned(), at)).collect();
        assert_eq!(theirs[name], (size, fields), "{name}");
    }
    assert_eq!(size_of::<GpuSplat>(), 64, "rendering.md (d)");
}
