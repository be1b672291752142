//! A scene as one HTML file (`files.md`, HTML): the page `assets/viewer.html` with the splats as SPZ version 3 in
//! base64, which browsers show without a network.

use super::error::Fault;
use super::format::SpzVersion;
use super::source::ExportRows;
use super::spz::write::SpzLayout;
use super::stream::{ProgressCounter, SplatRows};
use crate::model::splat::framing::framing;
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use glam::DVec3;
use serde::Serialize;
use std::io;
use std::io::Write;

/// Page with a viewer; names in braces mark what is filled in.
const PAGE: &str = include_str!("../../assets/viewer.html");
const GENERATOR: &str = concat!("vbgs-studio ", env!("CARGO_PKG_VERSION"));
/// Horizontal field of view and elevation of the page's view, degrees: the defaults of `render`.
const FOV: f64 = 60.0;
const ELEVATION: f64 = 25.0;

pub(super) struct HtmlLayout {
    start: String,
    end: &'static str,
    splats: SpzLayout,
}

/// View in which the page opens, in the axes and units of the file; angles in radians.
#[derive(Serialize)]
struct View {
    centre: [f64; 3],
    radius: f64,
    azimuth: f64,
    elevation: f64,
    fov: f64,
}

impl HtmlLayout {
    /// Prepares the page. Fails as [`SpzLayout::new`].
    pub fn new(rows: &ExportRows) -> Result<Self, Fault> {
        let splats: Vec<_> = (0..rows.n_rows()).filter_map(|i| rows.row(i).to_splat()).collect();
        let sphere = framing(splats.iter().map(|(splat, _)| splat));
        let (centre, radius) = sphere.map_or((DVec3::ZERO, 1.0), |s| (s.centre, s.radius));
        // Splats are drawn best from where they were photographed.
        let ahead = rows.mean_direction();
        let view = View {
            centre: centre.to_array(),
            radius,
            azimuth: ahead.z.atan2(-ahead.x),
            elevation: ELEVATION.to_radians(),
            fov: FOV.to_radians(),
        };
        let view = serde_json::to_string(&view);
        let view = view.map_err(|e| Fault::Io { action: "describe the view", source: e.into() })?;
        let (start, end) = PAGE.split_once("{scene}").unwrap_or((PAGE, ""));
        let start = start.replace("{view}", &view).replace("{generator}", GENERATOR);
        let splats = SpzLayout::new(rows, SpzVersion::V3, rows.is_antialiased())?;
        Ok(Self { start, end, splats })
    }

    pub fn n_columns(&self) -> usize {
        self.splats.n_columns()
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        out.write_all(self.start.as_bytes())?;
        let mut text = EncoderWriter::new(&mut *out, &STANDARD);
        self.splats.write(&mut text, rows, steps)?;
        text.finish()?;
        drop(text);
        out.write_all(self.end.as_bytes())
    }
}
