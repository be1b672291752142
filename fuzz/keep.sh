#!/usr/bin/env bash
# Packs the smallest inputs of every target of a minimised corpus, 50 kB of each, as fuzz/corpus.tar.gz, which the tests
# replay: fuzz/keep.sh CORPUS, where CORPUS is the corpus.tar.gz that parallel.sh wrote
set -euo pipefail
[ $# -eq 1 ] || { echo "usage: fuzz/keep.sh CORPUS" >&2; exit 2; }
kept="$(realpath "$(dirname "$0")")/corpus.tar.gz"
unpacked="$(mktemp -d)"
trap 'rm -r "$unpacked"' EXIT
tar -C "$unpacked" -xzf "$1"
cd "$unpacked"
for target in *; do
    find "$target" -type f -printf '%s %p\n' | sort -n |
        awk '{ sum += $1 } sum <= 50000 { print $2 }'
done | sort >list
tar --owner=0 --group=0 --mode=644 --mtime=@0 -cf - -T list | gzip -9n >"$kept"
echo "$(wc -l <list) inputs, $(stat -c %s "$kept") bytes"
