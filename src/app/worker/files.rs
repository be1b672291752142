//! Files written by the training thread.

use super::autosave::Files;
use super::outbox::Outbox;
use super::run::Run;
use crate::app::edit::marks::LeftOut;
use crate::app::export_options::ExportKind;
use crate::app::settings_file::unused;
use crate::app::state::{NoticeKind, WriteOutcome};
use crate::export;
use crate::export::atomic::write_atomic;
use crate::export::local_origin::{OriginCarrier, warning};
use crate::export::mapping::Mapping;
use crate::export::mesh::{MeshFormat, MeshSummary, Surfel, write_mesh};
use crate::export::registration::shift_and_origin;
use crate::export::{ExportError, Fault, ModelFormat, SpzVersion, WriteOptions, WriteProgress};
use crate::pipeline::any_preset::file_comments;
use crate::pipeline::job::Progress;
use crate::pipeline::tracked::surfels;
use glam::DVec3;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug)]
pub struct Export {
    /// Number that identifies the file when the snapshot reports the outcome.
    pub number: u64,
    pub path: PathBuf,
    pub kind: ExportKind,
    /// Conversion to standard 3DGS splats.
    pub mapping: Mapping,
    pub spz_version: SpzVersion,
    /// Splats that are not exported.
    pub left_out: LeftOut,
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
            Err(error) => fail_write(out, number, error.to_string()),
        }
    }
}

impl Export {
    /// Writes the file, reports the progress, and finally the outcome.
    pub fn write(&self, run: &Run, out: &mut Outbox, progress: &Progress) {
        progress.begin();
        let written = self.write_content(run, out, progress);
        progress.end();
        let path = self.path.display();
        match written {
            Ok((text, carrier)) => {
                end_write(out, self.number, text);
                let [_, origin] = shift_and_origin(run.registration(), local_origin(out));
                if let Some(warning) = warning(origin, carrier) {
                    out.notify(NoticeKind::Warning, format!("{path}: {warning}"));
                }
            }
            // A cancellation by the user is not an error.
            Err(ExportError { fault: Fault::Cancelled, .. }) => {
                out.notify(NoticeKind::Info, format!("{path}: {}", Fault::Cancelled));
            }
            Err(error) => fail_write(out, self.number, error.to_string()),
        }
    }

    /// Writes the file. Returns the text of a notice, and how the file stores the local origin.
    fn write_content(
        &self,
        run: &Run,
        out: &Outbox,
        progress: &Progress,
    ) -> Result<(String, OriginCarrier), ExportError> {
        let report = |share: f64| {
            if progress.set_share(share) {
                out.wake();
            }
            progress.is_wanted()
        };
        let comments = run.session().map(|session| {
            file_comments(&session.config().method, session.learner().status().frames)
        });
        // Edits refer to indices of splats in the window, not in files.
        let splats = run.splats();
        let flags = (!self.left_out.is_empty()).then(|| self.left_out.deleted_flags(&splats));
        let selection = flags.as_deref().map(|flags| self.left_out.selection(flags));
        // A mesh ignores the format of splats.
        let format = match self.kind {
            ExportKind::Mesh => ModelFormat::Ply,
            kind => kind.splat_format(&self.path)?,
        };
        let options = WriteOptions {
            selection: selection.unwrap_or_default(),
            comments: &comments.unwrap_or_default(),
            metric: run.session().is_some_and(|session| session.dataset().is_metric()),
            up: out.snapshot.opened.as_ref().map_or(DVec3::Z, |opened| opened.home.up),
            local_origin: local_origin(out),
            registration: run.registration(),
            mapping: self.mapping,
            spz_version: self.spz_version,
            progress: WriteProgress::new(&report),
            ..WriteOptions::new(format)
        };
        let path = self.path.display();
        if self.kind == ExportKind::Mesh {
            let format = MeshFormat::from_path(&self.path)?;
            let MeshSummary { n_triangles, bytes, .. } = self.write_mesh(run, format, &options)?;
            let megabytes = bytes as f64 * 1e-6;
            let text = format!("Wrote {n_triangles} triangles ({megabytes:.1} MB) to {path}");
            return Ok((text, format.origin_carrier()));
        }
        let summary = export::write(&self.path, &splats, &options)?;
        let left_out = match summary.n_left_out {
            0 => String::new(),
            n => format!("; {n} splats were left out by edits"),
        };
        let (n, megabytes) = (summary.n_written, summary.bytes as f64 * 1e-6);
        let text = format!("Wrote {n} splats ({megabytes:.1} MB) to {path}{left_out}");
        Ok((text, format.origin_carrier()))
    }

    fn write_mesh(
        &self,
        run: &Run,
        format: MeshFormat,
        options: &WriteOptions,
    ) -> Result<MeshSummary, ExportError> {
        let session = run.session();
        let surfels = session.map(|session| {
            let all = surfels(session.learner(), session.normalization());
            let is_kept =
                |(i, surfel): &(usize, Surfel)| options.selection.selects(*i, surfel.mean, None);
            all.into_iter().filter(is_kept).map(|(_, surfel)| surfel).collect::<Vec<_>>()
        });
        // Half the structural scale, as on the command line. Without a scene there are no surfaces, which
        // the writer reports.
        let h = session.and_then(|session| session.config().method.scene().map(|s| s.engine.h));
        let cell = h.map_or(1.0, |h| 0.5 * h);
        write_mesh(&self.path, &surfels.unwrap_or_default(), cell, format, options)
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
    out.snapshot.files.is_registration_unsaved = false;
    out.snapshot.files.latest_write = Some(WriteOutcome { number, is_written: true });
    out.notify(NoticeKind::Info, text);
}

fn fail_write(out: &mut Outbox, number: u64, error: String) {
    out.snapshot.files.failed_write = Some((number, error.as_str().into()));
    out.notify(NoticeKind::Error, error);
}

fn local_origin(out: &Outbox) -> DVec3 {
    out.snapshot.opened.as_ref().map_or(DVec3::ZERO, |opened| opened.local_origin)
}
