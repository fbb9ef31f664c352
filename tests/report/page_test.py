#!/usr/bin/env python3
"""Does report.html show what it says, in a browser?

    tests/report/page_test.py FOLDER     (of make_report.py)

Needs Chromium and Selenium (Debian packages chromium-driver and python3-selenium; WebGL is drawn by a software renderer).
"""

import contextlib
import copy
import json
import math
import os
import sys
import unittest

import numpy as np
from selenium.webdriver.common.keys import Keys

from browser import Browser
from make_report import NOTE

FOLDER = os.path.join(os.path.abspath(sys.argv.pop(1)), "calibration")
PLACED = ["S1", "S2", "S3"]
LAYERS = ["points", "surroundings", "stack", "sensors", "names", "ellipsoids", "axes", "floor"]
PAYLOAD = '<script type="application/json" id="payload">'


def url(name="report.html"):
    return "file://" + os.path.join(FOLDER, name)


def payload_of(page):
    begin = page.index(PAYLOAD) + len(PAYLOAD)
    return json.loads(page[begin:page.index("</script>", begin)])


def read(name):
    with open(os.path.join(FOLDER, name), encoding="utf-8") as file:
        return file.read()


def least_known_deg(covariance):
    """By the largest eigenvalue of the rotation's part."""
    return math.degrees(np.linalg.eigvalsh(np.array(covariance)[3:, 3:]).max() ** 0.5)


class ReportPage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = Browser()
        cls.report = payload_of(read("report.html"))
        cls.page = cls.browser.open(url(), width=1280, height=900)
        cls.page.settle()

    @classmethod
    def tearDownClass(cls):
        complaints = cls.page.complaints()
        cls.browser.__exit__()
        assert not complaints, complaints

    def state(self):
        self.page.settle()
        return self.page.evaluate("volalignReport()")

    def click(self, value):
        self.page.evaluate(f"document.querySelector('#controls input[value=\"{value}\"]').click()")
        return self.state()

    def text(self, selector):
        return self.page.evaluate(f"document.querySelector('{selector}').innerText")

    def test_view_shows_every_point_and_placed_sensor(self):
        state = self.state()
        frames = self.report["stills"][0]["frames"]
        self.assertEqual(state["points"], sum(frame["cloud"]["count"] for frame in frames if "cloud" in frame))
        self.assertGreater(state["points"], 20000)
        self.assertEqual(state["sensors"], PLACED)
        self.assertEqual((state["stacks"], state["ellipsoids"], state["mode"]), (1, 0, "sensor"))

    def test_every_toggle_changes_the_picture_and_back(self):
        before = self.page.screenshot("#view")
        for value in LAYERS + PLACED:
            self.click(value)
            self.assertNotEqual(self.page.screenshot("#view"), before, value)
            self.click(value)
            self.assertEqual(self.page.screenshot("#view"), before, value)

    def test_toggles_hide_what_they_name(self):
        whole = self.state()
        self.assertLess(self.click("surroundings")["points"], whole["points"])
        self.assertEqual(self.click("points")["points"], 0)
        self.click("points"), self.click("surroundings")
        self.assertEqual(self.click("stack")["stacks"], 0)
        self.assertEqual(self.click("ellipsoids")["ellipsoids"], 3)
        self.assertEqual(self.click("S2")["sensors"], ["S1", "S3"])
        for value in ("stack", "ellipsoids", "S2"):
            self.click(value)
        self.assertEqual({**self.state(), "drawn": 0}, {**whole, "drawn": 0})

    def test_colours_and_their_legend(self):
        pictures = {}
        for mode, legend in (("label", "mid_top/front"), ("residual", "outside: 20"), ("sensor", "S3")):
            self.assertEqual(self.click(mode)["mode"], mode)
            self.assertIn(legend, self.text("#legend"))
            pictures[mode] = self.page.screenshot("#view")
        self.assertEqual(len(set(pictures.values())), 3)

    def test_camera_follows_mouse_and_keys(self):
        self.page.evaluate("document.querySelector('#view').scrollIntoView({behavior: 'instant'})")
        box = self.page.evaluate("(() => { const b = document.querySelector('#view canvas').getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()")
        centre = (box[0] + box[2] / 2, box[1] + box[3] / 2)
        start = self.state()["camera"]
        self.page.drag(centre, (centre[0] + 120, centre[1]))
        dragged = self.state()["camera"]
        self.assertGreater(max(abs(a - b) for a, b in zip(start, dragged)), 0.2)
        self.assertAlmostEqual(start[1], dragged[1], 3, "a sideways drag turns about the vertical")
        self.page.press("0")
        for a, b in zip(start, self.state()["camera"]):
            self.assertAlmostEqual(a, b, 6)
        self.page.press("+")
        distance = [sum(x * x for x in camera) for camera in (start, self.state()["camera"])]
        self.assertLess(distance[1], distance[0])
        self.page.press("0")
        self.page.evaluate("(() => { const s = document.querySelector('select'); s.value = 'sensor:S2'; s.dispatchEvent(new Event('change', {bubbles: true})); })()")
        pose = self.report["extrinsics"]["sensors"]["S2"]["structure_from_sensor"]
        for row, x in zip(pose, self.state()["camera"]):
            self.assertAlmostEqual(row[3], x, 6)
        self.page.evaluate("(() => { const s = document.querySelector('select'); s.value = 'overview'; s.dispatchEvent(new Event('change', {bubbles: true})); })()")

    def test_every_control_is_reached_and_works_by_keys(self):
        self.page.evaluate("document.activeElement.blur(), document.querySelector('.skip').focus()")
        reached = set()
        for _ in range(80):
            self.page.press(Keys.TAB)
            reached.add(self.page.evaluate("document.activeElement.value || document.activeElement.tagName"))
            if self.page.evaluate("document.activeElement.value") == "points":
                points = self.state()["points"]
                self.page.press(" ")
                self.assertLess(self.state()["points"], points)
                self.page.press(" ")
        for control in LAYERS + PLACED + ["sensor", "overview", "CANVAS"]:
            self.assertIn(control, reached)

    def test_tables_say_what_extrinsics_json_says(self):
        extrinsics = json.loads(read("extrinsics.json"))
        self.assertEqual(self.report["extrinsics"], extrinsics)
        self.assertEqual(self.text("h1"), "3 of 4 sensors usable; S4 failed")
        self.assertIn(extrinsics["date"][:10], self.text("#subject"))
        self.assertEqual(self.text("#note"), "Note: " + NOTE)
        # Nothing leads to where it was made: the page is sent to others.
        self.assertEqual(self.page.evaluate("document.querySelectorAll('a:not([href^=\"#\"])').length"), 0)
        self.assertIn("failed\nworst sensor", self.text("#tiles"))
        self.assertIn("mm ✓", self.text("#tiles"))
        self.assertEqual(self.page.evaluate("document.querySelectorAll('#sensor-table tbody tr').length"), 4)
        row = self.text("#sensor-table tbody tr")
        sensor = extrinsics["sensors"]["S1"]
        for number in (f"{1000 * sensor['rms_to_structure_m']:.1f}", f"{least_known_deg(sensor['covariance']):.3f}", f"{1000 * sensor['error']['translation_m']:.1f}"):
            self.assertIn(number, row.replace("−", "-"))
        reasons = self.text("#reasons").lower()
        self.assertIn(extrinsics["sensors"]["S4"]["reason"].lower(), reasons)
        self.assertIn(extrinsics["sensors"]["S4"]["hint"].lower(), reasons)
        pairs = self.text("#pair-table table")
        for pair in extrinsics["pairs"]:
            if "rms_m" in pair:
                self.assertIn(f"{1000 * pair['rms_m']:.1f}", pairs)
        known = self.page.evaluate("document.querySelectorAll('#pair-table table')[1].innerText")
        for pair in extrinsics["pairs"]:
            self.assertIn(f"{1000 * pair['sigma_m']:.1f}", known)
            if "rms_m" in pair:
                self.assertIn(f"{1000 * pair['predicted_rms_m']:.1f}", known)
        self.assertIn("calibrate --model models/m05-lite.safetensors", self.text("#run"))

    def test_a_sensor_in_doubt_is_not_called_usable(self):
        report = copy.deepcopy(self.report)
        for name, code in (("S2", "disagrees"), ("S3", "uncertain")):
            report["extrinsics"]["sensors"][name].update(status="weak", code=code, reason="a reason", hint="a hint")
        with self.page_of(report) as page:
            self.assertEqual(page.evaluate("document.querySelector('h1').innerText"), "2 of 4 sensors usable; S4 failed; S2 in doubt (weak); S3 with care (weak)")

    def test_position_sigma_is_that_of_the_sensor(self):
        """By the derivative of T = Exp(delta) T^: of a turn, its axis x position."""
        sensor = self.report["extrinsics"]["sensors"]["S3"]
        position = np.array(sensor["structure_from_sensor"])[:3, 3]
        by_delta = np.hstack([np.eye(3), np.cross(np.eye(3), position).T])
        variance = np.diag(by_delta @ sensor["covariance"] @ by_delta.T)
        row = self.page.evaluate("[...document.querySelectorAll('#uncertainty-table tbody tr')[2].cells].map((cell) => cell.innerText)")
        self.assertEqual(row[:4], ["S3"] + [f"{1000 * v ** 0.5:.1f}" for v in variance])

    def test_pictures_are_there_and_named(self):
        self.page.evaluate("document.querySelectorAll('img').forEach((image) => { image.loading = 'eager'; })")
        self.page.wait("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
        pictures = self.page.evaluate("[...document.images].map((image) => image.alt)")
        self.assertEqual(len(pictures), 4 + 3 * 4 + 2)
        self.assertEqual(len(set(pictures)), len(pictures))
        for alt in pictures:
            self.assertRegex(alt, "^S[1-4](: |, ok: |, failed: ).*")

    def test_a_picture_of_each_sensor_is_seen_first(self):
        strip = self.page.evaluate("[...document.querySelectorAll('#strip a')].map((link) => [link.innerText.trim().split(/\\s/)[0], link.getBoundingClientRect().bottom, "
                                   "link.querySelector('img').title])")
        self.assertEqual([name for name, _, _ in strip], PLACED + ["S4"])
        for name, bottom, title in strip:
            self.assertLess(bottom, 450, name)
            self.assertIn("edges at the pose" if name in PLACED else "measured depth", title)
        self.assertEqual(self.page.evaluate("document.querySelector(document.querySelector('#strip a').getAttribute('href')).getAttribute('aria-label')"), "S1")
        self.assertTrue(self.page.evaluate("document.querySelector('h1').compareDocumentPosition(document.querySelector('#strip')) & 4"))

    def test_a_failed_sensor_shows_its_best_guess(self):
        report = copy.deepcopy(self.report)
        frames = report["stills"][0]["frames"]
        frames[3]["pictures"]["edges"] = frames[0]["pictures"]["edges"]
        with self.page_of(report) as page:
            self.assertIn("best guess", page.evaluate("document.querySelectorAll('#strip a')[3].innerText"))
            self.assertIn("best guess, which was rejected", page.evaluate("document.querySelector('#frame-3').innerText"))
            self.assertNotIn("best guess", page.evaluate("document.querySelector('#frame-0').innerText"))

    def test_names_stay_as_they_are(self):
        report = copy.deepcopy(self.report)
        report["extrinsics"]["sensors"]["s00"] = report["extrinsics"]["sensors"].pop("S4")
        report["stills"][0]["frames"][3]["sensor"] = "s00"
        report["advice"] = ["s00 is off", "s00x is off", "depth_scale is off", "it is off", "capture.json is off"]
        with self.page_of(report) as page:
            self.assertEqual(page.evaluate("[...document.querySelectorAll('#reasons li')].map((line) => line.innerText)"),
                             ["s00 is off.", "s00x is off.", "depth_scale is off.", "It is off.", "capture.json is off."])

    def test_a_check_begins_with_what_moved(self):
        report = copy.deepcopy(self.report)
        sensor = lambda name, movement, far: {"name": name, "movement": movement, "translation_m": far, "rotation_deg": 0.5, "probability": 1e-9, "found_from_m": 0.02, "found_from_deg": 1}
        report["check"] = {"sentences": ["S3 moved 40.3 mm, 0.50 deg; the other 2 agree within 0.9 mm, 0.01 deg", "the stack stands 3 mm and 0.1 deg from where it stood"],
                           "file": {"last": "old/extrinsics.json", "last_from_now": [], "sensors": [sensor("S1", "stayed", 0.0009), sensor("S2", "stayed", 0.0004), sensor("S3", "moved", 0.0403)]}}
        with self.page_of(report) as page:
            text = lambda selector: page.evaluate(f"document.querySelector('{selector}').innerText")
            self.assertEqual(text("h1"), report["check"]["sentences"][0])
            self.assertIn("old/extrinsics.json", text("#subject"))
            self.assertIn("3 of 4 sensors usable", text("#subject"))
            rows = page.evaluate("[...document.querySelectorAll('#check tbody tr')].map((row) => [...row.cells].slice(0, 3).map((cell) => cell.innerText.trim()))")
            self.assertEqual(rows, [["S1", "stayed", "0.9"], ["S2", "stayed", "0.4"], ["S3", "moved", "40.3"]])
            self.assertIn("The stack stands 3 mm", text("#check"))
            self.assertTrue(page.evaluate("document.querySelector('#check').compareDocumentPosition(document.querySelector('#tiles')) & 4"))

    def test_narrow_and_dark(self):
        backgrounds = set()
        for dark in (False, True):
            page = self.browser.open(url(), width=390, height=844, dark=dark, mobile=True)
            page.settle()
            self.assertEqual(page.evaluate("document.documentElement.scrollWidth"), 390)
            self.assertEqual(page.evaluate("volalignReport().sensors.length"), 3)
            backgrounds.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            self.assertEqual(page.complaints(), [])
            page.close()
        self.assertEqual(len(backgrounds), 2)

    @contextlib.contextmanager
    def page_of(self, report):
        """The page around another payload; it has nothing to complain of."""
        text = read("report.html")
        begin = text.index(PAYLOAD) + len(PAYLOAD)
        with open(os.path.join(FOLDER, "changed.html"), "w", encoding="utf-8") as file:
            file.write(text[:begin] + json.dumps(report).replace("<", "\\u003c") + text[text.index("</script>", begin):])
        page = self.browser.open(url("changed.html"))
        yield page
        self.assertEqual(page.complaints(), [])
        page.close()

    def test_every_number_says_what_it_means(self):
        bare = self.page.evaluate("""[...document.querySelectorAll('.tile b, td, main dd')].filter((node) => /[0-9]/.test(node.innerText) && !node.closest('#run'))
            .filter((node) => !node.closest('[title]')).map((node) => node.innerText)""")
        self.assertEqual(bare, [])
        heads = self.page.evaluate("[...document.querySelectorAll('#sensor-table th[scope=col]')].map((node) => node.title)")
        self.assertTrue(all(heads), heads)
        self.assertGreater(self.page.evaluate("document.querySelectorAll('td[title]').length"), 60)
        # The limits in force stand beside the numbers.
        self.assertIn("≤ 20", self.text("#sensor-table thead"))

    def test_it_advises(self):
        reasons = self.text("#reasons")
        self.assertIn("What next:", reasons)
        self.assertRegex(reasons, r"Least certain: S\d \([\d.]+ mm\) and S\d \([\d.]+ mm\)\.")
        # With this run's files, to copy.
        self.assertIn(f"volalign check --extrinsics {FOLDER}/extrinsics.json --capture NEW.json", reasons)
        self.assertIn(f"volalign convert {FOLDER}/extrinsics.json --to open3d", reasons)

    def test_columns_are_explained_without_a_pointer(self):
        self.page.evaluate("document.querySelector('#sensor-table details').open = true")
        self.assertIn("worst direction", self.text("#sensor-table details"))
        self.page.evaluate("document.querySelector('#sensor-table details').open = false")
        self.assertNotIn("Rest on a number", self.text("main"))

    def test_one_sigma_has_one_value(self):
        cells = lambda table, row: self.page.evaluate(f"[...document.querySelectorAll('#{table} tbody tr')[{row}].cells].map((cell) => cell.innerText.trim())")
        heads = lambda table: self.page.evaluate(f"[...document.querySelectorAll('#{table} thead th')].map((cell) => cell.innerText.split('\\n')[0])")
        at = {table: heads(table).index("σ position") for table in ("sensor-table", "uncertainty-table")}
        for row in range(3):
            self.assertEqual(cells("sensor-table", row)[at["sensor-table"]], cells("uncertainty-table", row)[at["uncertainty-table"]])

    def test_the_rig_from_above(self):
        self.assertEqual(self.page.evaluate("document.querySelectorAll('#above-picture svg').length"), 1)
        sensor = self.report["extrinsics"]["sensors"]["S2"]
        x, y, z = (sensor["structure_from_sensor"][k][3] for k in range(3))
        distance, height = (x * x + z * z) ** 0.5, y - self.report["extrinsics"]["structure"]["floor_m"]
        row = self.page.evaluate("[...document.querySelectorAll('#above-table tbody tr')[1].cells].map((cell) => cell.innerText.trim())")
        self.assertEqual(row[:3], ["S2", f"{distance:.3f}", f"{height:.3f}"])
        drawn = self.page.evaluate("document.querySelector('#above-picture svg').textContent")
        self.assertIn(f"{distance:.2f} m, {height:.2f} m high", drawn)
        for axis in ("x, front", "z, right"):
            self.assertIn(axis, drawn)

    def test_residuals_by_side(self):
        frame = self.report["stills"][0]["frames"][0]
        side = frame["sides"][0]
        name = next(label["name"] for label in self.report["labels"] if label["id"] == side["label"])
        title = self.page.evaluate(f"[...document.querySelectorAll('#side-table td')].map((cell) => cell.title).find((title) => title.startsWith('S1, {name}:'))")
        self.assertIn(f"mean {1000 * side['mean_m']:.1f} mm".replace("-", "−"), title)
        self.assertIn(f"of {side['points']} points", title)

    def test_pictures_are_enlarged_by_click(self):
        width = "document.querySelector('#frame-list img').getBoundingClientRect().width"
        before = self.page.evaluate(width)
        self.page.evaluate("document.querySelector('#frame-list .enlarge').click()")
        self.assertGreater(self.page.evaluate(width), 2 * before)
        self.page.evaluate("document.querySelector('#frame-list .enlarge').click()")
        self.assertEqual(self.page.evaluate(width), before)

    def test_on_paper(self):
        page = self.browser.open(url(), width=700, height=990, dark=True)
        page.send("Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        hidden = page.evaluate("['#rig', 'nav', '#frame-list details'].map((what) => getComputedStyle(document.querySelector(what)).display)")
        self.assertEqual(hidden, ["none"] * 3)
        self.assertEqual(page.evaluate("getComputedStyle(document.body).backgroundColor"), "rgb(255, 255, 255)")
        self.assertLessEqual(page.evaluate("document.documentElement.scrollWidth"), 700)
        pages = page.send("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
        self.assertGreater(len(pages), 20000)
        page.close()

    def test_other_poses_that_fit(self):
        """S1 and S2 may stand elsewhere, and a choice that is decided."""
        self.assertTrue(self.page.evaluate("document.querySelector('#alternatives').hidden"))
        report = copy.deepcopy(self.report)
        sensors, frames = report["extrinsics"]["sensors"], report["stills"][0]["frames"]
        other = lambda *names: {name: {"twin": 2, "structure_from_sensor": sensors[name]["structure_from_sensor"]} for name in names}
        report["extrinsics"]["twins"] = [{"log_odds": 0.4, "sensors": other("S1", "S2")}, {"log_odds": 30, "sensors": other("S3")}]
        shown = [{"sensor": frame["sensor"], "width": frame["width"], "height": frame["height"], "picture": frame["pictures"]["edges"], "outlines_differ": share}
                 for frame, share in zip(frames, (0.1, 0.3))]
        report["twins"] = [{"from_above": report["from_above"], "frames": shown}, {"from_above": report["from_above"], "frames": []}]
        with self.page_of(report) as page:
            text = page.evaluate("document.querySelector('#alternatives').innerText")
            for part in ("S1, S2 may stand elsewhere", "1.5 : 1", "--choose S1=2", "S2 will follow", "Look first at the picture of S2", "30 %", "1 set of poses that fit less well was rejected, with odds from over 1000 : 1 on"):
                self.assertIn(part, text)
            self.assertEqual(page.evaluate("document.querySelectorAll('#alternatives svg').length"), 2)
            self.assertEqual(page.evaluate("document.querySelectorAll('#alternatives img').length"), 4)

    def test_several_stills(self):
        """The page with its still a second time, a metre away."""
        report = copy.deepcopy(self.report)
        placements, stills = report["extrinsics"]["placements"], report["stills"]
        placements.append({**placements[0], "name": "there", "first_from_placement": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]})
        stills[0]["name"], placements[0]["name"] = "here", "here"
        stills.append({**stills[0], "name": "there"})
        with self.page_of(report) as page:
            page.settle()
            state = page.evaluate("volalignReport()")
            points = sum(frame["cloud"]["count"] for frame in stills[0]["frames"] if "cloud" in frame)
            self.assertEqual((state["stacks"], state["points"]), (2, 2 * points))
            self.assertIn("In there:", page.evaluate("document.querySelector('#frames').innerText"))

    def test_without_webgl_the_rest_stands(self):
        with Browser("--disable-3d-apis") as browser:
            page = browser.open(url())
            self.assertIn("no WebGL", page.evaluate("document.querySelector('#view-message').innerText"))
            self.assertEqual(page.evaluate("document.querySelectorAll('#sensor-table tbody tr').length"), 4)
            self.assertEqual(page.evaluate("document.querySelectorAll('#above-picture svg').length"), 1)
            self.assertEqual(page.evaluate("document.querySelectorAll('#controls input').length"), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
