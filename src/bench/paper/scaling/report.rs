//! Fitted exponents, speed-ups, table, notes and plot of the scaling bench.
//!
//! Exponents are slopes of straight lines through logarithms. Over two decades a cost `a + b·n`
//! deviates from a power law, but the slope still distinguishes linear from quadratic.

use crate::bench::paper::scaling::{
    EnginePath, LINES, MeanPlacement, ScalingPlan, ScalingRow, Sweep,
};
use crate::bench::plot::{Axis, Mark, Panel, Series};
use crate::eval::metrics::Spread;
use crate::eval::report;
use serde::Serialize;

/// Power law fitted to the medians of one line.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    pub sweep: Sweep,
    pub means: MeanPlacement,
    pub path: EnginePath,
    /// `ms ∝ size^exponent`, least squares of the logarithms. `None` for fewer than two sizes.
    pub exponent: Option<f64>,
}

/// Values derived from the rows.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingSummary {
    /// One fit per sweep and line.
    pub fits: Vec<Fit>,
    /// Lines for which one and two threads were timed.
    pub speedups: Vec<Speedup>,
}

/// Speed-up of two threads over one.
#[derive(Clone, Debug, Serialize)]
pub struct Speedup {
    pub means: MeanPlacement,
    pub path: EnginePath,
    /// Time with one thread divided by time with two.
    pub two_over_one: f64,
}

impl ScalingSummary {
    pub fn of(rows: &[ScalingRow]) -> Self {
        Self { fits: fits(rows), speedups: speedups(rows) }
    }
}

fn line(
    rows: &[ScalingRow],
    sweep: Sweep,
    means: MeanPlacement,
    path: EnginePath,
) -> Vec<&ScalingRow> {
    rows.iter().filter(|r| (r.sweep, r.means, r.path) == (sweep, means, path)).collect()
}

fn fits(rows: &[ScalingRow]) -> Vec<Fit> {
    let sweeps = [Sweep::Points, Sweep::Components, Sweep::Threads];
    let fit = |sweep, (means, path)| {
        let line = line(rows, sweep, means, path);
        let sizes = line.iter().map(|r| (r.position(), r.ms)).collect::<Vec<_>>();
        Fit { sweep, means, path, exponent: exponent(&sizes) }
    };
    sweeps.into_iter().flat_map(|sweep| LINES.map(|line| fit(sweep, line))).collect()
}

/// Slope of the least-squares line through the logarithms. `None` if undefined.
fn exponent(sizes: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = sizes.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (mx, my) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let covariance: f64 = logs.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
    let variance: f64 = logs.iter().map(|(x, _)| (x - mx).powi(2)).sum();
    let slope = covariance / variance;
    slope.is_finite().then_some(slope)
}

fn speedups(rows: &[ScalingRow]) -> Vec<Speedup> {
    let speedup = |(means, path)| {
        let line = line(rows, Sweep::Threads, means, path);
        let of = |threads| line.iter().find(|r| r.threads == threads).map(|r| r.ms);
        Some(Speedup { means, path, two_over_one: of(1)? / of(2)? })
    };
    LINES.into_iter().filter_map(speedup).collect()
}

fn line_name(means: MeanPlacement, path: EnginePath) -> &'static str {
    match (means, path) {
        (MeanPlacement::Random, EnginePath::Fast) => "random means",
        (MeanPlacement::Surface, EnginePath::Fast) => "means on surfaces",
        (MeanPlacement::Random, EnginePath::Plain) => "random, plain path",
        (MeanPlacement::Surface, EnginePath::Plain) => "on surfaces, plain path",
    }
}

pub fn text(rows: &[ScalingRow]) -> String {
    let cells = |row: &ScalingRow| {
        [
            line_name(row.means, row.path).to_owned(),
            row.points.to_string(),
            row.components.to_string(),
            row.threads.to_string(),
            row.spread().to_string(),
            format!("{:.1}", row.plain_over_this),
        ]
    };
    let header = ["means", "points", "N", "threads", "ms/frame [quartiles]", "plain / this"];
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

/// Describes the measurement, the exponents and the speed-ups.
pub fn notes(plan: &ScalingPlan, summary: &ScalingSummary) -> Vec<String> {
    let mut notes = vec![
        format!(
            "C = 4, no reassignment, {} timed frames each after one warm-up frame, in turns. Plain path: KD-tree, f64, unfused statistics.",
            plan.repeats
        ),
        "Means on surfaces are points of six other frames.".to_owned(),
    ];
    for fit in &summary.fits {
        let Some(exponent) = fit.exponent else { continue };
        let (name, of) = (line_name(fit.means, fit.path), sweep_name(fit.sweep));
        notes.push(format!("{name}: ms grows as {of}^{exponent:.2}"));
    }
    for speedup in &summary.speedups {
        let name = line_name(speedup.means, speedup.path);
        notes.push(format!(
            "{name}: two threads are {:.2} times as fast as one",
            speedup.two_over_one
        ));
    }
    notes
}

fn sweep_name(sweep: Sweep) -> &'static str {
    match sweep {
        Sweep::Points => "points",
        Sweep::Components => "N",
        Sweep::Threads => "threads",
    }
}

/// One panel per sweep.
pub fn panels(rows: &[ScalingRow], fits: &[Fit]) -> Vec<Panel> {
    let sweeps = [Sweep::Points, Sweep::Components, Sweep::Threads];
    let panel = |sweep| Panel {
        title: format!("against {}", sweep_name(sweep)),
        x: Axis::Log(match sweep {
            Sweep::Points => "points per frame".to_owned(),
            Sweep::Components => "components N".to_owned(),
            Sweep::Threads => "threads".to_owned(),
        }),
        y: Axis::Log("ms per frame".to_owned()),
        series: fits
            .iter()
            .filter(|fit| fit.sweep == sweep)
            .map(|fit| {
                let exponent = fit.exponent.map_or_else(String::new, |e| format!(": ^{e:.2}"));
                Series {
                    name: format!("{}{exponent}", line_name(fit.means, fit.path)),
                    marks: line(rows, sweep, fit.means, fit.path)
                        .into_iter()
                        .map(|r| Mark {
                            x: Spread::exact(r.position()),
                            y: r.spread(),
                            label: None,
                        })
                        .collect(),
                    connected: true,
                }
            })
            .collect(),
    };
    sweeps.into_iter().map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_of_power_laws() {
        let law = |x: f64| (x, 3.0 * x.powf(0.7));
        let slope = exponent(&[law(1e3), law(1e4), law(1e6)]).unwrap();
        assert!((slope - 0.7).abs() < 1e-12, "{slope}");
        assert_eq!(exponent(&[law(1e3)]), None);
    }
}
