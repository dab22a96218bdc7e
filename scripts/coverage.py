#!/usr/bin/python3
"""coverage.py BUILD SOURCE: line and branch coverage of SOURCE/src/core by what has run in BUILD (built with --coverage).

Prints a line a file, worst first, and the lines never run of those below the bars; ends with 1 below 95 % of lines or 85 %
of branches of the core as a whole. A kernel that is compiled for several instruction sets counts once: a line or
branch is covered where any copy of it ran."""
import glob
import json
import os
import subprocess
import sys

LINES, BRANCHES = 0.95, 0.85


def counts(build, source):
    """{file: ({line: runs}, {(line, branch): runs})}"""
    files = {}
    for data in sorted(glob.glob(os.path.join(build, '**', '*.gcda'), recursive=True)):
        out = subprocess.run(['gcov', '--json-format', '--stdout', '--branch-probabilities', data], cwd=build,
                             capture_output=True, text=True, check=True).stdout
        for one in out.splitlines():
            for file in json.loads(one)['files']:
                path = os.path.relpath(os.path.join(build, file['file']), source)
                if not path.startswith('src/core/'):
                    continue
                lines, branches = files.setdefault(path, ({}, {}))
                for line in file['lines']:
                    number = line['line_number']
                    lines[number] = lines.get(number, 0) + line['count']
                    for i, branch in enumerate(line['branches']):
                        if not branch['throw']:
                            branches[number, i] = branches.get((number, i), 0) + branch['count']
    return files


def share(runs):
    return sum(1 for n in runs.values() if n) / len(runs) if runs else 1


def ranges(numbers):
    """1 2 3 7 -> '1-3 7'"""
    text, start = [], None
    for n in numbers:
        if start is not None and n == last + 1:
            last = n
            continue
        if start is not None:
            text.append(f'{start}-{last}' if last > start else f'{start}')
        start = last = n
    if start is not None:
        text.append(f'{start}-{last}' if last > start else f'{start}')
    return ' '.join(text)


def main(build, source):
    files = counts(os.path.abspath(build), os.path.abspath(source))
    if not files:
        sys.exit('nothing has run: build with --coverage and run the tests first')
    for path, (lines, branches) in sorted(files.items(), key=lambda f: share(f[1][0])):
        print(f'{path:40} lines {100 * share(lines):5.1f} % of {len(lines):5}  branches {100 * share(branches):5.1f} % of {len(branches):5}')
        missed = sorted(n for n, runs in lines.items() if not runs)
        if share(lines) < LINES and missed:
            print(f'    never run: {ranges(missed)}')
    lines = {(p, n): r for p, f in files.items() for n, r in f[0].items()}
    branches = {(p, n): r for p, f in files.items() for n, r in f[1].items()}
    print(f'core: lines {100 * share(lines):.2f} % of {len(lines)}, branches {100 * share(branches):.2f} % of {len(branches)}')
    return share(lines) >= LINES and share(branches) >= BRANCHES


if __name__ == '__main__':
    sys.exit(0 if main(*sys.argv[1:3]) else 1)
