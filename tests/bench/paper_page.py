#!/usr/bin/env python3
"""Writes the tables of docs/paper.md from what `volalign evaluate --suite all -o RESULTS` measured, and prints what its claims rest on.
The tables of models/paper-own/README.md are from OWN.

    tests/bench/paper_page.py RESULTS OWN [--page docs/paper.md]

OWN: what the commands of configs/paper/own_suite.yaml measured.

Each table of the page stands between `<!-- models: ... -->` and `<!-- end of models -->`. It has the paper's rows and columns, and from table 4 on a row of volalign.
Printed are differences on the same captures, between initial poses of two models and between the methods of tables 5 and 6, with 95 % intervals of Student's t over
captures (the views of a capture share a room and a stack). Needs SciPy for these.
"""

import argparse
import json
import pathlib
import re
import statistics
import sys

from claims import CLAIMS, interval
from common import table

METHODS = [("5, arc", "table5", 0), ("6, cameras_6_8", "table6", 0), ("6, cameras_4", "table6", 1)]
ARRAYS = {"table2": ["array_165"], "table3": ["array_165", "array_200"], "table4": ["array_165", "array_200", "array_235"], "table4_level": ["array_level"]}


def cells(row, block, percent, paper_from=0):
    """Mean, STD, RSD and distance to the best of a block, the paper's in brackets."""
    column, best = row["blocks"][block]["column"], row["blocks"][block].get("to_best")
    ours = [f"{100 * column['mean']:.2f}%" if percent else f"{column['mean']:.4f}", f"{100 * column['std']:.2f}%" if percent else f"{column['std']:.4f}",
            f"{100 * column['rsd']:.1f}%", "-" if best is None else f"{100 * best:+.1f}%"]
    paper = (row.get("paper") or [])[paper_from:paper_from + 4]
    return [f"{cell} ({paper[i]})" if paper else cell for i, cell in enumerate(ours)]


def rows_of(tables, name, blocks, percent=False):
    """Those that the paper has, and from table 4 on volalign's; of the array with level axes, which the paper has not, those of table 4."""
    wanted = {row["label"] for row in tables["table4" if name == "table4_level" else name] if row.get("paper")} | (set() if name in ("table2", "table3") else {"volalign"})
    lines = []
    for row in tables[name]:
        if row["label"] not in wanted or not all(row["blocks"][block]["applicable"] for block in blocks):
            continue
        line = [row["label"]]
        for block in blocks:
            line += cells(row, block, percent and block == 0, 4 * block)
        lines.append(line)
    return lines


def differences(captures):
    """Mean difference per capture, over views that both models place."""
    lines = []
    for what, before, after in CLAIMS:
        line = [what, before, after]
        for datasets in ARRAYS.values():
            for metric in ("miou_authors", "rmse_m"):
                gains = []
                for dataset in datasets:
                    for path in sorted((captures / dataset).glob(f"*.{before}.json")):
                        pair = [json.loads(p.read_text())["views"] for p in (path, path.with_name(path.name.replace(f".{before}.", f".{after}.")))]
                        initial = [(a["stages"][0], b["stages"][0]) for a, b in zip(*pair)]
                        both = [b["labels"][metric] - a["labels"][metric] for a, b in initial if a["placed"] and b["placed"]]
                        if both:
                            gains.append(100 * statistics.mean(both))
                line.append(interval(gains, 1))
        lines.append(line)
    return table(["added", "from", "to", *(f"{name}: {metric}" for name in ARRAYS for metric in ("mIoU, points", "3D RMSE, cm"))], lines)


def method_differences(tables):
    """Of d1 and d2, mm, from markers to labels."""
    lines = []
    for title, name, block in METHODS:
        values = {row["label"]: row["blocks"][block].get("values", []) for row in tables[name]}
        for stage in ("initial", "refined"):
            pairs = zip(values[f"markerbased_{stage}"], values[f"markerless_{stage}"], strict=True)
            lines.append([f"{title}, {stage}", interval([1000 * (after - before) for before, after in pairs], 2)])
    return table(["from markers to labels", "mm"], lines)


def own_rows(results):
    """Means of tables 2 to 4."""
    return [[f"{name[-1]}, {row['label']}", cells(row, 0, True)[0], cells(row, 1, False, 4)[0]] for name in ("table2", "table3", "table4")
            for row in sorted(json.loads((results / f"{name}.json").read_text())["rows"], key=lambda row: row["label"]) if re.fullmatch("m0[1-7]", row["label"])]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path)
    parser.add_argument("own", type=pathlib.Path)
    parser.add_argument("--page", type=pathlib.Path, default=pathlib.Path("docs/paper.md"))
    arguments = parser.parse_args()
    tables = {name: json.loads((arguments.results / f"{name}.json").read_text())["rows"] for name in (*ARRAYS, "table5", "table6")}
    four = ["mean", "STD", "RSD", "to best"]
    models = [[f"{title}, {row[0]}", *row[1:]] for title, name in (("2", "table2"), ("3", "table3"), ("4", "table4"), ("level", "table4_level"))
              for row in rows_of(tables, name, (0, 1), True)]
    methods = [[f"{title}, {row[0]}", *row[1:]] for title, name, block in METHODS for row in rows_of(tables, name, (block,))]
    texts = {("models", arguments.page): table(["table, model", *(f"mIoU, {c}" for c in four), *(f"3D RMSE, {c}" for c in four)], models),
             ("methods", arguments.page): table(["table, method", *four], methods),
             ("own", pathlib.Path("models/paper-own/README.md")): table(["table, model", "mIoU, mean", "3D RMSE, mean"], own_rows(arguments.own))}
    for (name, path), text in texts.items():
        page, found = re.subn(f"(<!-- {name}: [^>]*-->\n).*?(<!-- end of {name} -->)", lambda match: f"{match[1]}\n{text}\n\n{match[2]}", path.read_text(), flags=re.DOTALL)
        if found != 1:
            sys.exit(f"{path} has no place for {name}")
        path.write_text(page)
    for results in (arguments.results, arguments.own):
        print(differences(results / "captures") + "\n")
    print(method_differences(tables))


if __name__ == "__main__":
    main()
