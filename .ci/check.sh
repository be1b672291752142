#!/usr/bin/env bash
# Every gate, one command; the first one that fails ends it. The window's tests want a display and
# a Vulkan adapter: `.ci/run` brings software ones.
set -euo pipefail
cd "$(dirname "$0")/.."

# A test that finds no data, no adapter or no display fails here instead of being skipped.
export VBGS_STRICT=1
# Software adapters speak Vulkan; never fall back to another API unseen.
export WGPU_BACKEND="${WGPU_BACKEND:-vulkan}"

gate() {
    printf '\n=== %s\n' "$*"
    local start=$SECONDS
    "$@"
    printf '=== passed in %d s\n' $((SECONDS - start))
}

# One profile everywhere, so that dependencies are built once.
gate cargo fmt --check
gate cargo clippy --locked --release --all-targets -- -D warnings
# The engine as a library, as others build it: what tests depend on would bring features along.
gate cargo clippy --locked --release --no-default-features -- -D warnings
# The program without a window.
gate cargo clippy --locked --release --all-targets --no-default-features --features cli,bench \
    -- -D warnings
gate env RUSTDOCFLAGS="-D warnings" \
    cargo doc --locked --release --no-deps --document-private-items
gate cargo test --release
# A robot's program feeds the engine from memory; the tests have built it.
gate cargo run --locked --release --example robot
# The engine as a Python package; tested as the system's Python finds it.
gate cargo clippy --locked --release --package vbgs-studio-python -- -D warnings
gate python/check --locked
# Figures of time are of a quiet machine, and pictures are looked at: those run by name.
gate cargo test --release -- --ignored --skip figures --skip pictures
# What machines without AVX2 run passes the same tests. The window's own code has no lanes.
gate env VBGS_SIMD=portable cargo test --release --lib --test render -- --skip app::
gate env VBGS_SIMD=portable cargo test --release --test engine -- inference variants
# Neither instructions of the hot kernels nor pictures get worse than in the last line of the history. A line is
# added by hand, `.ci/history .ci/history.csv`, so the gate appends to a copy.
history="$(mktemp -d)"
trap 'rm -rf "$history"' EXIT
cp .ci/history.csv "$history"
gate .ci/history "$history/history.csv"
# Comments, messages, help texts and documentation stay in plain English.
gate .ci/words target/release/vbgs-studio
printf '\n=== every gate passed in %d s\n' "$SECONDS"
