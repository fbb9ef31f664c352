#!/usr/bin/env python3
"""Does report.html show what it says, in a browser?

    tests/report/page_test.py FOLDER     (of make_report.py)

Needs Chromium (Debian package chromium; WebGL is drawn by its software renderer). Exits with 77, which CTest calls skipped, where it is absent.
"""

import json
import math
import os
import sys
import unittest

from browser import Browser, find_chromium
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
    """By power iteration: the largest eigenvalue of the rotation's part."""
    turn, v = [row[3:] for row in covariance[3:]], [1, 1.1, 1.2]
    for _ in range(1000):
        v = [sum(a * b for a, b in zip(row, v)) for row in turn]
        norm = math.hypot(*v)
        v = [x / norm for x in v]
    return math.degrees(norm ** 0.5)


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
        self.assertEqual(self.text("h1"), "3 of 4 sensors usable; S4 failed")
        self.assertIn(extrinsics["date"][:10], self.text("#subject"))
        self.assertEqual(self.text("#note"), "Note: " + NOTE)
        page = self.page.evaluate("decodeURI(new URL(document.querySelector('#tool a').href).pathname)")
        self.assertTrue(page.endswith("/docs/report.md") and os.path.exists(page), page)
        self.assertIn("failed", self.text("#tiles"))
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

    def open_with(self, report, name):
        """The page around another payload."""
        text = read("report.html")
        begin = text.index(PAYLOAD) + len(PAYLOAD)
        with open(os.path.join(FOLDER, name), "w", encoding="utf-8") as file:
            file.write(text[:begin] + json.dumps(report).replace("<", "\\u003c") + text[text.index("</script>", begin):])
        return self.browser.open(url(name))

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
        self.assertRegex(reasons, r"S\d and S\d are known least \([\d.]+ and [\d.]+ mm\): a second capture")

    def test_the_rig_from_above(self):
        self.assertEqual(self.page.evaluate("document.querySelectorAll('#above-picture svg').length"), 1)
        sensor = self.report["extrinsics"]["sensors"]["S2"]
        x, y, z = (sensor["structure_from_sensor"][k][3] for k in range(3))
        distance, height = (x * x + z * z) ** 0.5, y - self.report["extrinsics"]["structure"]["floor_m"]
        row = self.page.evaluate("[...document.querySelectorAll('#above-table tbody tr')[1].cells].map((cell) => cell.innerText.trim())")
        self.assertEqual(row[:3], ["S2", f"{distance:.3f}", f"{height:.3f}"])
        drawn = self.page.evaluate("document.querySelector('#above-picture svg').textContent")
        self.assertIn(f"{distance:.2f} m, {height:.2f} m high", drawn)

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
        self.assertTrue(self.page.evaluate("document.querySelector('#twins').hidden"))
        report = json.loads(json.dumps(self.report))
        sensors, frames = report["extrinsics"]["sensors"], report["stills"][0]["frames"]
        other = lambda *names: {name: {"twin": 2, "structure_from_sensor": sensors[name]["structure_from_sensor"]} for name in names}
        report["extrinsics"]["twins"] = [{"log_odds": 0.4, "sensors": other("S1", "S2")}, {"log_odds": 30, "sensors": other("S3")}]
        shown = [{"sensor": frame["sensor"], "width": frame["width"], "height": frame["height"], "picture": frame["pictures"]["edges"], "outlines_differ": share}
                 for frame, share in zip(frames, (0.1, 0.3))]
        report["twins"] = [{"from_above": report["from_above"], "frames": shown}, {"from_above": report["from_above"], "frames": []}]
        page = self.open_with(report, "twins.html")
        text = page.evaluate("document.querySelector('#twins').innerText")
        for part in ("S1, S2 may stand elsewhere", "1.5 : 1", "--twin S1=2", "S2 will follow", "look at that of S2 first", "30 %", "1 set of poses that fit less well is decided against, with odds from over 1000 : 1 on"):
            self.assertIn(part, text)
        self.assertEqual(page.evaluate("document.querySelectorAll('#twins svg').length"), 2)
        self.assertEqual(page.evaluate("document.querySelectorAll('#twins img').length"), 4)
        self.assertEqual(page.complaints(), [])
        page.close()

    def test_several_stills(self):
        """The page with its still a second time, a metre away."""
        report = json.loads(json.dumps(self.report))
        placements, stills = report["extrinsics"]["placements"], report["stills"]
        placements.append({**placements[0], "name": "there", "first_from_placement": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]})
        stills[0]["name"], placements[0]["name"] = "here", "here"
        stills.append({**stills[0], "name": "there"})
        page = self.open_with(report, "two_stills.html")
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
            self.assertEqual(page.evaluate("document.querySelectorAll('#above-picture svg').length"), 1)
            self.assertEqual(page.evaluate("document.querySelectorAll('#controls input').length"), 0)


if __name__ == "__main__":
    if not find_chromium():
        print("skipped: no Chromium; apt-get install chromium")
        sys.exit(77)
    unittest.main(verbosity=2)
