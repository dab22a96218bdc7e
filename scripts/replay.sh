#!/bin/sh
# scripts/replay.sh BUILD [MOST [FOLDER]]: every input that fuzzers found worth keeping (test/fuzz/corpus) once more in an
# ordinary build, at most MOST seconds of processor time each (0: any); and what lies in FOLDER/corpus and FOLDER/found.
# Meshes that are accepted and mapped whole, of up to 40 million cells, take longer and are not kept there.
root=$(cd "$(dirname "$0")/.." && pwd)
kept=$(mktemp -d)
status=0
for packed in "$root"/test/fuzz/corpus/*.tar.gz; do
    kind=$(basename "$packed" .tar.gz)
    mkdir "$kept/$kind"
    tar -xzf "$packed" -C "$kept/$kind"
    printf '%s: ' "$kind"
    find "$kept/$kind" ${3:+"$3/corpus/$kind"} ${3:+"$3/found"} -type f \( -path "*/$kind/*" -o -name "$kind-*" \) -print0 |
        sort -z | xargs -0 "$1/test/replay_$kind" "${2:-0}" || status=1
done
rm -rf "$kept"
exit $status
