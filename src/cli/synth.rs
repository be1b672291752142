//! `synth`: writes the procedural room as a dataset.

use super::args::SynthArgs;
use super::failure::Failure;
use super::output;
use std::thread::sleep;
use std::time::{Duration, Instant};
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout, write, write_live};
use vbgs_studio::dataset::synthetic::{SyntheticCamera, SyntheticParams};

pub fn run(args: &SynthArgs) -> Result<(), Failure> {
    let camera = camera(args)?;
    let size = match camera {
        SyntheticCamera::Room => [320, 240],
        SyntheticCamera::Phone(_) => [1440, 1920],
    };
    let [width, height] = args.size.unwrap_or(size);
    let params = SyntheticParams {
        width,
        height,
        n_train: args.frames,
        n_eval: args.eval_frames,
        n_free: args.free_frames,
        seed: args.seed,
        depth_noise: args.depth_noise,
        camera,
    };
    let layout = layout(args)?;
    // Unchecked numbers, whose sum must not overflow; `write` rejects them later.
    let n_frames = args.frames.saturating_add(args.eval_frames).saturating_add(args.free_frames);
    let bar = output::bar(n_frames, "frame");
    if let Some(fps) = args.live {
        bar.set_message("rendering all frames first,");
        let mut start = None;
        write_live(&params, &args.out, layout, &mut |frame, _| {
            bar.set_message("");
            bar.set_position(frame as u64);
            // The clock starts with the first written frame, after all are rendered.
            let start = *start.get_or_insert_with(Instant::now);
            // Relative to the start rather than the previous frame, so that delays do not accumulate.
            let due = start + Duration::from_secs_f64((frame + 1) as f64 / fps);
            sleep(due.saturating_duration_since(Instant::now()));
        })?;
        bar.finish_and_clear();
        out!("recorded {n_frames} frames in {}", args.out.display());
        return Ok(());
    }
    write(&params, &args.out, layout, &mut |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    out!("wrote {n_frames} frames to {}", args.out.display());
    Ok(())
}

fn camera(args: &SynthArgs) -> Result<SyntheticCamera, Failure> {
    match (args.camera, args.scene) {
        (SyntheticCamera::Phone(_), Some(scene)) => Ok(SyntheticCamera::Phone(scene)),
        (SyntheticCamera::Room, Some(_)) => {
            Err(usage!("--scene: expected --camera phone with it, found --camera room"))
        }
        (camera, None) => Ok(camera),
    }
}

fn layout(args: &SynthArgs) -> Result<SyntheticLayout, Failure> {
    let bits = args.depth_bits.unwrap_or_default();
    let layout = args.layout.unwrap_or(match args.camera {
        SyntheticCamera::Room => SyntheticLayout::Blender(bits),
        SyntheticCamera::Phone(_) => SyntheticLayout::Record3d,
    });
    match (layout, bits) {
        (SyntheticLayout::Blender(_), bits) => Ok(SyntheticLayout::Blender(bits)),
        (layout, DepthBits::Sixteen) => Ok(layout),
        // Only the Blender layout can store 8-bit depth.
        (layout, DepthBits::Eight) => Err(usage!(
            "--depth-bits: expected 16, the only choice for --layout {}, found 8",
            <&str>::from(layout)
        )),
    }
}
