#!/usr/bin/env python3
"""Holds the layout of the source tree: who may include whom, where each library may be used, that every source file is built,
and that comments and pages cite only what is in the repository.

Rules are functions from a root folder to a list of sentences, one for each violation. The second half of this file breaks every
rule in a small tree of its own and expects the sentence, so that no rule can pass because it looks at nothing.
"""

import os
import re
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

FOLDERS = ("cli", "cmake", "configs", "core", "docs", "infer", "models", "render", "tests", "train")
CODE_FOLDERS = ("cli", "core", "infer", "render", "train")

# A room may include itself, the rooms before it, and core. "infer" is the room of the files that stand in no other: calibrate.cc,
# the order of the stages, and its result.
ROOMS = ("infer/view", "infer/pose", "infer/refine", "infer/checks", "infer", "infer/io", "infer/evaluate")

# What a folder outside infer may include beside itself; cli may include everything.
MAY_INCLUDE = {"core": (), "render": ("core",), "train": ("core", "render")}

# First folder of a library's headers, and the folders of ours that may use the library.
LIBRARIES = {
    "ceres": ("infer", "tests/infer"),
    "opencv2": ("infer/evaluate", "tests/infer"),
    "epoxy": ("render", "tests/render"),
    "EGL": ("render", "tests/render"),
    "GL": ("render", "tests/render"),
}
TORCH = ("torch", "ATen", "c10")

CITATIONS = (r"\.\./shared", r"design section", r"\bfacts/", r"design\.md", r"house-style", r"review\.md")


def files_of(root, extensions, folders=FOLDERS + (".",)):
    """Paths relative to root, sorted; "." stands for the files beside the folders."""
    found = []
    for folder in folders:
        if folder == ".":
            found += [name for name in os.listdir(root) if os.path.isfile(os.path.join(root, name))]
            continue
        for where, _, names in os.walk(os.path.join(root, folder)):
            if "__pycache__" not in where:
                found += [os.path.relpath(os.path.join(where, name), root) for name in names]
    return sorted(path for path in found if path.endswith(extensions))


def text_of(root, path):
    with open(os.path.join(root, path), encoding="utf-8") as file:
        return file.read()


def own_includes(text):
    return re.findall(r'^\s*#\s*include\s+"([^"]+)"', text, re.MULTILINE)


def library_includes(text):
    return re.findall(r"^\s*#\s*include\s+<([^/>]+)/[^>]*>", text, re.MULTILINE)


def room_of(path):
    """infer/view/x.h -> infer/view; infer/calibrate.h -> infer; core/x.h -> core."""
    parts = path.split("/")
    return "/".join(parts[:2]) if parts[0] == "infer" and len(parts) > 2 else parts[0]


def check_arrows(root):
    """An include goes only to the file's own folder or room and to those below it."""
    violations = []
    for path in files_of(root, (".h", ".cc"), CODE_FOLDERS):
        room = room_of(path)
        if room == "cli":
            continue
        if room in MAY_INCLUDE:
            allowed = (room,) + MAY_INCLUDE[room]
        elif room in ROOMS:
            allowed = ("core",) + ROOMS[: ROOMS.index(room) + 1]
            if room == "infer/evaluate":
                allowed += ("render",)
        else:
            violations.append(f"{path} is in none of the rooms {', '.join(ROOMS)}")
            continue
        for include in own_includes(text_of(root, path)):
            if room_of(include) not in allowed:
                violations.append(f"{path} includes {include}; {room} may include only {', '.join(allowed)}")
    return violations


def check_libraries(root):
    """Ceres is used in infer alone, OpenGL and EGL in render alone, OpenCV in the evaluation and infer's tests."""
    violations = []
    for path in files_of(root, (".h", ".cc"), CODE_FOLDERS + ("tests",)):
        for library in library_includes(text_of(root, path)):
            homes = LIBRARIES.get(library)
            if homes and not path.startswith(tuple(home + "/" for home in homes)):
                violations.append(f"{path} uses {library}, which only {' and '.join(homes)} may")
    return violations


def check_ceres_and_torch(root):
    """No .cc sees headers of both: each defines macros (CHECK, LOG) that the other one defines otherwise."""

    def libraries_seen(path, seen):
        libraries = set()
        if path in seen or not os.path.exists(os.path.join(root, path)):
            return libraries
        seen.add(path)
        text = text_of(root, path)
        libraries.update(library_includes(text))
        for include in own_includes(text):
            libraries |= libraries_seen(include, seen)
        return libraries

    violations = []
    for path in files_of(root, (".cc",), CODE_FOLDERS + ("tests",)):
        libraries = libraries_seen(path, set())
        if "ceres" in libraries and libraries.intersection(TORCH):
            violations.append(f"{path} sees headers of Ceres and of LibTorch, itself or through what it includes")
    return violations


def check_listed(root):
    """Every .cc stands in the nearest CMakeLists.txt: as a source, or, NAME_test.cc, as the test NAME."""
    violations = []
    for path in files_of(root, (".cc",), CODE_FOLDERS + ("tests",)):
        folder = os.path.dirname(path)
        while folder and not os.path.exists(os.path.join(root, folder, "CMakeLists.txt")):
            folder = os.path.dirname(folder)
        listing = os.path.join(folder, "CMakeLists.txt")
        words = set()
        if folder:
            lines = [line.split("#")[0] for line in text_of(root, listing).splitlines()]
            words = set(re.split(r"[\s()]+", " ".join(lines)))
        names = {os.path.relpath(path, folder or ".")}
        if path.endswith("_test.cc"):
            test = path[: -len("_test.cc")]
            names |= {os.path.relpath(test, "tests"), os.path.relpath(test, folder or ".")}
        if not names & words:
            violations.append(f"{path} is not in {listing}")
    return violations


def check_citations(root):
    """Files cite no document that is not in the repository. Tests may use ../shared, where real frames may lie."""
    violations = []
    extensions = (".h", ".cc", ".md", ".yaml", ".txt", ".cmake", ".json", ".sh", ".py")
    for path in files_of(root, extensions) + files_of(root, ("run",), (".ci",)):
        if path == "tests/layout_test.py":
            continue
        for number, line in enumerate(text_of(root, path).splitlines(), 1):
            for citation in CITATIONS:
                if re.search(citation, line) and not (citation == CITATIONS[0] and path.startswith("tests/")):
                    violations.append(f"{path}:{number} cites what is not in the repository: {line.strip()}")
    return violations


def check_paths(root):
    """Links of pages, and paths of ours that pages, comments and options name, exist. A .yaml in code may be an example."""
    violations = []
    shape = r"(?<![\w/.-])(?:%s)/[\w./-]*\.(?:%s)\b"
    in_code = re.compile(shape % ("|".join(FOLDERS), "h|cc|sh|py|md|cmake"))
    in_pages = re.compile(shape % ("|".join(FOLDERS), "h|cc|sh|py|md|cmake|yaml|pt|txt"))
    link = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
    for path in files_of(root, (".h", ".cc", ".md", ".yaml", ".sh")):
        text = text_of(root, path)
        named = in_pages if path.endswith(".md") else in_code
        targets = [(name, name) for name in named.findall(text) if not path.startswith("tests/")]
        if path.endswith(".md"):
            targets += [
                (name, os.path.normpath(os.path.join(os.path.dirname(path), name)))
                for name in link.findall(text)
                if "://" not in name
            ]
        for name, target in targets:
            if not os.path.exists(os.path.join(root, target)):
                violations.append(f"{path} names {name}, which does not exist")
    return violations


class Repository(unittest.TestCase):
    """The rules on the repository itself."""

    def expect_none(self, violations):
        if violations:
            self.fail("\n  " + "\n  ".join(violations))

    def test_finds_the_sources(self):
        self.assertGreater(len(files_of(ROOT, (".cc",), CODE_FOLDERS)), 60)
        self.assertGreater(len(files_of(ROOT, (".md",))), 8)

    def test_arrows(self):
        self.expect_none(check_arrows(ROOT))

    def test_libraries(self):
        self.expect_none(check_libraries(ROOT))

    def test_ceres_and_torch(self):
        self.expect_none(check_ceres_and_torch(ROOT))

    def test_listed(self):
        self.expect_none(check_listed(ROOT))

    def test_citations(self):
        self.expect_none(check_citations(ROOT))

    def test_paths(self):
        self.expect_none(check_paths(ROOT))


class Rules(unittest.TestCase):
    """Each rule on a small tree that keeps it, and on trees that break it."""

    def violations(self, check, files):
        with tempfile.TemporaryDirectory() as root:
            for path, text in files.items():
                os.makedirs(os.path.join(root, os.path.dirname(path)), exist_ok=True)
                with open(os.path.join(root, path), "w", encoding="utf-8") as file:
                    file.write(text)
            return check(root)

    def expect(self, check, files, expected):
        """expected: paths of the files that are to be reported, one for each violation, in order."""
        reported = [re.match(r"[^\s:]+", violation)[0] for violation in self.violations(check, files)]
        self.assertEqual(reported, expected, files)

    def test_arrows(self):
        def include(path, *headers):
            return {path: "".join(f'#include "{header}"\n' for header in headers)}

        allowed = [
            ("core/a.cc", "core/a.h"),
            ("render/a.cc", "core/a.h", "render/a.h"),
            ("train/a.cc", "core/a.h", "render/a.h", "train/a.h"),
            ("infer/view/a.cc", "core/a.h", "infer/view/a.h"),
            ("infer/pose/a.cc", "infer/view/a.h", "infer/pose/a.h"),
            ("infer/refine/a.cc", "infer/view/a.h", "infer/pose/a.h"),
            ("infer/checks/a.cc", "infer/refine/a.h"),
            ("infer/calibrate.cc", "infer/calibrate.h", "infer/view/a.h", "infer/pose/a.h", "infer/refine/a.h", "infer/checks/a.h"),
            ("infer/io/a.cc", "infer/calibrate.h", "infer/view/a.h"),
            ("infer/evaluate/a.cc", "infer/io/a.h", "infer/calibrate.h", "render/a.h"),
            ("cli/a.cc", "train/a.h", "infer/evaluate/a.h"),
        ]
        for case in allowed:
            self.expect(check_arrows, include(*case), [])
        forbidden = [
            ("core/a.h", "render/a.h"),
            ("core/a.h", "infer/view/a.h"),
            ("core/a.h", "tests/a.h"),
            ("render/a.cc", "train/a.h"),
            ("render/a.cc", "infer/view/a.h"),
            ("train/a.cc", "infer/view/a.h"),
            ("infer/view/a.cc", "infer/pose/a.h"),
            ("infer/view/a.cc", "render/a.h"),
            ("infer/pose/a.cc", "infer/refine/a.h"),
            ("infer/refine/a.cc", "infer/checks/a.h"),
            ("infer/checks/a.cc", "infer/calibrate.h"),
            ("infer/calibrate.cc", "infer/io/a.h"),
            ("infer/calibrate.cc", "render/a.h"),
            ("infer/io/a.cc", "infer/evaluate/a.h"),
            ("infer/io/a.cc", "render/a.h"),
            ("infer/evaluate/a.cc", "train/a.h"),
            ("infer/evaluate/a.cc", "cli/a.h"),
        ]
        for case in forbidden:
            self.expect(check_arrows, include(*case), [case[0]])
        self.expect(check_arrows, {"infer/lobby/a.cc": ""}, ["infer/lobby/a.cc"])

    def test_libraries(self):
        self.expect(check_libraries, {"infer/refine/a.cc": "#include <ceres/ceres.h>\n", "render/a.cc": "#include <epoxy/gl.h>\n"}, [])
        self.expect(check_libraries, {"core/a.cc": "#include <ceres/ceres.h>\n"}, ["core/a.cc"])
        self.expect(check_libraries, {"render/a.cc": "#include <opencv2/core.hpp>\n"}, ["render/a.cc"])
        self.expect(check_libraries, {"infer/view/a.cc": "#include <epoxy/gl.h>\n"}, ["infer/view/a.cc"])

    def test_ceres_and_torch(self):
        ceres = "#include <ceres/ceres.h>\n"
        tensor = {"core/t.h": "#include <ATen/core/Tensor.h>\n", "core/u.h": '#include "core/t.h"\n'}
        check = check_ceres_and_torch
        self.expect(check, {"infer/refine/a.cc": ceres, "core/b.cc": '#include "core/u.h"\n', **tensor}, [])
        self.expect(check, {"infer/refine/a.cc": ceres + "#include <torch/torch.h>\n"}, ["infer/refine/a.cc"])
        self.expect(check, {"infer/refine/a.cc": ceres + '#include "core/u.h"\n', **tensor}, ["infer/refine/a.cc"])

    def test_listed(self):
        files = {
            "core/CMakeLists.txt": "set(CORE_SOURCES\n  a.cc)\n",
            "core/a.cc": "",
            "infer/CMakeLists.txt": "volalign_library(infer SOURCES view/b.cc)\n",
            "infer/view/b.cc": "",
            "tests/infer/CMakeLists.txt": "volalign_test(infer/view/b DEPENDS volalign::infer)\n",
            "tests/infer/view/b_test.cc": "",
            "tests/train/CMakeLists.txt": "foreach(name losses)\n  volalign_test(train/${name})\nendforeach()\n",
            "tests/train/losses_test.cc": "",
        }
        self.expect(check_listed, files, [])
        for stray in ("core/c.cc", "infer/view/a.cc", "tests/infer/view/a_test.cc", "tests/train/a_test.cc"):
            self.expect(check_listed, {**files, stray: ""}, [stray])
        commented = {**files, "core/CMakeLists.txt": "set(CORE_SOURCES)  # a.cc\n"}
        self.expect(check_listed, commented, ["core/a.cc"])

    def test_citations(self):
        self.expect(check_citations, {"docs/a.md": "artefacts/x\n", "tests/cli/a_test.cc": '"../shared/captures"\n'}, [])
        for words in ("../shared/x", "design section 4", "facts/sensors.md", "design.md", "house-style", "review.md"):
            for path in ("core/a.h", "docs/a.md", "README.md", "configs/a.yaml", ".ci/run"):
                self.expect(check_citations, {"docs/b.md": "", path: f"# see {words}\n"}, [path])
        self.expect(check_citations, {"tests/core/a_test.cc": "// facts/sensors.md\n"}, ["tests/core/a_test.cc"])

    def test_paths(self):
        files = {"core/a.h": "// see docs/a.md\n", "docs/a.md": "[b](../README.md#top) [c](https://x.org/core/y.h) `core/a.h`\n", "README.md": ""}
        self.expect(check_paths, files, [])
        self.expect(check_paths, {**files, "docs/b.md": "[x](missing.md)\n"}, ["docs/b.md"])
        self.expect(check_paths, {**files, "docs/b.md": "`core/missing.h`\n"}, ["docs/b.md"])
        self.expect(check_paths, {**files, "core/b.cc": '"see core/missing.h"\n'}, ["core/b.cc"])


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    unittest.main()
