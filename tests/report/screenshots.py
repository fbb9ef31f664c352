#!/usr/bin/env python3
"""Makes the pictures of docs/report.md.

    tests/report/screenshots.py VOLALIGN [FOLDER]     (FOLDER: for what is calculated, else a temporary one)

Calibrates four rendered sensors, the same with a blind one, and two that look at a row of equal cartons from both sides. Needs Chromium.
"""

import json
import os
import subprocess
import sys
import tempfile

import make_report
from browser import Browser

DOCS = os.path.join(make_report.ROOT, "docs")
ROW = "name: row\nboxes:\n" + "".join(f"  - {{name: b{i}, x: [{-900 + 300 * i}, {-600 + 300 * i}], y: [0, 400], z: [-200, 200]}}\n" for i in range(6))
SIDES = """sides: {front: +x, back: -x, up: +y, down: -y, right: +z, left: -z}
"""
TWO = """structure_yaw_deg: 0
room: true
noise: sensor
seed: 3
sensors:
  - {name: S1, sensor: azure_kinect_nfov_binned, rho_cm: 230, phi_deg: 70, height_cm: 130, roll_deg: 0, look_at_cm: [0, 20, 0]}
  - {name: S2, sensor: azure_kinect_nfov_binned, rho_cm: 240, phi_deg: 265, height_cm: 150, roll_deg: 0, look_at_cm: [0, 20, 0]}
"""


def calibrate(volalign, capture, output, *options):
    # From the folder beside the result, so that the pictures show no path of this machine.
    folder = os.path.dirname(output)
    os.makedirs(folder, exist_ok=True)
    paths = [os.path.relpath(path, folder) for path in (os.path.join(capture, "capture.json"), output)]
    run = subprocess.run([volalign, "calibrate", "--capture", paths[0], "-o", paths[1], *options], cwd=folder, stdout=subprocess.DEVNULL)
    if run.returncode not in (0, 2):
        sys.exit(f"calibrate ended with {run.returncode}")
    return "file://" + os.path.join(output, "report.html")


def render(volalign, rig, capture, *options):
    subprocess.run([volalign, "render", "--rig", rig, "-o", capture, *options], cwd=make_report.ROOT, check=True, stdout=subprocess.DEVNULL)


def shoot(browser, url, name, width, height=900, scale=1, mobile=False, paper=False, **part):
    """Of the window of that size, or of another `part` (Page.screenshot)."""
    page = browser.open(url, width=width, height=height, mobile=mobile, scale=scale)
    if paper:
        page.send("Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "light"}])
    page.evaluate("document.querySelectorAll('img').forEach((image) => { image.loading = 'eager'; })")
    page.wait("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    page.settle()
    path = os.path.join(DOCS, name)
    with open(path, "wb") as file:
        file.write(page.screenshot(**part))
    page.close()
    if os.path.getsize(path) > 600_000:
        sys.exit(f"{path} has {os.path.getsize(path)} bytes; 600,000 are the most")


def main(volalign, folder):
    ok, row = os.path.join(folder, "four"), os.path.join(folder, "row")
    model = ("--model", "models/m05-lite.safetensors")
    render(volalign, "configs/rig_ring4.yaml", ok)
    whole = calibrate(volalign, ok, os.path.join(folder, "four_calibration"), *model)
    make_report.main(volalign, os.path.join(folder, "blind"), "S4's lens was covered; S2 stands on the new tripod")
    failed = "file://" + os.path.join(folder, "blind", "calibration", "report.html")
    os.makedirs(folder, exist_ok=True)
    for name, text in (("row.yaml", ROW + SIDES), ("two.yaml", TWO)):
        with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
            file.write(text)
    structure = os.path.join(folder, "row.yaml")
    render(volalign, os.path.join(folder, "two.yaml"), row, "--set", f"structure={structure}")
    alternative = calibrate(volalign, row, os.path.join(folder, "row_calibration"), "--structure", structure)
    with open(os.path.join(folder, "row_calibration", "extrinsics.json"), encoding="utf-8") as file:
        assert json.load(file)["twins"], "the row looks alike from both sides"
    with Browser() as browser:
        shoot(browser, whole, "report.png", 1100, until="#rig")
        shoot(browser, whole, "report_whole.jpg", 1100, scale=0.8, whole=True, format="jpeg", quality=60)
        shoot(browser, failed, "report_failed.png", 1200, until="#sensors")
        shoot(browser, whole, "report_phone.png", 390, 1500, mobile=True)
        shoot(browser, whole, "report_print.png", 700, 990, paper=True)
        shoot(browser, alternative, "report_twin.png", 1000, selector="#alternatives")


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(*(os.path.abspath(path) for path in sys.argv[1:3]))
    else:
        with tempfile.TemporaryDirectory() as work:
            main(os.path.abspath(sys.argv[1]), work)
