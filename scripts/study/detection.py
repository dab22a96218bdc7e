"""Collision detection against the number of triangles: build, refit and query of the AABB tree, by
`catnav study detection`."""
import csv
import subprocess

import numpy

COSTS = ("build_ms", "refit_ms", "query_ms")
LAWS = {"build_ms": "n log n", "refit_ms": "n", "query_ms": "n"}


def run(study):
    words = ["study", "detection", "100000" if study.quick else "1000000"]
    done = subprocess.run([study.catnav] + words, capture_output=True, text=True, timeout=300)
    if done.returncode:
        study.note("Collision detection is left out: %s" % done.stderr.strip())
        return []
    rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(done.stdout.splitlines())]
    n = numpy.array([row["triangles"] for row in rows])
    for key in COSTS:  # exponent of the cost over what its law has besides n
        over = numpy.log(n) if LAWS[key] == "n log n" else numpy.ones_like(n)
        slope = float(numpy.polyfit(numpy.log(n), numpy.log([row[key] for row in rows] / over), 1)[0])
        for row in rows:
            row["exponent_" + key[:-3]] = slope
    for row in rows:
        row["command"] = "catnav " + " ".join(words)
    study.table("detection", rows)
    study.say("detection: up to %.0f triangles" % n[-1])
    return rows
