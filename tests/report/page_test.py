#!/usr/bin/env python3
"""Does report.html show what it says, in a browser?

    tests/report/page_test.py FOLDER     (of make_report.py)

Needs Chromium (Debian package chromium; WebGL is drawn by its software renderer). Exits with 77, which CTest calls skipped, where it is absent.
"""

import json
import os
import sys
import unittest

from browser import Browser, find_chromium

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
            self.page.press("Tab")
            reached.add(self.page.evaluate("document.activeElement.value || document.activeElement.tagName"))
            if self.page.evaluate("document.activeElement.value") == "points":
                points = self.state()["points"]
                self.page.press(" ", text=" ")
                self.assertLess(self.state()["points"], points)
                self.page.press(" ", text=" ")
        for control in LAYERS + PLACED + ["sensor", "overview", "CANVAS"]:
            self.assertIn(control, reached)

    def test_tables_say_what_extrinsics_json_says(self):
        extrinsics = json.loads(read("extrinsics.json"))
        self.assertEqual(self.report["extrinsics"], extrinsics)
        self.assertEqual(self.text("h1"), "3 of 4 sensors are placed")
        self.assertIn("failed", self.text("#tiles"))
        self.assertEqual(self.page.evaluate("document.querySelectorAll('#sensor-table tbody tr').length"), 4)
        row = self.text("#sensor-table tbody tr")
        sensor = extrinsics["sensors"]["S1"]
        for number in (f"{1000 * sensor['rms_to_structure_m']:.1f}", f"{max(sensor['sigma_rotation_deg']):.3f}", f"{1000 * sensor['error']['translation_m']:.1f}"):
            self.assertIn(number, row.replace("−", "-"))
        reasons = self.text("#reasons").lower()
        self.assertIn(extrinsics["sensors"]["S4"]["reason"].lower(), reasons)
        self.assertIn(extrinsics["sensors"]["S4"]["hint"].lower(), reasons)
        pairs = self.text("#pair-table table")
        for pair in extrinsics["pairs"]:
            self.assertIn(f"{1000 * pair['rms_m']:.1f}", pairs)
        self.assertIn("calibrate --model models/m05-lite.pt", self.text("#run"))

    def test_position_sigma_is_that_of_the_sensor(self):
        """Against finite differences of T = Exp(delta) T^, column by column."""
        sensor = self.report["extrinsics"]["sensors"]["S3"]
        p, c, h = [row[3] for row in sensor["structure_from_sensor"][:3]], sensor["covariance"], 1e-6
        cross = lambda w: [w[1] * p[2] - w[2] * p[1], w[2] * p[0] - w[0] * p[2], w[0] * p[1] - w[1] * p[0]]
        columns = []
        for k in range(6):
            delta = [h * (i == k) for i in range(6)]
            columns.append([(v + w) / h for v, w in zip(delta[:3], cross(delta[3:]))])
        variance = [sum(columns[r][i] * c[r][s] * columns[s][i] for r in range(6) for s in range(6)) for i in range(3)]
        row = self.page.evaluate("[...document.querySelectorAll('#uncertainty-table tbody tr')[2].cells].map((cell) => cell.innerText)")
        self.assertEqual(row[:4], ["S3"] + [f"{1000 * v ** 0.5:.1f}" for v in variance])

    def test_pictures_are_there_and_named(self):
        self.page.evaluate("document.querySelectorAll('img').forEach((image) => { image.loading = 'eager'; })")
        self.page.wait("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
        pictures = self.page.evaluate("[...document.images].map((image) => image.alt)")
        self.assertEqual(len(pictures), 3 * 4 + 2)
        self.assertEqual(len(set(pictures)), len(pictures))
        for alt in pictures:
            self.assertRegex(alt, "^S[1-4]: .*")

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

    def test_several_stills(self):
        """The page with its still a second time, a metre away."""
        report = json.loads(json.dumps(self.report))
        placements, stills = report["extrinsics"]["placements"], report["stills"]
        placements.append({**placements[0], "name": "there", "first_from_placement": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]})
        stills[0]["name"], placements[0]["name"] = "here", "here"
        stills.append({**stills[0], "name": "there"})
        text = read("report.html")
        begin = text.index(PAYLOAD) + len(PAYLOAD)
        with open(os.path.join(FOLDER, "two_stills.html"), "w", encoding="utf-8") as file:
            file.write(text[:begin] + json.dumps(report).replace("<", "\\u003c") + text[text.index("</script>", begin):])
        page = self.browser.open(url("two_stills.html"))
        page.settle()
        state = page.evaluate("volalignReport()")
        points = sum(frame["cloud"]["count"] for frame in stills[0]["frames"] if "cloud" in frame)
        self.assertEqual((state["stacks"], state["points"]), (2, 2 * points))
        self.assertIn("In there:", page.evaluate("document.querySelector('#frames').innerText"))
        self.assertEqual(page.complaints(), [])
        page.close()

    def test_without_webgl_the_rest_stands(self):
        with Browser("--disable-3d-apis") as browser:
            page = browser.open(url())
            self.assertIn("no WebGL", page.evaluate("document.querySelector('#view-message').innerText"))
            self.assertEqual(page.evaluate("document.querySelectorAll('#sensor-table tbody tr').length"), 4)
            self.assertEqual(page.evaluate("document.querySelectorAll('#controls input').length"), 0)


if __name__ == "__main__":
    if not find_chromium():
        print("skipped: no Chromium; apt-get install chromium")
        sys.exit(77)
    unittest.main(verbosity=2)
