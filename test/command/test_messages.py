#!/usr/bin/python3
"""What ROS users read: every field of a message says what it is, a number its unit; the table of the node's own parameters is
the node's list."""
import glob
import os
import re
import sys
import unittest

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
sys.path.insert(0, os.path.join(ROOT, "scripts", "ros"))
from options import OWN  # noqa: E402

UNIT = re.compile(r"\[[^]]+\]|\bunit\b")
COUNTED = re.compile(r"\[count\]|\bind(ex|ices)\b|\bid\b|one of the above|random choice|refers to it")


class Messages(unittest.TestCase):
    def test_every_field_says_what_it_is_and_a_number_its_unit(self):
        files = [f for kind in ("msg", "srv", "action") for f in glob.glob(os.path.join(ROOT, kind, "*." + kind))]
        self.assertGreaterEqual(len(files), 9)
        for file in files:
            with open(file) as lines:
                for number, line in enumerate(lines, 1):
                    place = f"{os.path.basename(file)}:{number}: {line.rstrip()}"
                    field = re.match(r"(?P<type>[\w/]+(\[\])?) +(?P<name>\w+)(?P<constant>=\S+)? *(# *(?P<said>.*))?$", line)
                    if line.startswith("#") or line.strip() in ("", "---"):
                        continue
                    self.assertTrue(field, place)
                    if not field["constant"]:
                        self.assertTrue(field["said"], place)
                        if field["type"].startswith("float"):
                            self.assertRegex(field["said"], UNIT, place)
                        if re.match(r"u?int", field["type"]):
                            self.assertRegex(field["said"], COUNTED, place)

    def test_the_table_of_the_nodes_own_parameters_is_the_nodes_list(self):
        with open(os.path.join(ROOT, "src", "ros", "node.c")) as file:
            listed = re.search(r"own_params\[\] = \{(.*?)NULL\}", file.read(), re.S)[1]
        known = set(re.findall(r'"([^"]+)"', listed))
        told = {name.split("/")[0] + "." if "/" in name else name for name, *_ in OWN}
        self.assertEqual(known - {"settings."}, told)  # dynamic_reconfigure's own, in a table of its own


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
