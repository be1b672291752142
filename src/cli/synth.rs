//! `synth`: the procedural room as a dataset on disk.

use super::args::{DepthBitsName, LayoutName, SynthArgs};
use super::failure::Failure;
use super::{output, progress};
use clap::ValueEnum;
use clap::builder::PossibleValue;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};

/// Writes as asked.
pub fn run(args: &SynthArgs) -> Result<(), Failure> {
    let params = SyntheticParams {
        width: args.size[0],
        height: args.size[1],
        n_train: args.frames,
        n_eval: args.eval_frames,
        seed: args.seed,
        depth_noise: args.depth_noise,
    };
    let layout = layout(args)?;
    // Nothing is checked yet: `write` refuses absurd numbers, whose sum must not overflow first.
    let n_frames = args.frames.saturating_add(args.eval_frames);
    let bar = progress::bar(n_frames, "frame");
    write(&params, &args.out, layout, &mut |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    output::line(format!("wrote {n_frames} frames to {}", args.out.display()));
    Ok(())
}

fn layout(args: &SynthArgs) -> Result<SyntheticLayout, Failure> {
    if let (LayoutName::Blender, bits) = (args.layout, args.depth_bits) {
        return Ok(SyntheticLayout::Blender(match bits {
            Some(DepthBitsName::Eight) => DepthBits::Eight,
            Some(DepthBitsName::Sixteen) | None => DepthBits::Sixteen,
        }));
    }
    if let Some(DepthBitsName::Eight) = args.depth_bits {
        let name = args.layout.to_possible_value();
        return Err(Failure::Usage(format!(
            "--depth-bits: expected 16 beside --layout {}, which has no other, found 8",
            name.as_ref().map_or("", PossibleValue::get_name)
        )));
    }
    Ok(match args.layout {
        LayoutName::Blender => SyntheticLayout::Blender(DepthBits::Sixteen),
        LayoutName::SevenScenes => SyntheticLayout::SevenScenes,
        LayoutName::Tum => SyntheticLayout::Tum,
        LayoutName::Open3d => SyntheticLayout::Open3d,
        LayoutName::Replica => SyntheticLayout::Replica,
        LayoutName::Scannet => SyntheticLayout::Scannet,
        LayoutName::Nerfstudio => SyntheticLayout::Nerfstudio,
        LayoutName::Record3d => SyntheticLayout::Record3d,
        LayoutName::Record3dArchive => SyntheticLayout::Record3dArchive,
        LayoutName::StrayScanner => SyntheticLayout::StrayScanner,
        LayoutName::Arkit => SyntheticLayout::Arkit,
        LayoutName::RtabMap => SyntheticLayout::RtabMap,
    })
}
