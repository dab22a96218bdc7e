#!/usr/bin/python3
"""The oracle (test/oracle): it sees what it must, and agrees with the report. argv[1] or CATNAV is the command."""
import os
import subprocess
import tempfile
import unittest

from oracle_runs import DATA, ORACLE, judged, read_scene

SCENES = os.path.join(DATA, "scenes")


@unittest.skipUnless(os.access(ORACLE, os.X_OK), "the oracle is not built")
class Oracle(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def run_scene(self, name, *settings):
        file = os.path.join(SCENES, name)
        return judged(self.folder, file, read_scene(file), *settings)

    def test_it_tells_crossing_from_free_to_the_last_rounding(self):
        done = subprocess.run([ORACLE, "--self-test"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_it_counts_what_the_report_counts_where_nothing_holds_the_catheter_back(self):
        run = self.run_scene("control_bend.yaml", "contact.method=none")
        self.assertEqual(run.frames, run.report["steps"] + 1)
        self.assertGreater(run.crossings, 1000)
        self.assertEqual(run.crossings, run.report["contact"]["intersections"])
        self.assertGreater(run.outside, 100)
        self.assertEqual(run.outside, run.report["contact"]["outside_nodes"])

    def test_strict_contact_leaves_nothing_crossing_or_outside_in_the_same_bend(self):
        for model in "tet4", "rod":
            run = self.run_scene("control_bend.yaml", "bodies.0.model=" + model)
            self.assertEqual(run.frames, run.report["steps"] + 1)
            self.assertGreater(run.report["contact"]["force_max"], 0)
            self.assertEqual((run.crossings, run.outside), (0, 0), run.places)
            self.assertEqual(run.report["contact"]["intersections"] + run.report["contact"]["outside_nodes"], 0)

    def test_frames_that_are_cut_off_are_refused(self):
        self.run_scene("control_run.yaml")
        frames = os.path.join(self.folder, "frames")
        os.truncate(os.path.join(frames, "wire_3.vtu"), 900)
        done = subprocess.run([ORACLE, frames], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("wire_3.vtu", done.stderr)


if __name__ == "__main__":
    unittest.main()
