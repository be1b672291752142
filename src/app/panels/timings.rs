//! Timings of training and drawing as columns and CSV.

use crate::app::drawing::{DrawHistory, DrawStage};
use crate::eval::report::FrameReport;
use crate::train::stages::TrainStage;

/// Frames, then pictures, as CSV.
pub fn timings(frames: &[FrameReport], drawn: &DrawHistory) -> String {
    frames_csv(frames) + &drawing_csv(drawn)
}

/// Training stages of the preset.
pub fn stages(frames: &[FrameReport]) -> &'static [TrainStage] {
    frames.last().map_or(&[], |frame| frame.ms.stages.names())
}

/// Time of the stage at index `at` of [`stages`] per frame, milliseconds; 0 for frames with other stages,
/// such as those trained by version 0.1.0 before the run was resumed.
pub fn stage_ms(frames: &[FrameReport], at: usize) -> impl Iterator<Item = f64> {
    let stages = stages(frames);
    frames.iter().map(move |frame| match &frame.ms.stages {
        ms if ms.names() == stages => ms.values()[at],
        _ => 0.0,
    })
}

fn frames_csv(frames: &[FrameReport]) -> String {
    let names: Vec<&str> = stages(frames).iter().map(|stage| stage.key).collect();
    let mut text = format!("frame,points,load,prepare,{},train\n", names.join(","));
    let columns: Vec<Vec<f64>> =
        (0..names.len()).map(|at| stage_ms(frames, at).collect()).collect();
    for (i, f) in frames.iter().enumerate() {
        let stages: Vec<_> = columns.iter().map(|column| format!("{:.4}", column[i])).collect();
        let line = format!(
            "{},{},{:.4},{:.4},{},{:.4}\n",
            f.index,
            f.points,
            f.ms.load,
            f.ms.prepare,
            stages.join(","),
            f.ms.stages.train
        );
        text.push_str(&line);
    }
    text
}

/// A block of its own, since pictures do not correspond to frames.
fn drawing_csv(drawn: &DrawHistory) -> String {
    let names = DrawStage::ALL.map(|stage| format!("{} ms", stage.label())).join(",");
    let mut text = format!("\npicture,{names},uploaded bytes\n");
    for (i, sample) in drawn.samples().enumerate() {
        let cell = |stage| sample.ms(stage).map_or_else(String::new, |ms| format!("{ms:.4}"));
        let stages = DrawStage::ALL.map(cell).join(",");
        text.push_str(&format!("{i},{stages},{}\n", sample.uploaded_bytes));
    }
    text
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::app::drawing::{DrawSample, ViewRenderer};
    use crate::eval::report::FrameMs;
    use crate::train::stages::PAPER_STAGES;
    use crate::train::timing::StageMs;

    /// Report of a frame with `ms` milliseconds of training, all in the first stage.
    pub fn frame(ms: f64) -> FrameReport {
        let mut stages = StageMs::new(&PAPER_STAGES);
        stages.add(0, ms);
        stages.train = ms;
        FrameReport {
            behind_ms: None,
            tracked: None,
            index: 3,
            frame: "r_3".into(),
            points: 10,
            points_dropped: 0,
            components: 5,
            used: 2,
            born: 0,
            reassigned: 0,
            merged: 0,
            elbo_mean: 0.0,
            photograph: None,
            ms: FrameMs { load: 0.5, prepare: 0.25, stages },
        }
    }

    #[test]
    fn csv_has_a_column_per_heading() {
        let text = frames_csv(&[frame(1.0)]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
        assert!(lines[1].starts_with("3,10,0.5000,0.2500,1.0000,"));
    }

    #[test]
    fn pictures_leave_stages_empty_that_did_not_happen() {
        let mut drawn = DrawHistory::new(ViewRenderer::Gpu);
        let mut sample = DrawSample::new(640);
        sample.add(DrawStage::Order, Some(0.5));
        sample.add(DrawStage::Draw, Some(1.25));
        drawn.push(sample);
        let text = drawing_csv(&drawn);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1].split(',').count(), lines[2].split(',').count());
        assert_eq!(lines[2], "0,,0.5000,,,1.2500,640");
    }
}
