#!/bin/sh
# scripts/fuzz.sh SECONDS FOLDER [KEEP]: every fuzzer of test/fuzz for so long each, built and kept in FOLDER. Begins with
# the files of test/data, test/fuzz/corpus, and what earlier runs found in FOLDER/corpus; an input that breaks something
# is left in FOLDER/found, and the status is 1. KEEP: a folder (test/fuzz/corpus) into which what reaches more than
# other inputs do, and what was found, is packed.
seconds=$1
out=$2
keep=$3
root=$(cd "$(dirname "$0")/.." && pwd)
clang=$(command -v clang-14 || command -v clang) || { echo "fuzz: clang is not there"; exit 0; }

mkdir -p "$out/found"
cmake -S "$root" -B "$out" -DCATNAV_FUZZ=ON -DCATNAV_CORE_ONLY=ON -DCMAKE_C_COMPILER="$clang" > "$out/build.log" 2>&1 &&
    cmake --build "$out" -j2 >> "$out/build.log" 2>&1 || { tail -20 "$out/build.log"; exit 1; }

seed() { # kind, files: into its corpus
    kind=$1
    shift
    mkdir -p "$out/corpus/$kind"
    for file; do
        [ -f "$file" ] && [ "$(stat -c %s "$file")" -lt 65536 ] && cp "$file" "$out/corpus/$kind/"
    done
}
data=$root/test/data
seed stl "$data"/meshes/*.stl
seed obj "$data"/meshes/*.obj "$root"/test/ros/*.obj
seed ply "$data"/meshes/*.ply
seed msh "$data"/meshes/*.msh
seed scene "$root"/launch/scenes/*.yaml "$data"/scenes/*.yaml "$root"/test/ros/*.yaml
seed tetgen
seed positions
{ printf '\002'; echo '0 0 0 # at rest'; echo '1e-3 -2.5 .5'; } > "$out/corpus/positions/two"
seed molecules
{ echo '# x y z r'; echo '0 0 0 0.01'; echo '0.015 0 0 0.01'; } > "$out/corpus/molecules/two"
printf '0 0 0\n0.015 0 0\n0.015 0.012 0\n' > "$out/corpus/molecules/three"
{ cat "$data/meshes/tetra.node"; echo '#ele'; cat "$data/meshes/tetra.ele"; } > "$out/corpus/tetgen/tetra"

status=0
for fuzzer in "$root"/test/fuzz/fuzz_*.c; do
    name=$(basename "$fuzzer" .c)
    kind=${name#fuzz_}
    mkdir -p "$out/corpus/$kind"
    [ -f "$root/test/fuzz/corpus/$kind.tar.gz" ] && tar -xzf "$root/test/fuzz/corpus/$kind.tar.gz" -C "$out/corpus/$kind"
    if (cd "$out" && "./$name" -max_total_time="$seconds" -max_len=65536 -timeout=60 -rss_limit_mb=2048 \
            -artifact_prefix="found/$kind-" -print_final_stats=1 "corpus/$kind") > "$out/$name.log" 2>&1; then
        echo "$name: $(sed -n 's/^stat::number_of_executed_units: *//p' "$out/$name.log") inputs, nothing found;" \
            "slowest $(sed -n 's/^stat::slowest_unit_time_sec: *//p' "$out/$name.log") s"
    else
        status=1
        echo "$name: FOUND, see $out/$name.log"
        grep -E "ERROR|SUMMARY|runtime error|was accepted|allowed|sentence|out of range|Test unit written" "$out/$name.log"
    fi
    if [ -n "$keep" ]; then
        mkdir -p "$out/least/$kind" "$keep"
        (cd "$out" && "./$name" -merge=1 -max_len=2048 "least/$kind" "corpus/$kind") > "$out/$name.merge.log" 2>&1
        cp "$out/found/$kind-"* "$out/least/$kind/" 2> /dev/null # what broke it is tried ever after
        tar -C "$out/least/$kind" --sort=name --owner=0 --group=0 --mtime=@0 -cf - . | gzip -n9 > "$keep/$kind.tar.gz"
    fi
done
exit $status
