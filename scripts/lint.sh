#!/bin/sh
# scripts/lint.sh BUILD: clang-tidy (.clang-tidy), cppcheck (warning, portability) and catkin_lint (-W2 --strict) have
# nothing to say. BUILD holds compile_commands.json. GCC's vector kernels, which clang cannot read, are cppcheck's alone.
root=$(cd "$(dirname "$0")/.." && pwd)
build=$1
status=0
for tool in clang-tidy cppcheck catkin_lint; do
    command -v $tool > /dev/null || { echo "lint: $tool is not there: make packages-dev"; exit 1; }
done
cd "$root" || exit 1
ls src/core/*.c src/*.c src/ros/*.c src/*/*.cpp test/node/fake_ros.c test/ros/flood.cpp | grep -vE 'kernel|solve_ladder\.c' |
    xargs -P "$(nproc)" -n 8 clang-tidy -p "$build" --quiet 2> /dev/null || status=1
cppcheck -j "$(nproc)" --enable=warning,portability --std=c11 --quiet --error-exitcode=1 --inline-suppr \
    --suppressions-list=.cppcheck --template='{file}:{line}: {severity}: {message} [{id}]' -Iinclude -Isrc/core -Isrc/ros \
    src/core src/*.c src/ros/*.c || status=1
catkin_lint -W2 --strict --ignore package_path_name . || status=1 # a clone may have any name
[ $status = 0 ] && echo "lint: nothing to say"
exit $status
