//! `synth`: the procedural room as a dataset on disk.

use super::args::{DepthBitsName, LayoutName, SynthArgs};
use super::failure::Failure;
use super::{output, progress};
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
    let layout = match (args.layout, args.depth_bits) {
        (LayoutName::Blender, Some(DepthBitsName::Eight)) => {
            SyntheticLayout::Blender(DepthBits::Eight)
        }
        (LayoutName::Blender, Some(DepthBitsName::Sixteen) | None) => {
            SyntheticLayout::Blender(DepthBits::Sixteen)
        }
        (LayoutName::SevenScenes, Some(DepthBitsName::Eight)) => {
            return Err(Failure::Usage(
                "--depth-bits: expected 16 beside --layout seven-scenes, which has no other, found 8"
                    .to_owned(),
            ));
        }
        (LayoutName::SevenScenes, Some(DepthBitsName::Sixteen) | None) => {
            SyntheticLayout::SevenScenes
        }
    };
    // Nothing is checked yet: `write` refuses absurd numbers, whose sum must not overflow first.
    let n_frames = args.frames.saturating_add(args.eval_frames);
    let bar = progress::bar(n_frames, "frame");
    write(&params, &args.out, layout, &mut |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    output::line(format!("wrote {n_frames} frames to {}", args.out.display()));
    Ok(())
}
