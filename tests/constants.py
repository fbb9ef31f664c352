#!/usr/bin/env python3
"""Counts the tuned numbers of the modules that estimate poses, and holds each module to its limit.

    tests/constants.py [ROOT] [--list] [--modules DIR ...]

Counted is each numeric literal of C++ code (no comments, no strings) that is
- named: in the value of a constant (`constexpr`, or a `const` whose name begins with k), the default of a member, or the default of
  an argument, one for each number of an array;
- inline: anywhere else, if it is written with a point or an exponent;
and in configs/intrinsics.yaml each figure of a kind's errors and lens_sigmas whose line names neither a measurement, [M], nor a
publication, [P]. Not counted: 0, 1, 2 and a half, of either sign; whole numbers inline, which are indices, sizes and
units; the last default of an option that is gone (`Fixed`); `infinity` and such. Numbers of a law (3 of a root mean square of what falls linearly) are counted: the rule does not read.

A module that has fewer than its limit lowers it: the limit is what was reached. --modules counts others and holds them to nothing.
"""

import argparse
import pathlib
import re
import sys

LIMITS = {
    "infer/view": 24,
    "infer/lens": 29,
    "infer/depth": 21,
    "infer/initial": 62,
    "infer/refine": 42,
    "infer/checks": 20,
    "core/geometry/depth_error_model": 0,
    "configs/intrinsics.yaml": 14,
}
FREE = {0, 1, 2, 0.5}

NUMBER = re.compile(r"(?<![\w.])(?:\d[\d']*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?[fFuUlLzZ]*(?![\w.])")
TEXT = re.compile(r'//[^\n]*|/\*.*?\*/|R"\((?:.*?)\)"|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])\'', re.S)
DIRECTIVE = re.compile(r"^\s*#.*$", re.M)
TEMPLATE = re.compile(r"(?<=\w)<[^<>;(){}]*>")  # twice: one within another
EXTENT = re.compile(r"\[\d*\]")
FIXED = re.compile(r"\bFixed\([^)]*\)")  # an option that is gone, with its last default
STRUCT = re.compile(r"^ *struct \w+[^;{]*\{.*?^ *\};", re.M | re.S)
# A constant's, a member's or an argument's name, with what it is set to. Arrays may be over several lines.
CONSTANT = re.compile(r"\b(?:constexpr|const)\b[^;{}()=]*?\bk[A-Z]\w*(?:\[\w*\])?\s*(?==|\{)[^;]*;")
DEFAULT = re.compile(r"^[ \t]+(?!return\b|const\b)(?:std::|Eigen::)?[A-Za-z][\w:<>, ]*\s+\w+\s*=[^;()]*;", re.M)
ARGUMENT = re.compile(r"[\w>&]\s+\w+\s*=\s*(-?[\d.][\w.]*)\s*[,)]")


def value(literal):
    return float(re.sub(r"['fFuUlLzZ]", "", literal))


def blank(match):
    return re.sub(r"[^\n]", " ", match[0])


def of_code(text, header):
    """(line, literal, "named" or "inline") of each tuned number."""
    for pattern in (TEXT, DIRECTIVE, FIXED, TEMPLATE, TEMPLATE, EXTENT):
        text = pattern.sub(blank, text)
    found = []

    def take(begin, end, what):
        nonlocal text
        for number in NUMBER.finditer(text, begin, end):
            if value(number[0]) not in FREE:
                found.append((text.count("\n", 0, number.start()) + 1, number[0], what))
        text = text[:begin] + NUMBER.sub(blank, text[begin:end]) + text[end:]

    bodies = [(0, len(text))] if header else [match.span() for match in STRUCT.finditer(text)]
    for pattern, spans in ((CONSTANT, [(0, len(text))]), (DEFAULT, bodies), (ARGUMENT, [(0, len(text))] if header else [])):
        for begin, end in spans:
            for match in list(pattern.finditer(text, begin, end)):
                take(*match.span(), "named")
    for number in list(NUMBER.finditer(text)):
        if re.search(r"[.eE]", number[0]):
            take(*number.span(), "inline")
    return sorted(found)


def of_yaml(text):
    """Of kinds of sensors, the figures without a source."""
    found, in_kinds = [], False
    for at, line in enumerate(text.splitlines(), 1):
        in_kinds = in_kinds or line.startswith("- kind:")
        figures, _, comment = line.partition("#")
        if not in_kinds or re.search(r"\[[MP]\]", comment):
            continue
        if re.match(r"\s+(?:errors:\s*\{|lens_sigmas:|\w+:\s*[\d.])", figures):
            found += [(at, number[0], "YAML") for number in NUMBER.finditer(figures) if value(number[0]) not in FREE]
    return found


def files_of(root, module):
    if (root / module).is_file():
        return [root / module]
    folder = root / module
    return sorted(folder.glob("*.[ch]*")) if folder.is_dir() else sorted(folder.parent.glob(folder.name + ".*"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", nargs="?", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[1])
    parser.add_argument("--list", action="store_true", help="each number with its place")
    parser.add_argument("--modules", nargs="+", help="others than the limits', without limits")
    options = parser.parse_args()
    total, wrong = 0, []
    for module in options.modules or LIMITS:
        counts = dict.fromkeys(("named", "inline", "YAML"), 0)
        for path in files_of(options.root, module):
            text = path.read_text()
            for line, literal, what in of_yaml(text) if path.suffix == ".yaml" else of_code(text, path.suffix == ".h"):
                counts[what] += 1
                if options.list:
                    print(f"{path.relative_to(options.root)}:{line}: {literal} ({what})")
        count = sum(counts.values())
        total += count
        print(f"{module}: {count} (" + ", ".join(f"{n} {what}" for what, n in counts.items() if n) + ")")
        if not options.modules and count != LIMITS[module]:
            wrong.append(f"{module} has {count} tuned numbers, its limit is {LIMITS[module]}: " +
                         ("take one away, or derive the new one" if count > LIMITS[module] else "lower the limit"))
    print(f"total: {total}")
    sys.exit("\n".join(wrong) or 0)


if __name__ == "__main__":
    main()
