//! Headless demo for machines without a display.

use super::failure::Failure;
use super::interrupt::Interrupt;
use super::{output, train};
use std::path::Path;
use vbgs_studio::export::video::write_png;
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::pipeline::any_preset::file_comments;
use vbgs_studio::pipeline::session::demo_session;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

const FOLDER: &str = "vbgs-demo";

/// Trains the built-in demo and writes its model, report and a preview image. `reason` states why there
/// is no window.
pub fn run(reason: &str) -> Result<(), Failure> {
    out!("{reason}: training the demo headless into {FOLDER}/");
    let interrupt = Interrupt::listen()?;
    let mut session = demo_session(SceneOverrides::default())?;
    // Ctrl-C ends training but not the command: the files are written in any case.
    let finished = train::train(&mut session, &interrupt, |_, _| ())?;
    let out = Path::new(FOLDER);
    output::create_folder(out)?;
    let splats = session.splats();
    let comments = file_comments(&session.config().method, session.learner().status().frames);
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let options = WriteOptions {
            comments: &comments,
            up: session.up(),
            // The room's unit is the metre; files of unknown scale are written without a unit.
            metric: true,
            ..WriteOptions::new(format)
        };
        write(&out.join("scene").with_extension(format.extension()), &splats, &options)?;
    }
    let camera = session.dataset().splits[session.plan().split].frames[0].camera;
    let preview = CpuRenderer::new().render(
        &splats,
        &camera,
        &RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]),
    );
    write_png(&out.join("preview.png"), &preview.color)?;
    output::write_json(&out.join("report.json"), &session.report(None, Vec::new()))?;
    out!("wrote scene.ply, scene.glb, report.json and preview.png to {FOLDER}/");
    if finished { Ok(()) } else { Err(Failure::Interrupted) }
}
