#!/usr/bin/env bash
# Builds one binary of all targets and packs it with the inputs of fuzz/corpus and fuzz/found for another
# machine, where parallel.sh in the folder runs it: fuzz/pack.sh FOLDER [SANITIZER]
# Without the AddressSanitizer (SANITIZER `none`) executions are faster.
set -euo pipefail
[ $# -ge 1 ] || { echo "usage: fuzz/pack.sh FOLDER [address|none]" >&2; exit 2; }
mkdir -p "$1"
folder="$(realpath "$1")"
sanitizer="${2:-address}"
cd "$(dirname "$0")"

host="$(rustc -vV | sed -n 's/^host: //p')"
# Flags of `cargo fuzz build`, with optimisation, because this build runs for much longer than it takes.
flags=(--cfg fuzzing -Cdebug-assertions -Cpasses=sancov-module)
for flag in coverage-level=4 coverage-inline-8bit-counters coverage-pc-table \
    coverage-trace-compares coverage-stack-depth; do
    flags+=("-Cllvm-args=-sanitizer-$flag")
done
flags+=(-Cllvm-args=-simplifycfg-branch-fold-threshold=0)
[ "$sanitizer" = none ] || flags+=("-Zsanitizer=$sanitizer")
RUSTFLAGS="${flags[*]}" CARGO_INCREMENTAL=0 cargo +nightly build --release --target "$host" \
    --bin all --bin seeds \
    --config 'profile.release.incremental=false' --config 'profile.release.codegen-units=8' \
    --config 'profile.release.package.vbgs-studio.opt-level=2' \
    --config 'profile.release.package.vbgs-studio.incremental=false'
built="${CARGO_TARGET_DIR:-target}/$host/release"
"$built/seeds" corpus

packed="$(mktemp -d)"
trap 'rm -r "$packed"' EXIT
strip --strip-debug -o "$packed/all" "$built/all"
cp -r corpus found "$packed"
tar -C "$packed" -czf "$folder/fuzz.tar.gz" .
cp parallel.sh "$folder"
du -h "$folder/fuzz.tar.gz"
