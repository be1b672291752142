#!/usr/bin/env bash
# Fuzzes every target, or the given ones, for 300 seconds each: fuzz/run.sh [SECONDS [TARGET...]]
set -euo pipefail
cd "$(dirname "$0")/.."

seconds="${1:-300}"
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cargo +nightly fuzz list | grep -vx seeds)

# Inputs in memory where possible: the fuzzer creates thousands of files a second.
[ -d /dev/shm ] && export TMPDIR="${TMPDIR:-/dev/shm}"
# One thread, so that runs of an input are alike.
export RAYON_NUM_THREADS=1

cargo +nightly fuzz build
built="${CARGO_TARGET_DIR:-fuzz/target}/$(rustc -vV | sed -n 's/^host: //p')/release"
"$built/seeds" fuzz/corpus
for target in "${targets[@]}"; do
    printf '\n=== %s\n' "$target"
    mkdir -p "fuzz/found/$target" "fuzz/artifacts/$target"
    "$built/$target" "fuzz/corpus/$target" "fuzz/found/$target" \
        -artifact_prefix="fuzz/artifacts/$target/" -max_total_time="$seconds" -max_len=16384 \
        -timeout=10 -rss_limit_mb=2048 -malloc_limit_mb=1024 -print_final_stats=1
done
