#!/usr/bin/env python3
"""Mutations of the program's geometry: tests/mutate.sh has each made, and a test has to fail.

  tests/mutations.py draw                  prints 60 of them, drawn by a fixed seed from every line that an operator fits
  tests/mutations.py redraw NUMBER         puts another one of its operator, drawn likewise, in the place of one whose line is gone
  tests/mutations.py applies NUMBER        fails where its line is gone
  tests/mutations.py apply NUMBER          makes that one of tests/mutations.tsv in the source tree; prints its room
  tests/mutations.py record NUMBER TEST    notes the test that caught it

tests/mutations.tsv has a row for each: number, operator, file, which of the equal lines of that file (from 1), the line, what
becomes of it, and the test that catches it.
"""

import os
import random
import re
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TABLE = os.path.join(ROOT, "tests", "mutations.tsv")
FOLDERS = ("core", "render", "infer", "train")
COUNT, SEED = 60, 30

# What is mistaken in such programs. Of each match in a line one mutation is made.
OPERATORS = (
    ("sign", r"(?<=[\w)\]]) ([-+]) (?=[\w(])", lambda m: f" {'+' if m[1] == '-' else '-'} "),
    ("sign", r" ([-+])= ", lambda m: f" {'+' if m[1] == '-' else '-'}= "),
    ("transpose", r"\.(transpose|inverse)\(\)", lambda m: ""),
    ("swap", r"\((u|left), (v|top)\)", lambda m: f"({m[2]}, {m[1]})"),
    ("swap", r"\.([xy])\(\)", lambda m: f".{'y' if m[1] == 'x' else 'x'}()"),
    ("swap", r"\b([fc])([xy])\b(?=[^(\"]*$)", lambda m: f"{m[1]}{'y' if m[2] == 'x' else 'x'}"),
    ("half pixel", r"(?<![\d.\w])0?\.5f?(?![\d.])", lambda m: "0.0f" if m[0].endswith("f") else "0.0"),
    ("gain", r" \* (?:[a-z_.]*gain[a-z_.]*|scale|factor)\b(?![(\[.]|->)", lambda m: ""),
    ("column", r"(\.(?:col|block<3, 3>|segment<3>|head<3>|tail<3>)\([^()]*\) = )(.+);$", lambda m: f"{m[1]}0 * ({m[2]});"),
)
# Texts, includes and comments, and templates, where a sign or a star is something else.
SKIPPED = re.compile(r'"|//|^\s*(#|using|template|static_assert|case|\*)|\boperator\b')


def sources():
    for folder in FOLDERS:
        for where, _, files in sorted(os.walk(os.path.join(ROOT, folder))):
            for name in sorted(files):
                if name.endswith((".cc", ".h")):
                    yield os.path.relpath(os.path.join(where, name), ROOT)


def lines_of(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        return file.read().split("\n")


def mutations():
    for path in sources():
        seen = {}
        for line in lines_of(path):
            which = seen[line.strip()] = seen.get(line.strip(), 0) + 1
            if SKIPPED.search(line):
                continue
            for name, pattern, change in OPERATORS:
                for match in re.finditer(pattern, line):
                    changed = line[: match.start()] + change(match) + line[match.end() :]
                    if changed != line:
                        yield name, path, which, line, changed


def draw():
    """The same share of each operator as far as there are enough: there are hundreds of signs for one half pixel."""
    chance = random.Random(SEED)
    by_operator = {}
    for mutation in mutations():
        by_operator.setdefault(mutation[0], []).append(mutation)
    for rows in by_operator.values():
        chance.shuffle(rows)
    drawn = []
    while len(drawn) < COUNT and any(by_operator.values()):
        for rows in by_operator.values():
            if rows and len(drawn) < COUNT:
                drawn.append(rows.pop())
    return drawn


def redraw(rows, number):
    """The number is part of the seed, so that one row does not depend on the others."""
    operator, taken = rows[number - 1][1], {tuple(row[2:6]) for row in rows}
    found = [(path, str(which), line.strip(), changed.strip()) for name, path, which, line, changed in mutations() if name == operator]
    drawn = random.Random(f"{SEED}/{number}").choice([mutation for mutation in found if mutation not in taken])
    rows[number - 1] = [str(number), operator, *drawn, ""]


def read_table():
    with open(TABLE, encoding="utf-8") as file:
        return [line.rstrip("\n").split("\t") for line in file]


def main():
    if sys.argv[1:] == ["draw"]:
        for number, (operator, path, which, line, changed) in enumerate(draw(), 1):
            print(number, operator, path, which, line.strip(), changed.strip(), "", sep="\t")
        return
    rows = read_table()
    row = rows[int(sys.argv[2]) - 1]
    _, _, path, which, line, changed, _ = row
    if sys.argv[1] in ("record", "redraw"):
        if sys.argv[1] == "record":
            row[6] = sys.argv[3]
        else:
            redraw(rows, int(sys.argv[2]))
        with open(TABLE, "w", encoding="utf-8") as file:
            file.writelines("\t".join(fields) + "\n" for fields in rows)
        return
    lines = lines_of(path)
    places = [i for i, text in enumerate(lines) if text.strip() == line]
    if len(places) < int(which):
        sys.exit(f"error: {path} has no longer {which} lines '{line}'")
    if sys.argv[1] == "applies":
        return
    place = places[int(which) - 1]
    lines[place] = lines[place].replace(line, changed)
    with open(os.path.join(ROOT, path), "w", encoding="utf-8") as file:
        file.write("\n".join(lines))
    print(os.path.dirname(path))


if __name__ == "__main__":
    main()
