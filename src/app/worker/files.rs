//! Files written by the training thread.

use super::thread::WorkerThread;
use crate::app::edit::marks::LeftOut;
use crate::app::opening::Content;
use crate::app::settings_file::unused;
use crate::app::state::{NoticeKind, WriteOutcome};
use crate::export;
use crate::export::atomic::write_atomic;
use crate::export::local_origin::warning;
use crate::export::mapping::Mapping;
use crate::export::{ExportError, Fault, ModelFormat, WriteOptions, WriteProgress, WriteSummary};
use crate::pipeline::any_preset::file_comments;
use crate::pipeline::session::Session;
use glam::DVec3;
use std::path::Path;

impl WorkerThread {
    pub(super) fn save(&mut self, number: u64, path: &Path) {
        self.begin_write(number);
        let Some(Content::Session(session)) = &self.content else { return };
        match session.save(path) {
            Ok(bytes) => {
                // Not after an export: training cannot be resumed from one, so these frames
                // are still stored after a crash.
                self.files.record_save();
                let text = format!(
                    "Saved {} frames ({:.1} MB) to {}",
                    self.snapshot.frames_done,
                    bytes as f64 * 1e-6,
                    path.display()
                );
                self.end_write(number, text);
            }
            Err(error) => self.notify(NoticeKind::Error, error.to_string()),
        }
    }

    pub(super) fn export(
        &mut self,
        number: u64,
        path: &Path,
        mapping: Mapping,
        left_out: &LeftOut,
    ) {
        self.begin_write(number);
        self.settle();
        self.shared.file.begin();
        let written = self.write_model(path, mapping, left_out);
        self.shared.file.end();
        match written {
            Ok(summary) => {
                let megabytes = summary.bytes as f64 * 1e-6;
                let left_out = match summary.n_left_out {
                    0 => String::new(),
                    n => format!("; {n} splats were left out by edits"),
                };
                let text = format!(
                    "Wrote {} splats ({megabytes:.1} MB) to {}{left_out}",
                    summary.n_written,
                    path.display()
                );
                self.end_write(number, text);
                let carrier = ModelFormat::from_path(path).map(ModelFormat::origin_carrier);
                let warning = carrier.ok().and_then(|by| warning(self.local_origin(), by));
                if let Some(warning) = warning {
                    let text = format!("{}: {warning}", path.display());
                    self.notify(NoticeKind::Warning, text);
                }
            }
            // A cancellation by the user is no error.
            Err(ExportError { fault: Fault::Cancelled, .. }) => {
                let text = format!("{}: {}", path.display(), Fault::Cancelled);
                self.notify(NoticeKind::Info, text);
            }
            Err(error) => self.notify(NoticeKind::Error, error.to_string()),
        }
    }

    /// Writes a text, under an unused name if the file exists.
    pub(super) fn write_text(&mut self, path: &Path, text: &str) {
        let path = unused(path);
        // Atomically: half a path or half a table could be read as a whole one.
        match write_atomic(&path, |out| out.write_all(text.as_bytes())) {
            Ok(_) => self.notify(NoticeKind::Info, format!("Wrote {}", path.display())),
            Err(error) => self.notify(NoticeKind::Error, error.to_string()),
        }
    }

    fn write_model(
        &self,
        path: &Path,
        mapping: Mapping,
        left_out: &LeftOut,
    ) -> Result<WriteSummary, ExportError> {
        let told = |share: f64| {
            if self.shared.file.set_share(share) {
                (self.waker)();
            }
            self.shared.file.is_wanted()
        };
        ModelFormat::from_path(path).and_then(|format| {
            let comments = match &self.content {
                Some(Content::Session(session)) => {
                    file_comments(&session.config().method, session.learner().frames())
                }
                _ => Vec::new(),
            };
            // Edits refer to indices of splats in the window, not in files.
            let (splats, flags) = match left_out.is_empty() {
                true => (self.stored_splats(), None),
                false => {
                    let splats = self.splats();
                    let flags = left_out.deleted_flags(&splats);
                    (splats, Some(flags))
                }
            };
            let selection = flags.as_deref().map(|flags| left_out.selection(flags));
            let options = WriteOptions {
                selection: selection.unwrap_or_default(),
                comments: &comments,
                metric: self.is_metric(),
                up: self.up(),
                local_origin: self.local_origin(),
                mapping,
                progress: WriteProgress::new(&told),
                ..WriteOptions::new(format)
            };
            export::write(path, &splats, &options)
        })
    }

    /// Records the file as not written until it is; after a panic this remains.
    fn begin_write(&mut self, number: u64) {
        self.snapshot.latest_write = Some(WriteOutcome { number, is_written: false });
    }

    fn end_write(&mut self, number: u64, text: String) {
        self.snapshot.unsaved_frames = 0;
        self.snapshot.latest_write = Some(WriteOutcome { number, is_written: true });
        self.notify(NoticeKind::Info, text);
    }

    fn up(&self) -> DVec3 {
        self.snapshot.opened.as_ref().map_or(DVec3::Z, |opened| opened.home.up)
    }

    fn local_origin(&self) -> DVec3 {
        self.snapshot.opened.as_ref().map_or(DVec3::ZERO, |opened| opened.local_origin)
    }

    fn is_metric(&self) -> bool {
        matches!(&self.content, Some(Content::Session(session)) if is_metric(session))
    }
}

fn is_metric(session: &Session) -> bool {
    session.dataset().is_metric()
}
