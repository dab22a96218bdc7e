#!/bin/sh
# scripts/replay.sh BUILD [MOST [FOLDER]]: every input that fuzzers found worth keeping (test/fuzz/corpus) once more in an
# ordinary build, at most MOST seconds of processor time each (0: any); and what lies in FOLDER/corpus and FOLDER/found. A
# mesh has ten times as much: its handler hands it on, but one that is accepted is mapped, of up to 40 million cells.
root=$(cd "$(dirname "$0")/.." && pwd)
kept=$(mktemp -d)
status=0
for packed in "$root"/test/fuzz/corpus/*.tar.gz; do
    kind=$(basename "$packed" .tar.gz)
    mkdir "$kept/$kind"
    tar -xzf "$packed" -C "$kept/$kind"
    most=${2:-0}
    [ "$kind" = node_mesh ] && most=${most}0
    printf '%s: ' "$kind"
    find "$kept/$kind" ${3:+"$3/corpus/$kind"} ${3:+"$3/found"} -type f \( -path "*/$kind/*" -o -name "$kind-*" \) -print0 |
        sort -z | xargs -0 "$1/test/replay_$kind" "$most" || status=1
done
rm -rf "$kept"
exit $status
