#!/usr/bin/python3
"""Runs the command of docs/results.md again, whose numbers are the README's: as many sensors, medians and 95th percentiles within a tenth,
shares of the intervals within 3 of 100. From the root of the repository."""

import json
import re
import shutil
import statistics
import subprocess
import sys

import numpy

subprocess.run(["bash", "-c", "source cmake/packages.sh && build_preset release -DVOLALIGN_TESTS=ON volalign"], check=True)
page = open("docs/results.md", encoding="utf-8").read().split("## Rendered rigs\n")[1].split("### ")[0]
command = re.search(r"^    volalign (evaluate .*?) -o \S+$", page, re.DOTALL | re.MULTILINE)[1].replace("\\\n", " ").split()
shutil.rmtree("build/long/evaluation", ignore_errors=True)
subprocess.run(["build/release/cli/volalign", *command, "-o", "build/long/evaluation"], check=True)
evaluation = json.load(open("build/long/evaluation/evaluation.json"))
failed = False
for kind in ("azure_kinect_nfov_binned", "realsense_d415"):
    row = [cell.strip() for cell in re.search(rf"^\| {kind} \|.*$", page, re.MULTILINE)[0].strip("|").split("|")]
    median, p95, _ = map(float, row[6].split("/"))
    placed = int(row[1].split()[0])
    shares = [float(share) / 100 for share in row[8].split(",")]
    errors = [1000 * sensor["error"]["refined"]["translation_m"] for case in evaluation["cases"] if case["sensor_model"] == kind
              for sensor in case["sensors"] if "refined" in sensor.get("error", {})]
    rows = [row for row in evaluation["summary"] if row["sensor_model"] == kind]
    weight = sum(row["measured"] for row in rows)
    cover = [sum(row[key] * row["measured"] for row in rows) / weight for key in ("cover_68", "cover_95")]
    found = statistics.median(errors), numpy.percentile(errors, 95)
    print(f"{kind}: {found[0]:.1f} / {found[1]:.1f} mm, page {median} / {p95}; {cover[0]:.2f} and {cover[1]:.2f} of the intervals, page {shares}; "
          f"{len(errors)} sensors, page {placed}")
    failed |= len(errors) != placed or found[0] > 1.1 * median or found[1] > 1.1 * p95
    failed |= any(abs(share - said) > 0.03 for share, said in zip(cover, shares))
sys.exit(failed)
