#!/bin/sh
# scripts/sanitize.sh address|thread BUILD [SECONDS]: tests under sanitizers, built into BUILD/asan or BUILD/tsan beside a
# finished BUILD. `address`: every test in C, and the rostests. `thread`: the tests that use threads, and 64 clients that
# make mixed calls to the node for SECONDS; of these alone reports with libroscpp in the stack do not count.
root=$(cd "$(dirname "$0")/.." && pwd)
build=$2
jobs=$(nproc)
if [ "$1" = thread ]; then
    out=$build/tsan flags=thread
else
    out=$build/asan flags=address,undefined
fi
mkdir -p "$out"
cmake -S "$root" -B "$out" -DCATNAV_SANITIZE=$flags -DPYTHON_EXECUTABLE=/usr/bin/python3 > "$out/build.log" 2>&1 || exit 1
export ROS_HOSTNAME=localhost

if [ "$1" = thread ]; then
    tests=$(cd "$root" && grep -lE 'pthread_create|cn_pool|threads' test/core/test_*.c test/node/test_*.c test/ompl/test_*.c |
        xargs -n1 basename | sed 's/\.c$//')
    cmake --build "$out" -j"$jobs" --target catnav_node $tests >> "$out/build.log" 2>&1 || { tail -20 "$out/build.log"; exit 1; }
    status=0
    for name in $tests; do
        if TSAN_OPTIONS=exitcode=66 "$out/test/$name" > "$out/$name.log" 2>&1; then
            echo "$name: no report"
        else
            echo "$name: see $out/$name.log"
            status=1
        fi
    done
    . "$build/devel/setup.sh"
    CATNAV_NODE=$out/devel/lib/catnav/catnav_node TSAN_OPTIONS="exitcode=66 suppressions=$root/test/ros/tsan.txt" \
        /usr/bin/python3 "$root/scripts/ros/hammer.py" crowd --clients 64 --seconds "${3:-60}" || status=1
    exit $status
fi

cmake --build "$out" -j"$jobs" >> "$out/build.log" 2>&1 && cmake "$out" >> "$out/build.log" || { tail -20 "$out/build.log"; exit 1; }
# reports go to files: nobody looks at the exit status of a node that roslaunch has started
rm -rf "$out/reports" && mkdir "$out/reports"
export ASAN_OPTIONS=detect_stack_use_after_return=1:log_path=$out/reports/address UBSAN_OPTIONS=log_path=$out/reports/undefined
export CATNAV_PATIENCE=10 CATNAV_TIME_LIMIT=6000
cd "$out" && ctest -V -j"$jobs" -E 'command|fuzz' --timeout 12000 > test.log 2>&1
status=0
for report in "$out"/reports/*; do
    [ -f "$report" ] && status=1 && head -20 "$report"
done
sh "$root/scripts/test_summary.sh" test.log && [ $status = 0 ]
