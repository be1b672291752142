//! Files written by the training thread.

use super::autosave::Files;
use super::outbox::Outbox;
use super::run::Run;
use crate::app::edit::marks::LeftOut;
use crate::app::settings_file::unused;
use crate::app::state::{NoticeKind, WriteOutcome};
use crate::export;
use crate::export::atomic::write_atomic;
use crate::export::local_origin::warning;
use crate::export::mapping::Mapping;
use crate::export::{
    ExportError, Fault, ModelFormat, SpzVersion, WriteOptions, WriteProgress, WriteSummary,
};
use crate::pipeline::any_preset::file_comments;
use crate::pipeline::job::Progress;
use glam::DVec3;
use std::path::Path;

pub struct Export<'a> {
    /// Number that identifies the file when the snapshot reports the outcome.
    pub number: u64,
    pub path: &'a Path,
    pub mapping: Mapping,
    pub spz_version: SpzVersion,
    pub left_out: &'a LeftOut,
}

impl Files {
    pub fn save(&mut self, number: u64, path: &Path, run: &Run, out: &mut Outbox) {
        let Some(session) = run.session() else { return };
        match session.save(path) {
            Ok(bytes) => {
                // Not after an export: training cannot be resumed from one, so these frames
                // are still stored after a crash.
                self.record_save();
                let text = format!(
                    "Saved {} frames ({:.1} MB) to {}",
                    out.snapshot.frames_done,
                    bytes as f64 * 1e-6,
                    path.display()
                );
                end_write(out, number, text);
            }
            Err(error) => out.notify(NoticeKind::Error, error.to_string()),
        }
    }
}

impl Export<'_> {
    /// Writes the file, reports the progress, and finally the outcome.
    pub fn write(&self, run: &Run, out: &mut Outbox, progress: &Progress) {
        progress.begin();
        let written = self.write_model(run, out, progress);
        progress.end();
        let path = self.path.display();
        match written {
            Ok(summary) => {
                let megabytes = summary.bytes as f64 * 1e-6;
                let left_out = match summary.n_left_out {
                    0 => String::new(),
                    n => format!("; {n} splats were left out by edits"),
                };
                let text = format!(
                    "Wrote {} splats ({megabytes:.1} MB) to {path}{left_out}",
                    summary.n_written,
                );
                end_write(out, self.number, text);
                // Never an error, because a file of this format was just written.
                let carrier = ModelFormat::from_path(self.path).map(ModelFormat::origin_carrier);
                if let Some(warning) = carrier.ok().and_then(|by| warning(local_origin(out), by)) {
                    out.notify(NoticeKind::Warning, format!("{path}: {warning}"));
                }
            }
            // A cancellation by the user is not an error.
            Err(ExportError { fault: Fault::Cancelled, .. }) => {
                out.notify(NoticeKind::Info, format!("{path}: {}", Fault::Cancelled));
            }
            Err(error) => out.notify(NoticeKind::Error, error.to_string()),
        }
    }

    fn write_model(
        &self,
        run: &Run,
        out: &Outbox,
        progress: &Progress,
    ) -> Result<WriteSummary, ExportError> {
        let report = |share: f64| {
            if progress.set_share(share) {
                out.wake();
            }
            progress.is_wanted()
        };
        let format = ModelFormat::from_path(self.path)?;
        let comments = run.session().map(|session| {
            file_comments(&session.config().method, session.learner().status().frames)
        });
        // Edits refer to indices of splats in the window, not in files.
        let (splats, flags) = match self.left_out.is_empty() {
            true => (run.splats(), None),
            false => {
                let splats = run.splats();
                let flags = self.left_out.deleted_flags(&splats);
                (splats, Some(flags))
            }
        };
        let selection = flags.as_deref().map(|flags| self.left_out.selection(flags));
        let options = WriteOptions {
            selection: selection.unwrap_or_default(),
            comments: &comments.unwrap_or_default(),
            metric: run.session().is_some_and(|session| session.dataset().is_metric()),
            up: out.snapshot.opened.as_ref().map_or(DVec3::Z, |opened| opened.home.up),
            local_origin: local_origin(out),
            mapping: self.mapping,
            spz_version: self.spz_version,
            progress: WriteProgress::new(&report),
            ..WriteOptions::new(format)
        };
        export::write(self.path, &splats, &options)
    }
}

/// Writes a text to a file; under an unused name if `path` exists.
pub fn write_text(path: &Path, text: &str, out: &mut Outbox) {
    let path = unused(path);
    // Atomically: half a path or half a table could be read as a whole one.
    match write_atomic(&path, |file| file.write_all(text.as_bytes())) {
        Ok(_) => out.notify(NoticeKind::Info, format!("Wrote {}", path.display())),
        Err(error) => out.notify(NoticeKind::Error, error.to_string()),
    }
}

/// Records that the file with this number is not written yet. The record remains if writing panics.
pub fn begin_write(out: &mut Outbox, number: u64) {
    out.snapshot.files.latest_write = Some(WriteOutcome { number, is_written: false });
}

fn end_write(out: &mut Outbox, number: u64, text: String) {
    out.snapshot.files.unsaved_frames = 0;
    out.snapshot.files.latest_write = Some(WriteOutcome { number, is_written: true });
    out.notify(NoticeKind::Info, text);
}

fn local_origin(out: &Outbox) -> DVec3 {
    out.snapshot.opened.as_ref().map_or(DVec3::ZERO, |opened| opened.local_origin)
}
