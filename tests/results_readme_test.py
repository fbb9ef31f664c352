#!/usr/bin/env python3
"""The README has the numbers of docs/results.md (tests/bench/results_readme.py), and made pages give made numbers."""

import pathlib
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests/bench"))
import results_readme  # noqa: E402

PAGE = """# Results

    tests/bench/results_page.py build/release/cli/volalign --share 0.5

Every number is of `volalign 9.9.9 (abc of 2030-01-02)`

## Rendered rigs

| rig | sensors | initial, mm | deg | refined, mm | deg | as built, mm | deg |
|---|---|---|---|---|---|---|---|
| ring8 | azure_kinect_nfov_binned | 1 / 2 / 3 | 4 / 5 / 6 | 7 / 8 / 9 | 10 / 11 / 12 | - | - |
| all rigs | azure_kinect_nfov_binned | 1 / 2 / 3 | 4 / 5 / 6 | 70 / 80 / 90 | 0.1 / 0.2 / 0.3 | - | - |
| all rigs | realsense_d415 | 1 / 2 / 3 | 4 / 5 / 6 | 71 / 81 / 91 | 0.4 / 0.5 / 0.6 | - | - |

| rig | sensors | placed | weak | lost | wrong | 68 % | 95 % |
|---|---|---|---|---|---|---|---|
| all rigs | azure_kinect_nfov_binned | 55 of 56 | 0 | 1 of 56 | 0 | 60 % | 90 % |
| all rigs | realsense_d415 | 40 of 40 | 0 | 0 of 40 | 0 | 60 % | 90 % |
| all rigs | all | 95 of 96 | 7 | 1 of 96 | 2 | 66 % | 93 % |

### Uncertainty

## Frames that volalign did not render

These frames were not there when this page was made.

## Several placements

| sensors | placements | refined, mm | deg | as built, mm | deg | weak |
|---|---|---|---|---|---|---|
| azure_kinect_nfov_binned | 1 | 1 / 2 / 3 | 4 / 5 / 6 | - | - | 0 |
| azure_kinect_nfov_binned | 4 | 33 / 34 / 35 | 0.7 / 0.8 / 0.9 | - | - | 0 |
"""

FRAMES = """| frames | placed | weak | to the structure, mm RMS | between sensors, mm RMS |
|---|---|---|---|---|
| real kinects, model | 4 of 4 | 3 | 5.1 / 6.1 | 7.1 / 9.1 |
| real d415, model | 1 of 1 | 1 | 14.5 / 14.5 | - |
"""


class ResultsReadme(unittest.TestCase):
    def test_the_readme_has_the_numbers_of_the_page(self):
        readme = (ROOT / "README.md").read_text()
        page = (ROOT / "docs/results.md").read_text()
        self.assertEqual(readme, results_readme.with_accuracy(readme, page), "run tests/bench/results_readme.py")

    def test_the_numbers_are_those_of_their_columns(self):
        text = results_readme.accuracy(PAGE)
        for part in ("volalign 9.9.9 (abc of 2030-01-02)", "a share of 0.5 of the rigs", "| 70 / 80 | 0.1 / 0.2 | 56 rendered", "| 71 / 81 | 0.4 / 0.5 | 40 rendered",
                     "| 33 / 34 | 0.7 / 0.8 |", "Of the 96 rendered sensors, 1 were lost, 2 placed wrongly and 7", "68 % intervals 66 % hold", "95 % intervals 93 %"):
            self.assertIn(part, text.replace("\n95", " 95"))
        self.assertNotIn("real", text)

    def test_real_frames_where_they_were_there(self):
        text = results_readme.accuracy(PAGE.replace("These frames were not there when this page was made.", FRAMES))
        self.assertIn("4 of 4 placed, 3 of them `weak`: 5.1 / 6.1 mm RMS", text)
        self.assertIn("7.1 / 9.1 mm between two sensors", text)
        self.assertIn("14.5 / 14.5 mm RMS (median / largest) from the points to the stack |", text)


if __name__ == "__main__":
    unittest.main()
