#!/usr/bin/env python3
"""Writes the tables of docs/paper.md from what `volalign evaluate --suite all -o RESULTS` measured.

    tests/bench/paper_page.py RESULTS [--page docs/paper.md]

Each table of the page stands between `<!-- table2: ... -->` and `<!-- end of table2 -->`. The columns are those of RESULTS/suite.md, joined or left out. With
them goes what the paper claims of its models, as differences between initial poses on the same views, with 95 % intervals of Student's t.
Needs SciPy for the intervals.
"""

import argparse
import json
import math
import pathlib
import re
import statistics
import sys

from scipy import stats

CLAIMS = [("attention", "m01", "m02"), ("Procrustes, 150-225 cm", "m02", "m03"), ("Procrustes, 150-275 cm", "m04", "m05"),
          ("Procrustes, 150-350 cm", "m06", "m07"), ("range to 275 cm", "m03", "m05"), ("range to 350 cm", "m05", "m07")]


def table(head, rows):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *("| " + " | ".join(row) + " |" for row in rows)])


def percent(share):
    return f"{100 * share:.2f} %"


def with_paper(text, paper, cell):
    return f"{text} ({paper[cell]})" if paper else text


def truth_cells(truth):
    return [f"{truth['lost']} of {truth['views']}", str(truth["wrong"]), f"{truth['mean_mm']:.0f} / {truth['median_mm']:.0f}",
            f"{truth['mean_deg']:.2f} / {truth['median_deg']:.2f}"]


def paper_cells(row, block):
    cells = row.get("paper") or []
    return cells[4 * block:4 * block + 4]


def models_table(rows):
    """Tables 2 to 4: mIoU and 3D RMSE of models, over views."""
    lines = []
    for row in rows:
        miou, rmse = row["blocks"]
        lines.append([row["label"], with_paper(percent(miou["column"]["mean"]), paper_cells(row, 0), 0), percent(miou["column"]["std"]),
                      percent(miou["floor"]), with_paper(f"{rmse['column']['mean']:.4f}", paper_cells(row, 1), 0),
                      f"{rmse['column']['std']:.4f}", f"{rmse['floor']:.4f}", *truth_cells(row["truth"][0]),
                      percent(row["truth"][0]["miou_of_truth"]) if row["truth"][0]["miou_of_truth"] else "-"])
    return table(["", "mIoU (paper)", "STD", "floor", "3D RMSE (paper)", "STD", "floor", "lost", "wrong", "mm, mean / median",
                  "deg, mean / median", "labels' mIoU"], lines)


def rigs_table(rows, block):
    """Tables 5 and 6: d1 or d2 of methods, over captures."""
    lines, floors = [], []
    for row in rows:
        measured, paper = row["blocks"][block], paper_cells(row, block)
        if not measured["applicable"] or not row["has_model"]:
            continue
        column = measured["column"]
        floors.append(measured["floor"])
        lines.append([row["label"], with_paper(f"{column['mean']:.4f}", paper, 0), f"{column['std']:.4f}",
                      with_paper(percent(column["rsd"]), paper, 2), percent(column["rsd_within"]) if "rsd_within" in column else "-",
                      with_paper(f"{100 * measured['to_best']:+.1f} %", paper, 3), *truth_cells(row["truth"][block])])
    return f"Floor: {statistics.median(floors):.4f} m.\n\n" + table(
        ["", "RMS (paper)", "STD", "RSD (paper)", "RSD within set-ups", "to best (paper)", "lost", "wrong", "mm, mean / median", "deg, mean / median"], lines)


def difference(rows, before, after, block, factor, decimals):
    values = []
    for label in (before, after):
        found = [row for row in rows if row["label"] == label]
        values.append(found[0]["blocks"][block]["values"] if found else [])
    if not values[0] or len(values[0]) != len(values[1]):
        return "-"
    gains = [factor * (b - a) for a, b in zip(*values)]
    half = stats.t.ppf(0.975, len(gains) - 1) * statistics.stdev(gains) / math.sqrt(len(gains))
    return f"{statistics.mean(gains):+.{decimals}f} ± {half:.{decimals}f}"


def claims_table(tables):
    lines = []
    for what, before, after in CLAIMS:
        cells = []
        for name in ("table2", "table3", "table4"):
            cells += [difference(tables[name], before, after, 0, 100, 1), difference(tables[name], before, after, 1, 100, 1)]
        lines.append([what, before, after, *cells])
    head = [f"{cm}: {metric}" for cm in ("165 cm", "165 and 200 cm", "all three") for metric in ("mIoU, points", "3D RMSE, cm")]
    return table(["added", "from", "to", *head], lines)


def d1_table(captures):
    """Mean d1, mm, of methods at each stage, over the captures of a data set."""
    rows, floors = [], {}
    for method in ("markers", "m05", "m05-lite", "volalign"):
        scores = [json.loads(path.read_text()) for path in sorted(captures.glob(f"*.{method}.json"))]
        floors.update((score["capture"], score["d1_floor_m"]) for score in scores)
        cells = []
        for stage in ("initial", "graph", "statistical", "corrected"):
            values = [found["d1_m"] for score in scores for found in score["stages"] if found["stage"] == stage and found.get("d1_m")]
            cells.append(f"{1000 * statistics.mean(values):.2f}" if values else "")
        rows.append([method, *cells])
    return f"Floor: {1000 * statistics.mean(floors.values()):.2f} mm.\n\n" + table(
        ["", "initial", "paper's refinement", "refined statistically", "the same, depths corrected"], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path)
    parser.add_argument("--page", type=pathlib.Path, default=pathlib.Path("docs/paper.md"))
    arguments = parser.parse_args()
    tables = {name: json.loads((arguments.results / f"{name}.json").read_text())["rows"] for name in ("table2", "table3", "table4", "table4_level", "table5", "table6")}
    texts = {name: models_table(tables[name]) for name in ("table2", "table3", "table4", "table4_level")}
    texts["table5"] = rigs_table(tables["table5"], 0)
    texts["table6_rings"], texts["table6_four"] = rigs_table(tables["table6"], 0), rigs_table(tables["table6"], 1)
    texts["d1"] = d1_table(arguments.results / "captures" / "cameras_6_8")
    texts["differences"] = claims_table(tables)
    page = arguments.page.read_text()
    for name, text in texts.items():
        page, found = re.subn(f"(<!-- {name}: [^>]*-->\n).*?(<!-- end of {name} -->)", lambda match: f"{match[1]}\n{text}\n\n{match[2]}", page, flags=re.DOTALL)
        if found != 1:
            sys.exit(f"{arguments.page} has no place for {name}")
    arguments.page.write_text(page)


if __name__ == "__main__":
    main()
