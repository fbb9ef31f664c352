#!/usr/bin/env python3
"""Prints the share of lines that ran, by module: tests/long/coverage_table.py LINES.json (of `llvm-cov export -summary-only`)"""

import collections
import json
import os
import sys

lines, ran = collections.Counter(), collections.Counter()
for entry in json.load(open(sys.argv[1]))["data"][0]["files"]:
    module = os.path.dirname(os.path.relpath(entry["filename"]))
    for name in {module, module.split("/")[0]}:
        lines[name] += entry["summary"]["lines"]["count"]
        ran[name] += entry["summary"]["lines"]["covered"]
for name in sorted(lines):
    if name.split("/")[0] in ("core", "render", "train", "infer"):
        print(f"{name:24} {100 * ran[name] / lines[name]:5.1f} % of {lines[name]} lines")
