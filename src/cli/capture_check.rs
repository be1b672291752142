//! Formats the check of a recording's images and timestamps.

use vbgs_studio::dataset::capture_check::CaptureCheck;

/// Maximum number of frames listed per kind; the others are counted.
const NAMED: usize = 6;

/// Formats the check of a split, one line per kind.
pub fn lines(check: &CaptureCheck) -> Vec<String> {
    let CaptureCheck { looked_at, frames, blurred, brightness_jumps, usual_step_s, gaps } = check;
    let mut lines = vec![format!(
        "images: {looked_at} of {frames} frames checked, {} blurred, {} jumps of brightness",
        blurred.len(),
        brightness_jumps.len()
    )];
    let shares = blurred.iter().map(|b| format!("{} ({:.2})", b.frame, b.share));
    lines.extend(list("blurred (sharpness as a share of the neighbours')", shares));
    let factors = brightness_jumps.iter().map(|j| format!("{} ({:.2})", j.frame, j.factor));
    lines.extend(list("brightness jumps (times the frame before's)", factors));
    if let Some(usual) = usual_step_s {
        lines.push(format!("times: {:.1} frames a second, {} gaps", 1.0 / usual, gaps.len()));
    }
    let waits = gaps.iter().map(|gap| format!("{} ({:.2} s)", gap.frame, gap.seconds));
    lines.extend(list("gaps (seconds since the frame before)", waits));
    lines
}

fn list(what: &str, found: impl ExactSizeIterator<Item = String>) -> Option<String> {
    let n = found.len();
    let named: Vec<String> = found.take(NAMED).collect();
    let more = n - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (n > 0).then(|| format!("{what}: {}{more}", named.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vbgs_studio::dataset::capture_check::{BlurredFrame, BrightnessJump, TimeGap};

    #[test]
    fn every_kind_is_named_and_long_lists_are_cut() {
        let blurred = |i: usize| BlurredFrame { frame: format!("f{i}"), share: 0.25 };
        let check = CaptureCheck {
            looked_at: 160,
            frames: 4000,
            blurred: (0..8).map(blurred).collect(),
            brightness_jumps: vec![BrightnessJump { frame: "f9".into(), factor: 1.5 }],
            usual_step_s: Some(0.04),
            gaps: vec![TimeGap { frame: "f7".into(), seconds: 1.25 }],
        };
        let expected = [
            "images: 160 of 4000 frames checked, 8 blurred, 1 jumps of brightness",
            "blurred (sharpness as a share of the neighbours'): f0 (0.25), f1 (0.25), f2 (0.25), f3 (0.25), f4 (0.25), f5 (0.25) and 2 more",
            "brightness jumps (times the frame before's): f9 (1.50)",
            "times: 25.0 frames a second, 1 gaps",
            "gaps (seconds since the frame before): f7 (1.25 s)",
        ];
        assert_eq!(lines(&check), expected);
    }
}
