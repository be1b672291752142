//! Tables, notes and plot of the accuracy bench.

use super::variants::Table;
use crate::bench::findings;
use crate::bench::plot::{Axis, Mark, Panel, Series};
use crate::bench::scene::{AccuracyRow, AccuracySummary};
use crate::eval::metrics::Spread;
use crate::train::scene::photometric::rule::PhotometricMode;

pub fn text(rows: &[AccuracyRow]) -> String {
    let tables = [
        (Table::Cumulative, "Each row adds a part to the row above:"),
        (Table::LeaveOneOut, "One change each:"),
        (Table::Scale, "Structural scale:"),
        (Table::Budget, "Budget, with the least useful components merged:"),
    ];
    let of_table = |(which, title): (Table, &str)| {
        let rows: Vec<&AccuracyRow> = rows.iter().filter(|r| r.table == which).collect();
        format!("{title}\n{}", findings::table(&rows, columns()))
    };
    // Scales below the depth noise are left out, so a table may be empty.
    let is_there = |table: &(Table, &str)| rows.iter().any(|row| row.table == table.0);
    let tables: Vec<String> = tables.into_iter().filter(is_there).map(of_table).collect();
    tables.join("\n\n")
}

type Column = (&'static str, fn(&&AccuracyRow) -> String);

fn columns() -> [Column; 11] {
    [
        ("configuration", |row| row.configuration.clone()),
        ("drawn", |row| format!("{:.0}", row.drawn)),
        ("born", |row| format!("{:.0}", row.born)),
        ("ms/frame", |row| format!("{:.1}", row.train_ms)),
        ("PSNR dB", |row| format!("{:.2}", row.psnr)),
        // A difference between rows counts only if it exceeds this one.
        ("orders", |row| format!("{:.3}", row.psnr_high - row.psnr_low)),
        ("covered", |row| decibels(row.psnr_covered)),
        ("aligned", |row| decibels(row.psnr_aligned_covered)),
        ("SSIM", |row| format!("{:.4}", row.ssim)),
        ("cracks % > 0.1 (> 0.3)", |row| shares(row.cracks_01, row.cracks_03)),
        ("at half distance", |row| shares(row.cracks_half_01, row.cracks_half_03)),
    ]
}

fn decibels(psnr: Option<f64>) -> String {
    psnr.map_or_else(String::new, |v| format!("{v:.2}"))
}

fn shares(over_01: Option<f64>, over_03: Option<f64>) -> String {
    match (over_01, over_03) {
        (Some(a), Some(b)) => format!("{:.2} ({:.2})", 100.0 * a, 100.0 * b),
        // Without depth there are no interior pixels.
        _ => String::new(),
    }
}

pub fn notes(summary: &AccuracySummary, n_crack_views: usize) -> Vec<String> {
    let AccuracySummary { frames, views, orders, seen, .. } = summary;
    let mut notes = vec![
        format!(
            "{frames} frames in {orders} orders (as listed, reversed, shuffled); quality: projected renderer, black background, {views} held-out views, mean of the orders; orders: highest minus lowest PSNR. ms: median over frames and orders, configurations in turns.",
        ),
        "covered: pixels with coverage ≥ 0.5; aligned: the same after fitting a factor and an offset per channel to each photograph.".to_owned(),
        format!(
            "cracks: share of interior pixels by their transmittance, frames as listed, {n_crack_views} views; interior: more than 5 pixels from depth edges."
        ),
    ];
    for early in seen {
        let interior = early
            .seen
            .coverage_interior
            .map_or_else(String::new, |share| format!(", {:.2} % away from edges", 100.0 * share));
        notes.push(format!(
            "frames trained: {}; on surfaces they observed: {:.2} dB, {:.2} % covered{interior}.",
            early.after_frames,
            early.seen.psnr,
            100.0 * early.seen.coverage
        ));
    }
    notes
}

/// Plots quality of the first two tables, and quality over training time and over number of components.
pub fn panels(rows: &[AccuracyRow], is_registered: bool) -> [Panel; 3] {
    // Without registration, exposure changes colours more than the model does, so use aligned
    // colours.
    let (title, measure): (_, fn(&AccuracyRow) -> Spread) = if is_registered {
        ("PSNR, dB (range of the orders)", |row| Spread {
            median: row.psnr,
            quartiles: [row.psnr_low, row.psnr_high],
        })
    } else {
        ("PSNR of covered pixels, colours aligned, dB", |row| {
            // The plot leaves out marks that are not finite.
            Spread::exact(row.psnr_aligned_covered.unwrap_or(f64::NAN))
        })
    };
    let is_part = |row: &AccuracyRow| matches!(row.table, Table::Cumulative | Table::LeaveOneOut);
    let named: Vec<&AccuracyRow> = rows.iter().filter(|r| is_part(r)).collect();
    let of_table = |which: Table, name: &str| {
        let rows = named.iter().enumerate().filter(|(_, row)| row.table == which);
        let mark =
            |(i, row): (usize, &&AccuracyRow)| Mark::new(measure(row), Spread::exact(i as f64));
        Series { name: name.to_owned(), marks: rows.map(mark).collect(), connected: false }
    };
    let parts = Panel {
        title: "parts of the preset".to_owned(),
        x: Axis::Linear(title),
        y: Axis::Names(named.iter().map(|row| row.configuration.clone()).collect()),
        series: vec![
            of_table(Table::Cumulative, "added one by one"),
            of_table(Table::LeaveOneOut, "one change each"),
        ],
    };
    let against = |name: &str, x: Axis, cost: fn(&AccuracyRow) -> f64| Panel {
        title: format!("{name} against quality"),
        x,
        y: Axis::Linear(title),
        series: curves(rows, cost, measure),
    };
    let speed = Axis::Linear("training, ms a frame");
    let speed = against("time", speed, |row| row.train_ms);
    let components = Axis::Log("components drawn");
    let components = against("components", components, |row| row.drawn);
    [parts, speed, components]
}

fn curves(
    rows: &[AccuracyRow],
    cost: fn(&AccuracyRow) -> f64,
    measure: fn(&AccuracyRow) -> Spread,
) -> Vec<Series> {
    let of_table = |which| rows.iter().filter(move |row| row.table == which);
    let scales: Vec<&AccuracyRow> = of_table(Table::Scale).collect();
    let budgets: Vec<&AccuracyRow> = of_table(Table::Budget).collect();
    let curve = |name: &str, rows: &[&AccuracyRow]| Series {
        name: name.to_owned(),
        marks: rows.iter().map(|row| Mark::new(Spread::exact(cost(row)), measure(row))).collect(),
        connected: true,
    };
    // Rows of one mode are adjacent, as `scales` lists them.
    let by_mode = scales.chunk_by(|a, b| a.photographs == b.photographs);
    let by_mode = by_mode.map(|rows| match rows[0].photographs {
        PhotometricMode::Off => curve("scales, points alone", rows),
        _ => curve("scales", rows),
    });
    by_mode.chain([curve("budgets", &budgets)]).collect()
}
