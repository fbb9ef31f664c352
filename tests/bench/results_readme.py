#!/usr/bin/env python3
"""Writes the accuracy of the README from docs/results.md, so that no number stands in both by hand.

    tests/bench/results_readme.py          (results_page.py does it, too, when it has written that page)
    tests/bench/results_readme.py --check  fails where the README has other numbers
"""

import re
import sys

from common import D415, KINECT, ROOT, table

BEGIN, END = "<!-- accuracy: written by tests/bench/results_readme.py from docs/results.md -->\n", "<!-- end of accuracy -->\n"


def tables_of(page, heading):
    """The tables below a heading, each a list of rows: title of the column -> cell. Columns of one title become "deg", "deg 2", ..."""
    section = re.split(r"^## ", page.split(f"## {heading}\n", 1)[1], flags=re.MULTILINE)[0]
    tables = []
    for block in re.findall(r"(?:^\|.*\n?)+", section, flags=re.MULTILINE):
        head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in block.strip().splitlines()]
        titles = [title + (f" {head[:i].count(title) + 1}" if title in head[:i] else "") for i, title in enumerate(head)]
        tables.append([dict(zip(titles, row)) for row in rows])
    return tables


def row_of(table, **cells):
    return next(row for row in table if all(row[title] == cell for title, cell in cells.items()))


def two(cell):
    """The first two of "median / 95th percentile / largest"."""
    return " / ".join(cell.split(" / ")[:2])


def accuracy(page):
    """The part of the README between BEGIN and END, by the text of docs/results.md."""
    placed = tables_of(page, "Rendered rigs")[1]
    placements = tables_of(page, "Several placements")[0]
    version = re.search(r"Every number is of `(.*)`", page).group(1)
    share = re.search(r"results_page\.py \S+ --share (\S+)", page)
    rows = []
    for name, kind in (("Azure Kinect (NFOV binned)", KINECT), ("RealSense D415", D415)):
        row = row_of(placed, sensors=kind)
        number = row["placed"].split(" of ")[1]
        rows.append([name, two(row["refined, mm"]), row["deg"],
                     f"{number} rendered sensors in rigs of 4 or 8 about 2 m from the stack, sensor noise, furnished rooms, boxes 3 mm off their places"])
    four = row_of(placements, placements="4")
    rows.append(["Azure Kinect, four placements of the stack", two(four["Azure Kinect, mm"]), four["deg"], "rendered, a rig of 8"])
    frames = tables_of(page, "Frames that volalign did not render")
    for name, kind in (("Azure Kinect, real", "real kinects, model"), ("RealSense D415, real", "real d415, model")) if frames else ():
        row = row_of(frames[0], frames=kind)
        between = row["between sensors, mm RMS"]
        rows.append([name, "no ground truth", "", f"{row['placed']} placed, {row['weak']} of them `weak`: {row['to the structure, mm RMS']} mm RMS (median / largest) "
                     "from the points to the stack" + ("" if between == "-" else f", {between} mm between two sensors")])
    every = row_of(placed, sensors="all")
    sensors = every["placed"].split(" of ")[1]
    one, both = every["68, 95 %"].split(", ")
    return f"""
Errors of the refined poses, median / 95th percentile, of `{version}`{f", measured on a share of {share.group(1)} of the rigs" if share else ""}.
[docs/results.md](docs/results.md) has the command and more figures.

{table(["sensors", "position, mm", "rotation, deg", "measured on"], rows)}

{every['lost']} of the {sensors} rendered sensors were lost, {every['wrong']} were placed wrongly, and {every['weak']} were reported as `weak`. {one} % of the 68 % intervals and {both} % of
the 95 % intervals hold the true value.

"""


def with_accuracy(readme, page):
    begin, end = readme.index(BEGIN) + len(BEGIN), readme.index(END)
    return readme[:begin] + accuracy(page) + readme[end:]


def main():
    readme = ROOT / "README.md"
    text = with_accuracy(readme.read_text(), (ROOT / "docs/results.md").read_text())
    if sys.argv[1:] != ["--check"]:
        readme.write_text(text)
    elif text != readme.read_text():
        sys.exit("README.md has other numbers than docs/results.md: run tests/bench/results_readme.py")


if __name__ == "__main__":
    main()
