//! Each hot kernel of the engine alone, on one thread: `cargo bench --bench kernels`.
//!
//! The kernels are those whose instructions `bench history` counts, on larger inputs: 193,600 points, 100,000
//! components and four frames of a room of 440×330 pixels.

#![allow(clippy::print_stdout, clippy::expect_used)]

use criterion::{Criterion, criterion_group};
use strum::IntoEnumIterator;
use vbgs_studio::bench::history::{Kernel, KernelSize};

fn kernels(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kernels");
    group.sample_size(20);
    for kernel in Kernel::iter() {
        let name: &str = kernel.into();
        group.bench_function(name, |bencher| {
            let mut run = kernel.prepared(KernelSize::TIMED).expect("the input of a kernel");
            bencher.iter(|| run().expect("finite means"));
        });
    }
}

criterion_group!(all, kernels);

fn main() {
    // One thread, to measure the cost of a kernel without its parallel speedup.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build_global();
    pool.expect("the first pool of the process");
    all();
    Criterion::default().configure_from_args().final_summary();
}
