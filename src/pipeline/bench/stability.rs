use super::{Bench, BenchError, BenchOptions, Progress};
pub fn run(_: BenchOptions, _: Progress) -> Result<Bench, BenchError> {
    unimplemented!()
}
