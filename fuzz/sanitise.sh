#!/usr/bin/env bash
# Checks the engine with memory tools: fuzz/sanitise.sh
# 1. The module with `unsafe` under AddressSanitizer (a nightly compiler).
# 2. Training, saving and resuming under valgrind: the memory left at the end must not depend on the frames.
set -euo pipefail
cd "$(dirname "$0")/.."

printf '\n=== AddressSanitizer\n'
target="$(realpath -m "${CARGO_TARGET_DIR:-target}")"
host="$(rustc -vV | sed -n 's/^host: //p')"
RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR="$target/sanitised" \
    cargo +nightly test --locked --manifest-path fuzz/simd/Cargo.toml --target "$host" --lib

printf '\n=== valgrind\n'
command -v valgrind >/dev/null || { echo "error: valgrind is missing; install it" >&2; exit 1; }
cargo build --release --locked
program="$target/release/vbgs-studio"
work="$(mktemp -d)"
trap 'rm -r "$work"' EXIT
cd "$work"
frames=(6 24)
for n in "${frames[@]}"; do
    "$program" synth "room$n" --size 64x48 --frames "$n" --eval-frames 0 >/dev/null 2>&1
    half="$((n / 2))"
    valgrind --leak-check=full --log-file="train$n" "$program" \
        train "room$n" --out "out$n" --max-frames "$half" >/dev/null 2>&1
    valgrind --leak-check=full --log-file="resume$n" "$program" \
        train "room$n" --out "more$n" --resume "out$n/checkpoint.vbgs" --max-frames "$n" >/dev/null 2>&1
done
for run in train resume; do
    sums=()
    for n in "${frames[@]}"; do
        lost="$(sed -n 's/.*definitely lost: \([0-9,]* bytes in [0-9,]* blocks\)/\1/p' "$run$n")"
        sums+=("$(sed -n 's/.*still reachable: \([0-9,]* bytes in [0-9,]* blocks\)/\1/p' "$run$n")")
        echo "$run, $n frames: lost $lost, kept to the end ${sums[-1]}"
        # Without leaks, valgrind may omit the summary.
        [[ "$lost" =~ ^(0 .*)?$ ]] || { cat "$run$n" >&2; exit 1; }
    done
    [ "${sums[0]}" = "${sums[1]}" ] || { echo "error: what is kept grows with frames" >&2; exit 1; }
done
