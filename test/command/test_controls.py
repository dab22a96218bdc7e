#!/usr/bin/python3
"""Controls: the catheter does the work and not the drive; the same command gives the same bytes; doors say why;
a limit between two ways decides between them."""
import math
import os
import re
import unittest

from control_runs import DEMO, Runs, array, distance, points, scene, steps

BEND = scene("bend")
FORK = scene("fork")
ON_THE_WALL = "bodies.0.waypoints=[[0.005994, 0, 0.044004], [0.045, 0, 0.05395]]"  # outer side of the bend


class Work(Runs):
    """The wall holds the catheter back, and the drive's figures are those that bending explains."""

    def against_the_wall(self, file, *settings):
        free = self.run_it(file, *settings, "contact.method=none")
        self.assertGreater(free["contact"]["intersections"], 0)
        self.assertGreater(free["contact"]["outside_nodes"], 0)
        self.assertLess(free["contact"]["gap_min"], 0)
        self.assertEqual(free["contact"]["force_max"], 0)
        held = self.run_it(file, *settings, "contact.method=strict")
        self.never_in_the_wall(held)
        self.assertGreater(held["contact"]["force_max"], 0)
        self.assertGreater(distance(free["bodies"][0]["tip"], held["bodies"][0]["tip"]), 0)
        self.explained(held)
        return held

    def explained(self, report):
        """Nothing is lost but to damping: work >= energy stored, and pushing slowly wastes no more than it stores
        tenfold. The residual is computed anew from the forces of the accepted states."""
        energy, work = report["bodies"][0]["energy"], report["drive"]["work"]
        self.assertGreaterEqual(work, 0.99 * energy)
        self.assertLessEqual(work, 10 * energy)
        self.assertGreater(report["solver"]["residual_max"], 0)
        self.assertLessEqual(report["solver"]["residual_max"], 10 * 1e-3)

    def test_waypoints_on_the_wall_of_a_bend_are_held_off_by_contact_alone(self):
        held = self.against_the_wall(BEND, ON_THE_WALL, "bodies.0.waypoint_tolerance=2e-3", "time_limit=10")
        self.assertEqual(held["status"], "reached")  # the tip lies on the wall, its axis a radius off

    def test_waypoints_on_the_wall_of_a_real_vessel_are_held_off_by_contact_alone(self):
        self.against_the_wall(scene("leg"), self.leg())

    def test_force_and_energy_are_those_of_a_bent_rod(self):
        # A rod EI bent to 1 / R over the quarter L = pi R / 2 holds U = EI L / 2 R^2 and is held there by forces
        # of order F = EI / R^2. In a tube of play c = 3 mm it may take a radius of up to R + 2 c / (sqrt 2 - 1) =
        # 44 mm and has its ends out of the bend: U / 3 to 3 U. F adds all nodes: within ten. EI as meshed.
        report = self.run_it(BEND)
        radius, young, diameter = 0.03, 1e7, 2e-3
        bending = (1 + report["bodies"][0]["stiffness_error"]["bending"]) * young * math.pi * diameter ** 4 / 64
        energy = 0.5 * bending * math.pi / 2 / radius
        self.assertGreater(report["bodies"][0]["energy"], energy / 3)
        self.assertLess(report["bodies"][0]["energy"], 3 * energy)
        for force in (report["drive"]["force_max"], report["contact"]["force_max"]):
            self.assertGreater(force, 0.1 * bending / radius ** 2)
            self.assertLess(force, 10 * bending / radius ** 2)
        self.explained(report)

    def test_a_stiffer_catheter_presses_harder_and_a_soft_one_lies_otherwise(self):
        # Shapes are compared in the plane of the bend while the tip is in it: along the round wall, out of that
        # plane, a tip slides at no cost.
        shapes, reports = [], []
        for name, young in (("soft", 1e5), ("plain", 1e7), ("stiff", 1e9)):
            reports.append(self.run_it(BEND, "bodies.0.material.young=%g" % young, frames=name))
            self.never_in_the_wall(reports[-1])
            shapes.append([(x, z) for x, _, z in points(self.path(name), "catheter_50.vtu")])
        soft, plain, stiff = ([r["contact"]["force_max"], r["drive"]["force_max"], r["limits"][0]["worst"],
                               r["bodies"][0]["energy"]] for r in reports)
        for a, b, c in zip(soft, plain, stiff):
            self.assertLess(10 * a, b)
            self.assertLess(10 * b, c)
        self.assertGreater(max(map(distance, shapes[0], shapes[1])), 0.05 * 2e-3)  # of the diameter

    def test_a_tighter_tolerance_gives_a_smaller_residual(self):
        loose, tight = (self.run_it(BEND, "solver.tolerance=%g" % t) for t in (1e-2, 1e-4))
        self.assertLessEqual(loose["solver"]["residual_max"], 10 * 1e-2)
        self.assertLessEqual(tight["solver"]["residual_max"], 10 * 1e-4)
        self.assertLess(tight["solver"]["residual_max"], loose["solver"]["residual_max"])

    def test_a_stiffer_catheter_lies_otherwise(self):
        shapes = []
        for name, young in (("plain", 1e7), ("stiff", 1e9)):
            self.run_it(BEND, "bodies.0.material.young=%g" % young, "time_limit=1", frames=name)
            shapes.append([(x, z) for x, _, z in points(self.path(name), "catheter_50.vtu")])
        self.assertGreater(max(map(distance, *shapes)), 0.05 * 2e-3)

    def test_a_fine_tolerance_is_kept(self):
        report = self.run_it(BEND, "solver.tolerance=1e-6")
        self.assertLessEqual(report["solver"]["residual_max"], 10 * 1e-6)


class Same(Runs):
    """The same bytes, whatever the thread count and however often."""

    def test_looking_at_a_run_does_not_change_it(self):
        # stress for the frames once refined the elements' rotations in the run's own state
        plain, watched = self.run_it(BEND), self.run_it(BEND, frames="watched")
        for part in ("steps", "contact", "drive", "limits", "bodies"):
            self.assertEqual(plain[part], watched[part])

    def same(self, file, *settings, threads):
        seen = []
        for i, n in enumerate(threads):
            report = self.run_it(file, *settings, frames="f%d" % i, threads=n)
            for varies in ("time", "memory_peak_bytes", "threads", "left_out"):
                report.pop(varies)
            folder, pieces = self.path("f%d" % i), {}
            for name in os.listdir(folder):
                with open(os.path.join(folder, name), "rb") as piece:
                    pieces[name] = piece.read()
            self.assertTrue(report["reproducible"])
            seen.append((report, pieces))
        for report, pieces in seen[1:]:
            self.assertEqual(report, seen[0][0])
            self.assertEqual(sorted(pieces), sorted(seen[0][1]))
            self.assertEqual([name for name in pieces if pieces[name] != seen[0][1][name]], [])
        return seen[0]

    def test_a_bend_with_contact(self):
        report, pieces = self.same(BEND, "time_limit=1.2", threads=(1, 1, 2))
        self.assertGreater(report["contact"]["force_max"], 0)
        self.assertIn("frames.pvd", pieces)
        self.assertEqual(sum(name.startswith("catheter_") for name in pieces), 60 + 1)  # one a step, and the start

    def test_a_bend_with_contact_by_the_other_models(self):
        tip = {}
        for model in ("rod", "tet10"):
            report, _ = self.same(BEND, "bodies.0.model=" + model, "time_limit=0.8", threads=(1, 2))
            self.never_in_the_wall(report)
            self.assertGreater(report["contact"]["force_max"], 0)
            tip[model] = report["bodies"][0]["tip"]
        # both bend as beam theory says; what linear tetrahedra make of it lies half a millimetre off
        self.assertLess(distance(tip["rod"], tip["tet10"]), 5e-5)

    def test_the_demo(self):
        self.needs_the_demo_vessel()
        self.same(DEMO, "time_limit=3", threads=(1, 2))

    def test_replans(self):
        limit = "bodies.0.limits=[{quantity: stress, limit: 1e4}]"
        report, _ = self.same(FORK, limit, "planner.replans=3", threads=(1, 2))
        self.assertGreater(report["replans"], 0)


class Doors(Runs):
    """What is refused, with which code, and in which words."""

    def refused(self, file, code, exit_status, *settings, words=()):
        report = self.run_it(file, *settings, status=exit_status)
        verdict = report["verdict"]
        self.assertEqual(verdict["code"], code, verdict["message"])
        for word in words:
            self.assertIn(word, verdict["message"])
        return report

    def test_a_start_in_the_wall_is_named_with_pair_depth_and_place(self):
        report = self.refused(BEND, "NO_CONTACT_FREE_START", 2, "bodies.0.waypoints=[]",
                              "bodies.0.shape.catheter.entry=[0, 0.0035, 0]", words=("artery", "triangle", "deep"))
        self.assertEqual(report["status"], "infeasible")
        self.assertEqual(report["verdict"]["body"], "catheter")
        self.assertLess(distance(report["verdict"]["position"], (0, 0.004, 0)), 3e-3)  # the wall, within a device
        self.assertEqual(report["steps"], 0)

    def test_an_entry_and_a_waypoint_outside_are_refused(self):
        self.refused(BEND, "BAD_INPUT", 1, "bodies.0.shape.catheter.entry=[0, 0.0065, 0]", words=("entry", "outside"))
        self.refused(BEND, "BAD_INPUT", 1, "bodies.0.waypoints=[[0.03, 0, 0.05], [0.045, 0, 0.055]]",
                     words=("waypoint 1", "outside"))

    def test_a_waypoint_that_is_no_number_is_refused_by_the_reader(self):
        for word in ("nan", ".nan", ".inf", "1e999"):
            done = self.command(BEND, "bodies.0.waypoints=[[0.045, 0, %s]]" % word)
            self.assertEqual(done.returncode, 1)
            self.assertIn("waypoints", done.stderr)
            self.assertIn(word, done.stderr)

    def test_a_mesh_in_the_wrong_unit_is_told_by_its_ratio_to_the_device(self):
        for scale, words in ((1, ("metres", "too much for a map")), (1e-6, ("0.5 to 200",))):
            self.refused(FORK, "BAD_INPUT", 1, "vessels.0.surface.scale=%g" % scale, words=words + ("scale",))

    def test_an_impossible_limit_ends_with_what_broke_it_and_where(self):
        report = self.refused(FORK, "LIMIT_BROKEN", 2, "bodies.0.limits=[{quantity: stress, limit: 1}]",
                              "planner.replans=2")
        verdict = report["verdict"]
        self.assertEqual((report["status"], verdict["quantity"], verdict["limit"], verdict["body"]),
                         ("infeasible", "stress", 1, "catheter"))
        self.assertGreater(verdict["value"], 1)
        self.assertGreaterEqual(verdict["element"], 0)
        self.assertLess(distance(verdict["position"], (0, 0, 0.005)), 0.02)
        self.assertLessEqual(report["limits"][0]["worst"] or 0, 1)

    def test_too_little_time_is_a_timeout_and_no_waypoint_is_a_run(self):
        report = self.refused(BEND, "TIMEOUT", 3, "time_limit=0.5")
        self.assertEqual((report["status"], report["steps"]), ("time_limit", 25))
        report = self.refused(BEND, "RAN", 0, "bodies.0.waypoints=[]", "time_limit=0.5")
        self.assertEqual((report["status"], report["steps"]), ("ran", 25))

    def test_a_wall_turns_once_a_triangle_has_turned_by_a_tenth(self):
        wall = "{model: membrane, thickness: 1e-4, young: 1e5, poisson: 0.4, density: 1000, foundation: %g}"
        tip, entry = {}, {}
        for foundation in (1e6, 1e9):
            for how in ("auto", "off"):
                report = self.run_it(BEND, "vessels.0.wall=" + wall % foundation, "bodies.0.model=rod", "time_limit=2",
                                     "leave_out.wall_solve=" + how)
                self.assertEqual(report["contact"]["intersections"], 0)
                tip[foundation, how] = report["bodies"][0]["tip"]
                entry[foundation, how] = [e for e in report["left_out"] if e["what"] == "wall_solve"]
        soft, firm = entry[1e6, "auto"][0], entry[1e9, "auto"][0]
        self.assertRegex(soft["why"], "the turning of walls .* until step [1-9]")
        self.assertAlmostEqual(soft["error"], 0.005)
        self.assertIn("factored once", firm["why"])
        self.assertLess(firm["error"], 0.005)
        for foundation in (1e6, 1e9):  # nothing is left out where it is asked for
            self.assertEqual(entry[foundation, "off"], [])
            apart = distance(tip[foundation, "auto"], tip[foundation, "off"])
            self.assertLess(apart, entry[foundation, "auto"][0]["error"] * 0.06)

    def test_what_is_not_available_is_said_in_words(self):
        wall = "{model: %s, thickness: 1e-4, young: 1e5, poisson: 0.4, density: 1000, foundation: 1e6}"
        rock = "obstacles=[{name: rock, shape: {sphere: {centre: [0, 0, 1], radius: 0.01}}, path: [[0, 0, 1]]}]"
        for setting, word in (("contact.friction=0.1", "friction"), ("contact.method=penalty", "penalty"),
                              ("contact.self=on", "self"), ("bodies.0.drive.mode=push", "push"), (rock, "rock"),
                              ("bodies.0.model=rod", "model"), ("bodies.0.model=tet10", "model"),
                              ("vessels.0.wall=" + wall % "membrane", "artery"),
                              ("vessels.0.wall=" + wall % "shell", "artery")):
            report = self.run_it(BEND, setting, "time_limit=0.2")
            if report["verdict"]["code"] == "BAD_INPUT":
                self.assertEqual(report["exit"], 1)
                self.assertIn(word, report["verdict"]["message"])
                self.assertRegex(report["verdict"]["message"], "not available in this version: (use|leave|run) ")
                self.assertEqual(report["steps"], 0)

    def test_a_start_in_the_wall_with_a_way_to_plan(self):
        report = self.run_it(BEND, "bodies.0.shape.catheter.entry=[0, 0.0035, 0]", status=2)
        self.assertEqual(report["verdict"]["code"], "NO_CONTACT_FREE_START", report["verdict"]["message"])

    def test_an_entry_outside_by_less_than_a_device(self):
        verdict = self.run_it(BEND, "bodies.0.shape.catheter.entry=[0, 0.0055, 0]")["verdict"]
        self.assertIn(verdict["code"], ("BAD_INPUT", "NO_CONTACT_FREE_START"), verdict["message"])

    def test_a_start_in_the_wall_reports_its_depth(self):
        verdict = self.run_it(BEND, "bodies.0.waypoints=[]", "bodies.0.shape.catheter.entry=[0, 0.0035, 0]")["verdict"]
        self.assertIsNotNone(verdict["value"])


class Fork(Runs):
    """A short arm with a tight corner and a long wide one: the limit decides."""

    measured = None

    def arm(self, folder):
        """Least and largest x of the goal node over all frames [m]: the wide arm lies at -30 mm, the tight at 17."""
        x = [points(self.path(folder), "catheter_%d.vtu" % i)[0][0] for i in steps(self.path(folder))]
        return min(x), max(x)

    def by_the_tight_arm(self):
        tight = self.run_it(FORK, frames="tight", status=0)
        low, high = self.arm("tight")
        self.assertGreater(high, 0.01)
        self.assertGreater(low, -0.005)
        return tight

    def peaks(self):
        """Largest stresses [Pa] by the tight arm, which is planned first, and by the wide one; measured once."""
        if Fork.measured:
            return Fork.measured
        wide = self.run_it(FORK, "bodies.0.waypoints=[[-0.03, 0, 0.08], [0, 0, 0.155]]", frames="wide", status=0)
        low, high = self.arm("wide")
        self.assertLess(low, -0.025)
        self.assertLess(high, 0.005)
        found = []
        for report in (self.by_the_tight_arm(), wide):
            self.assertEqual((report["status"], report["replans"]), ("reached", 0))
            self.never_in_the_wall(report)
            found.append(report["limits"][0]["worst"])
        self.assertGreater(found[0], 1.5 * found[1])  # a corner against a bow
        Fork.measured = found
        return found

    def test_the_arms_differ_and_a_limit_below_both_is_broken(self):
        tight, wide = self.peaks()
        limit = 0.2 * wide
        report = self.run_it(FORK, "bodies.0.limits.0.limit=%.17g" % limit, frames="none", status=2)
        verdict = report["verdict"]
        self.assertEqual((report["status"], verdict["code"], verdict["quantity"]),
                         ("infeasible", "LIMIT_BROKEN", "stress"))
        self.assertEqual(verdict["limit"], limit)
        self.assertGreater(verdict["value"], limit)
        self.assertGreater(report["rejected_steps"], report["replans"])
        self.kept(report, "none")
        # what is left is the last state that kept every limit, one step before the one refused
        left = points(self.path("none"), "catheter_%d.vtu" % (verdict["step"] - 1))
        self.assertEqual(left[0], tuple(report["bodies"][0]["tip"]))

    def test_a_limit_between_the_arms_rejects_the_first_and_arrives_by_the_other(self):
        limit = sum(self.peaks()) / 2
        report = self.run_it(FORK, "bodies.0.limits.0.limit=%.17g" % limit, frames="other", status=0)
        self.assertEqual((report["status"], report["verdict"]["code"]), ("reached", "REACHED"))
        self.assertGreaterEqual(report["replans"], 1)
        self.assertGreaterEqual(report["rejected_steps"], 1)
        self.kept(report, "other")
        nodes = points(self.path("other"), "catheter_%d.vtu" % report["verdict"]["step"])
        self.assertLess(min(x for x, _, _ in nodes), -0.025)  # it lies in the wide arm
        self.assertLess(max(x for x, _, _ in nodes), 0.005)

    def test_the_one_way_there_is_is_not_tried_again_and_again(self):
        report = self.run_it(BEND, ON_THE_WALL, "time_limit=20", "planner.replans=20", status=2)  # axis a radius off
        self.assertEqual((report["verdict"]["code"], report["verdict"]["quantity"]), ("LIMIT_BROKEN", "progress"))
        self.assertLessEqual(report["replans"], 3)

    def kept(self, report, folder):
        """No accepted state broke a limit: neither by the report nor by the frames' own stress."""
        for limit in report["limits"]:
            if limit["quantity"] == "clearance":
                self.assertGreaterEqual(limit["worst"], limit["limit"])
            else:
                self.assertLessEqual(limit["worst"], limit["limit"])
        self.never_in_the_wall(report)
        stress = [max(array(self.path(folder), "catheter_%d.vtu" % i, "stress")) for i in steps(self.path(folder))]
        self.assertLessEqual(max(stress), report["limits"][0]["limit"])

    def test_the_index_of_frames_forgets_what_was_rolled_back(self):
        self.command(FORK, "bodies.0.limits=[{quantity: stress, limit: 1e4}]", "planner.replans=2", frames="f")
        with open(os.path.join(self.path("f"), "frames.pvd")) as file:
            rows = re.findall(r'timestep="([^"]*)"[^>]*file="(catheter[^"]*)"', file.read())
        times = [float(time) for time, _ in rows]
        self.assertEqual(times, sorted(set(times)))
        self.assertEqual(len(rows), len(set(name for _, name in rows)))
        self.assertEqual(rows[-1][1], "catheter_%d.vtu" % steps(self.path("f"))[-1])


if __name__ == "__main__":
    unittest.main()
