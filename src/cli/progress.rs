//! Progress bars on stderr; hidden if stderr is not a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;

/// Creates a bar over `n` steps named `what`.
pub fn bar(n: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(n as u64);
    let shown = std::io::stderr().is_terminal();
    bar.set_draw_target(if shown {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    });
    let style = ProgressStyle::with_template("{prefix} {pos}/{len} {bar:32} {msg} eta {eta}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_prefix(what);
    bar
}

/// Shows a bar while `work` reports the number of steps done and the total.
pub fn steps<T>(what: &'static str, work: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let bar = bar(0, what);
    let result = work(&mut |done, all| {
        // Known only now: the number of steps depends on the data.
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    result
}

/// Shows a bar while `work` reports the share done.
pub fn share<T>(what: &'static str, work: impl FnOnce(&dyn Fn(f64)) -> T) -> T {
    let bar = bar(100, what);
    let result = work(&|share| bar.set_position((100.0 * share) as u64));
    bar.finish_and_clear();
    result
}

/// Prints a warning without tearing the bar.
pub fn warn(bar: &ProgressBar, message: &str) {
    bar.suspend(|| eprintln!("warning: {message}"));
}
