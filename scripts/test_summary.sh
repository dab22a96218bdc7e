#!/bin/sh
# Reads the log of `ctest -V`, prints a line a test and the output of those that failed, counts cases (cmocka and
# rostest cases; any other test is one case) and ends with `N passed, N failed`; status 1 when anything failed.
awk '
{ line = $0 }
/^ *[0-9]+: / {
    k = $1 + 0
    sub(/^ *[0-9]+: ?/, "", line)
    text[k] = text[k] line "\n"
    gsub(/\033\[[0-9;]*m/, "", line)
    split(line, word, /[ ,]+/)
    if (line ~ /^\[  PASSED  \] [0-9]+ test/) passed[k] += word[4]
    if (line ~ /^\[  FAILED  \] [0-9]+ test/) failed[k] += word[4]
    if (line ~ /^ \* TESTS: /) cases[k] = word[4]
    if (line ~ /^ \* ERRORS: /) wrong[k] = word[4]
    if (line ~ /^ \* FAILURES: /) { failed[k] = wrong[k] + word[4]; passed[k] = cases[k] > failed[k] ? cases[k] - failed[k] : 0 }
}
/^ *[0-9]+\/[0-9]+ Test +#[0-9]+: / {
    print
    k = substr($0, index($0, "#") + 1) + 0
    ok = $0 ~ /   Passed  /
    if (!ok) print text[k]
    if (passed[k] + failed[k] == 0 && ok) passed[k] = 1
    if (failed[k] + 0 == 0 && !ok) failed[k] = 1
    all_passed += passed[k]
    all_failed += failed[k]
}
END {
    printf "%d passed, %d failed\n", all_passed, all_failed
    exit all_failed > 0 || all_passed == 0
}' "$1"
