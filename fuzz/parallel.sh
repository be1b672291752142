#!/usr/bin/env bash
# Fuzzes all targets at once from the archive that fuzz/pack.sh wrote beside this file, each by two processes or
# by as many as are given: parallel.sh SECONDS RESULTS [TARGET[:PROCESSES]...]
# In RESULTS: stats.txt, crashes.tar.gz (artifacts and logs), corpus.tar.gz (minimised).
set -euo pipefail
[ $# -ge 2 ] || { echo "usage: parallel.sh SECONDS RESULTS [TARGET[:PROCESSES]...]" >&2; exit 2; }
seconds="$1"
mkdir -p "$2"
results="$(realpath "$2")"
shift 2
here="$(realpath "$(dirname "$0")")"

# Inputs in memory if there is room: the fuzzer creates thousands of files a second.
shm="$(df -m --output=avail /dev/shm 2>/dev/null | tail -1 || echo 0)"
if [ "$shm" -ge 1000 ]; then base=/dev/shm; else base="${TMPDIR:-/tmp}"; fi
work="$(mktemp -d -p "$base" fuzz.XXXXXX)"
trap 'rm -rf "$work"' EXIT
tar -C "$work" -xzf "$here/fuzz.tar.gz"
cd "$work"
mkdir -p temporary logs minimised
export TMPDIR="$work/temporary"
# One thread per process, so that runs of an input are alike.
export RAYON_NUM_THREADS=1 ASAN_OPTIONS=detect_odr_violation=0:detect_leaks=0

wanted=("$@")
[ ${#wanted[@]} -gt 0 ] || mapfile -t wanted < <(ls corpus)
targets=("${wanted[@]%%:*}")
limits=(-max_len=16384 -timeout=20 -rss_limit_mb=4096 -malloc_limit_mb=1024)
end=$(($(date +%s) + seconds))

# One process after the other until the time is over, because libFuzzer ends at the first crash.
fuzz() {
    local target="$1" process="$2" run=0 left
    mkdir -p "artifacts/$target" "found/$target"
    while left=$((end - $(date +%s))) && [ "$left" -gt 5 ] && [ "$run" -lt 40 ]; do
        VBGS_FUZZ_TARGET="$target" ./all "corpus/$target" "found/$target" "${limits[@]}" \
            -artifact_prefix="artifacts/$target/" -max_total_time="$left" -print_final_stats=1 \
            -seed="$((RANDOM * 1000 + process * 100 + run + 1))" \
            >"logs/$target-$process-$run" 2>&1 || true
        run=$((run + 1))
    done
}
for one in "${wanted[@]}"; do
    n=2
    case "$one" in *:*) n="${one##*:}" ;; esac
    for ((process = 1; process <= n; process++)); do fuzz "${one%%:*}" "$process" & done
done
wait

# The smallest set of inputs with the same coverage.
for target in "${targets[@]}"; do
    mkdir -p "minimised/$target"
    VBGS_FUZZ_TARGET="$target" timeout 75 ./all -merge=1 "minimised/$target" "corpus/$target" \
        "${limits[@]}" >"logs/$target-merge" 2>&1 || echo "$target is not minimised in 75 s" &
done
wait

for target in "${targets[@]}"; do
    # For a process that ended without final statistics, the last reported number of executions.
    executed="$(for log in logs/"$target"-[0-9]*-*; do
        sed -n 's/^stat::number_of_executed_units: *//p' "$log" | grep . ||
            sed -n 's/^#\([0-9]*\)\t.*/\1/p' "$log" | tail -1
    done | awk '{ sum += $1 } END { print sum + 0 }')"
    covered="$(grep -aho 'cov: [0-9]* ft: [0-9]*' logs/"$target"-[0-9]*-* | sort -k2n | tail -1 || true)"
    crashes="$(ls "artifacts/$target" 2>/dev/null | wc -l)"
    echo "$target: $executed executions, $covered, $(ls "corpus/$target" | wc -l) inputs," \
        "$(ls "minimised/$target" | wc -l) minimised, $crashes artifacts"
done | tee "$results/stats.txt"
for log in logs/*; do tail -c 6000 "$log" >"$log.end" && mv "$log.end" "$log"; done
mkdir -p artifacts
tar -czf "$results/crashes.tar.gz" artifacts logs
tar -C minimised -czf "$results/corpus.tar.gz" .
