#!/usr/bin/python3
"""catnav study DIR: error against run time, contact beside theory, stability, speed, and what was left out, measured: tables, pictures
and one index.md in a folder. The command `catnav study` starts it and says where it is itself."""
import argparse
import os
import sys
import time

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import accuracy
import contact
import detection
import left_out
import plots
import report
import skin
import soak
import speed
import stability
import theory
import tools

PARTS = ("accuracy", "theory", "contact", "stability", "speed", "detection", "left_out", "skin", "soak")
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def words():
    parser = argparse.ArgumentParser(prog="catnav study", description=__doc__)
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="the same on fewer and smaller cases, in a minute")
    parser.add_argument("--only", help=", ".join(PARTS) + ": this part alone")
    parser.add_argument("--every-cell", action="store_true", help="of the stability grid with every solver: an hour")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 2, help="of the timed runs")
    parser.add_argument("--catnav", default="catnav", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.only not in (None,) + PARTS:
        sys.exit("catnav study: --only takes one of %s, not %s" % (", ".join(PARTS), given.only))
    return given


def main():
    given = words()
    try:
        study = tools.Study(given.folder, os.path.abspath(given.catnav), given.quick, given.threads,
                            ROOT, given.every_cell)
    except OSError as error:
        print("catnav study: %s" % error, file=sys.stderr)
        return 1
    parts, run = {}, {"accuracy": accuracy.run, "theory": theory.run, "contact": contact.run,
                      "stability": stability.run, "speed": speed.run, "detection": detection.run,
                      "left_out": left_out.run, "skin": skin.run, "soak": soak.run}
    for name in PARTS:
        if given.only in (None, name):
            begun = time.monotonic()
            parts[name] = run[name](study)
            study.took[name] = time.monotonic() - begun
            plots.draw(study, name, parts[name])
            report.write(study, parts)
    study.say("%s/index.md" % given.folder)
    failed = [row for row in parts.get("stability", []) if row["result"] in stability.FAILURES]
    failed += [row for row in parts.get("contact", ([], []))[1] if row["result"] in contact.FAILURES]
    return 4 if failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
