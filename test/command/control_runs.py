"""Runs of the command for the control tests: report, exit status, frames. argv[1] or CATNAV is the command."""
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import unittest

CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))
HERE = os.path.dirname(os.path.abspath(__file__))
DATA = os.path.abspath(os.environ.get("CATNAV_TEST_DATA", os.path.join(HERE, "..", "data")))
DEMO = os.path.join(HERE, "..", "..", "launch", "scenes", "liver.yaml")
LEG = os.path.join(DATA, "vessels", "bp3d", "bp3d_leg_to_liver_merged.stl")


def scene(name):
    return os.path.join(DATA, "scenes", "control_%s.yaml" % name)


def array(folder, piece, name):
    """A Float64 array of a .vtu piece (raw appended, 8-byte header), as a list of numbers."""
    with open(os.path.join(folder, piece), "rb") as file:
        data = file.read()
    head, body = data.split(b'<AppendedData encoding="raw">', 1)
    offset = int(re.search(rb'Name="%s"[^>]*offset="(\d+)"' % name.encode(), head).group(1))
    start = body.index(b"_") + 1 + offset
    size = struct.unpack_from("<Q", body, start)[0]
    return struct.unpack_from("<%dd" % (size // 8), body, start + 8)


def points(folder, piece):
    flat = array(folder, piece, "Points")
    return list(zip(flat[::3], flat[1::3], flat[2::3]))


def distance(a, b):
    return sum((p - q) ** 2 for p, q in zip(a, b)) ** 0.5


def steps(folder):
    """Step numbers of the catheter's frames, ascending."""
    return sorted(int(f[len("catheter_"):-len(".vtu")]) for f in os.listdir(folder) if f.endswith(".vtu"))


def crop(path, below):
    """Writes the triangles of the demo vessel's binary STL that lie below z [mm]."""
    with open(LEG, "rb") as file:
        data = file.read()
    kept = [data[i:i + 50] for i in range(84, len(data) - 49, 50)
            if max(struct.unpack_from("<12f", data, i)[5::3]) < below]
    with open(path, "wb") as file:
        file.write(data[:80] + struct.pack("<I", len(kept)) + b"".join(kept))


class Runs(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def command(self, file, *settings, frames=None, threads=1):
        words = [CATNAV, "run", file, "--quiet", "--report", self.path("report.json"), "--threads", str(threads)]
        for setting in settings:
            words += ["--set", setting]
        if frames:
            words += ["--frames", self.path(frames)]
        return subprocess.run(words, capture_output=True, text=True, timeout=120)

    def run_it(self, file, *settings, status=None, **others):
        """The report of a run; `settings` are KEY=VALUE. The exit status, if given, must be `status`."""
        done = self.command(file, *settings, **others)
        if status is not None:
            self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        with open(self.path("report.json")) as written:
            report = json.load(written, parse_constant=lambda word: self.fail("not JSON: " + word))
        os.unlink(self.path("report.json"))
        report["exit"] = done.returncode
        return report

    def needs_the_demo_vessel(self):
        if not os.path.exists(LEG):
            self.skipTest("no demo vessel")

    def leg(self):
        """Setting for the first part of the demo's vessel, cut off to save time."""
        self.needs_the_demo_vessel()
        crop(self.path("leg.stl"), 880)
        return "vessels.artery.surface.file=" + self.path("leg.stl")

    def never_in_the_wall(self, report):
        contact = report["contact"]
        self.assertEqual((contact["intersections"], contact["outside_nodes"]), (0, 0))
        if contact["gap_min"] is not None:
            self.assertGreater(contact["gap_min"], 0)
