//! The demo without a display: trained headless, files written.

use super::failure::Failure;
use super::interrupt::Interrupt;
use super::{output, train};
use std::path::Path;
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::pipeline::demo;
use vbgs_studio::pipeline::provenance::file_comments;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

/// Folder the demo's files go to.
const FOLDER: &str = "vbgs-demo";

/// Trains the built-in demo and writes its model, report and a picture; `reason` says why there is
/// no window.
pub fn run(reason: &str) -> Result<(), Failure> {
    output::line(format!("{reason}: training the demo headless into {FOLDER}/"));
    let interrupt = Interrupt::listen()?;
    let mut session = demo::session(SceneOverrides::default())?;
    // Ctrl-C ends the training, not the command: files of what was learnt are written all the same.
    let finished = train::train(&mut session, &interrupt, |_, _| ())?;
    let out = Path::new(FOLDER);
    output::create_folder(out)?;
    let splats = session.splats();
    let comments = file_comments(&session.config().method, session.learner().frames());
    for format in [ModelFormat::Ply, ModelFormat::Glb] {
        let options = WriteOptions {
            comments: &comments,
            up: session.up(),
            // The room is made in metres; what is not known to be is written without a unit.
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
    output::write_png(&out.join("preview.png"), &preview.color)?;
    output::write_json(&out.join("report.json"), &session.report(None, Vec::new()))?;
    output::line(format!("wrote scene.ply, scene.glb, report.json and preview.png to {FOLDER}/"));
    if finished { Ok(()) } else { Err(Failure::Interrupted) }
}
