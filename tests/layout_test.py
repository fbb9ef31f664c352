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

FOLDERS = ("bindings", "cli", "cmake", "configs", "core", "docs", "examples", "infer", "models", "render", "tests", "train")
CODE_FOLDERS = ("bindings", "cli", "core", "infer", "render", "train")
FRONTENDS = ("bindings/", "cli/")
CODE = (".h", ".cc", ".inc")

# The folders of rooms, and those whose rooms theirs may depend on besides; bindings and cli may include everything.
MAY_DEPEND = {"core": (), "render": ("core",), "train": ("core", "render"), "infer": ("core",), "infer/evaluate": ("core", "infer", "render")}

# First folder of a library's headers, and the library's target in CMake.
HEADERS = {
    "ATen": "torch",
    "CLI": "CLI11::CLI11",
    "EGL": "PkgConfig::EGL",
    "Eigen": "Eigen3::Eigen",
    "GL": "PkgConfig::EPOXY",
    "OpenEXR": "OpenEXR::OpenEXR",
    "c10": "torch",
    "caffe2": "torch",
    "ceres": "Ceres::ceres",
    "ebml": "Matroska::matroska",
    "epoxy": "PkgConfig::EPOXY",
    "fmt": "fmt::fmt",
    "google": "onnx_proto",
    "matroska": "Matroska::matroska",
    "nlohmann": "nlohmann_json::nlohmann_json",
    "onnx": "onnx_proto",
    "opencv2": "opencv_core",
    "openssl": "OpenSSL::Crypto",
    "torch": "torch",
    "yaml-cpp": "yaml-cpp",
}
TORCH = ("torch", "ATen", "c10", "caffe2")

# The rooms that alone may name a library. Others build and are installed without it.
HOMES = {
    "BZip2::BZip2": ("infer/formats",),
    "Ceres::ceres": ("infer/refine",),
    "Matroska::matroska": ("infer/formats",),
    "OpenEXR::OpenEXR": ("infer/formats",),
    "PkgConfig::EGL": ("render/egl",),
    "PkgConfig::EPOXY": ("render/egl",),
    "PkgConfig::LZ4": ("infer/formats",),
    "PkgConfig::ZSTD": ("infer/formats",),
    "SQLite::SQLite3": ("infer/formats",),
    "TIFF::TIFF": ("infer/formats",),
    "onnx_proto": ("core/model", "core/nn", "infer/segment_onnx"),
    "opencv_core": ("infer/evaluate", "infer/segment_onnx"),
    "opencv_dnn": ("infer/segment_onnx",),
    "torch": ("core/nn", "core/nn/cpu", "train", "train/distributed"),
}

# Sources of these rooms have a test of their room that includes their header, or that is called as they are, or stand here with the
# test that reaches them in another way.
TESTED_FOLDERS = ("infer", "render", "train")
DEPTH_FILE = "declared in depth_file.h, tested by tests/infer/formats/depth_file_test.cc"
NOISE_MODEL = "one of the models of noise.h, tested by tests/render/noise_test.cc"
POSE_FORMAT = "one of the formats that tests/infer/report/pose_format_test.cc writes and reads back"
NOISE_KERNELS = "the kernels of one instruction set, tested by tests/render/noise_kernels_test.cc"
TILE_KERNELS = "the kernels of one instruction set, tested by tests/render/tiles/tile_kernels_test.cc"
RECORDING = "declared in recording.h, tested by tests/infer/formats/recording_test.cc"
REASONS = {
    "infer/evaluate/suite/table_format.cc": "declared in table_data.h, tested by tests/infer/evaluate/suite/table_data_test.cc",
    "infer/formats/bag_recording.cc": RECORDING,
    "infer/formats/depth_exr.cc": DEPTH_FILE,
    "infer/formats/depth_npy.cc": DEPTH_FILE,
    "infer/formats/depth_tiff.cc": DEPTH_FILE,
    "infer/formats/mcap_recording.cc": RECORDING,
    "infer/formats/mkv_recording.cc": RECORDING,
    "infer/formats/poses/colmap_codec.cc": POSE_FORMAT,
    "infer/formats/poses/json_codecs.cc": POSE_FORMAT,
    "infer/formats/poses/livescan_codec.cc": POSE_FORMAT,
    "infer/formats/poses/text_codecs.cc": POSE_FORMAT,
    "infer/formats/poses/yaml_codecs.cc": POSE_FORMAT,
    "infer/formats/ros2_recording.cc": RECORDING,
    "infer/plan/target_picture.cc": "declared in target_report.h, tested by tests/infer/plan/target_report_test.cc",
    "render/noise_kernels_avx2.cc": NOISE_KERNELS,
    "render/noise_kernels_avx512.cc": NOISE_KERNELS,
    "render/noise_kernels_baseline.cc": NOISE_KERNELS,
    "render/noise_paper.cc": NOISE_MODEL,
    "render/noise_stereo.cc": NOISE_MODEL,
    "render/noise_stereo_physics.cc": NOISE_MODEL,
    "render/noise_tof.cc": NOISE_MODEL,
    "render/noise_tof_physics.cc": NOISE_MODEL,
    "render/tiles/tile_kernels_avx2.cc": TILE_KERNELS,
    "render/tiles/tile_kernels_avx512.cc": TILE_KERNELS,
    "render/tiles/tile_kernels_baseline.cc": TILE_KERNELS,
    "train/run.cc": "what Train() of trainer.h does, tested by tests/train/trainer_test.cc",
}

# The most characters of a line of a page.
LINE = 200

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


def cmake_calls(text, command):
    """The words of each call of a command, without comments."""
    text = "\n".join(line.split("#")[0] for line in text.splitlines())
    return [words.split() for words in re.findall(r"\b" + command + r"\(([^()]*)\)", text)]


def section(words, name):
    """The words of a call after the keyword, up to the next one."""
    found = []
    for word in words[words.index(name) + 1 :] if name in words else []:
        if re.fullmatch("[A-Z_]{4,}", word):
            break
        found.append(word)
    return found


class Room:
    """A library: what it names in DEPENDS and in PRIVATE_DEPENDS, rooms by their folders; and its PUBLIC_HEADERS, by their paths."""

    def __init__(self, folder, public, private, headers):
        self.folder, self.public, self.private, self.headers = folder, public, private, headers


def rooms_of(root):
    """All rooms, by their folders."""
    rooms = {}
    for path in files_of(root, ("CMakeLists.txt",), CODE_FOLDERS):
        for words in cmake_calls(text_of(root, path), "volalign_library"):
            folder = os.path.dirname(path)
            headers = [f"{folder}/{name}" for name in section(words, "PUBLIC_HEADERS")]
            rooms[words[0]] = Room(folder, section(words, "DEPENDS"), section(words, "PRIVATE_DEPENDS"), headers)
    folders = {"volalign::" + name.replace("/", "_"): name for name in rooms}
    for room in rooms.values():
        room.public = [folders.get(target, target) for target in room.public]
        room.private = [folders.get(target, target) for target in room.private]
    return rooms


def reach(rooms, targets):
    """These rooms and libraries, and those that come with them in headers."""
    found = set()
    waiting = list(targets)
    while waiting:
        target = waiting.pop()
        if target not in found:
            found.add(target)
            waiting += rooms[target].public if target in rooms else []
    return found


def room_of(path, rooms):
    """The room in whose folder, or in a folder of whose folder, the file is; infer/evaluate/suite/x.h -> infer/evaluate. None outside."""
    folder = os.path.dirname(path)
    while folder and folder not in rooms:
        folder = os.path.dirname(folder)
    return folder or None


def check_rooms(root):
    """A room has the name of its folder, depends only on what its top folder may, and names the rooms that it includes and no others."""
    violations = []
    rooms = rooms_of(root)
    for name, room in sorted(rooms.items()):
        listing = f"{room.folder}/CMakeLists.txt"
        if name != room.folder:
            violations.append(f"{listing} makes {name}, which is not its folder")
        top = name if name in MAY_DEPEND else name.split("/")[0]
        for target in room.public + room.private:
            if target in rooms:
                if target.split("/")[0] not in (name.split("/")[0],) + MAY_DEPEND[top]:
                    violations.append(f"{listing} names {target}; {top} may depend on {', '.join(MAY_DEPEND[top]) or 'nothing else'}")
                used = any(
                    room_of(include, rooms) == target
                    for path in files_of(root, CODE, (name,))
                    if room_of(path, rooms) == name
                    for include in own_includes(text_of(root, path))
                )
                if not used:
                    violations.append(f"{listing} names {target}, of which {name} includes nothing")
            elif name not in HOMES.get(target, (name,)):
                violations.append(f"{listing} names {target}, which only {' and '.join(HOMES[target])} may")
    return violations


def check_page(root):
    """The table of rooms in docs/architecture.md names all rooms, and of each what its CMakeLists.txt does."""
    violations = []
    rooms = rooms_of(root)
    page = "docs/architecture.md"
    rows = [row.split(" | ") for row in text_of(root, page).splitlines() if row.startswith("| `")]
    table = {row[0].strip("| `"): re.findall("`([^`]+)`", row[2]) for row in rows if len(row) == 4}
    for name, room in sorted(rooms.items()):
        named = sorted(target for target in room.public + room.private if target in rooms)
        if name not in table:
            violations.append(f"{page} has no row of {name}")
        elif sorted(table[name]) != named:
            violations.append(f"{page} says that {name} names {table[name]}, but it names {named}")
    return violations + [f"{page} has a row of {name}, which is no room" for name in sorted(set(table) - set(rooms))]


def includes_violations(root, rooms, path, may, own):
    """Of what the file includes, what is neither of the room itself nor within reach."""
    violations = []
    text = text_of(root, path)
    for include in own_includes(text):
        room = room_of(include, rooms)
        if include.startswith("tests/") and path.startswith("tests/"):
            continue
        if room is None or (room != own and room not in may):
            violations.append(f"{path} includes {include}, but {own or 'the test'} does not name {room or 'its room'}")
    for library in library_includes(text):
        if library in HEADERS and HEADERS[library] not in may:
            violations.append(f"{path} includes <{library}/...>, but {own or 'the test'} does not name {HEADERS[library]}")
    return violations


def check_includes(root):
    """A header includes its own room and what DEPENDS reaches, a source also what PRIVATE_DEPENDS does."""
    violations = []
    rooms = rooms_of(root)
    for path in files_of(root, CODE, CODE_FOLDERS):
        name = room_of(path, rooms)
        if path.startswith(FRONTENDS):
            continue
        if name is None:
            violations.append(f"{path} is in no room")
            continue
        room = rooms[name]
        may = reach(rooms, room.public + room.private)
        if path.endswith(".h"):
            # Libraries are private too where only headers within the project include theirs.
            may = reach(rooms, room.public) | {target for target in room.private if target not in rooms}
        violations += includes_violations(root, rooms, path, may, name)
    return violations


def check_public(root):
    """A header that is installed includes none that is not, nor do the examples; its libraries come with its room."""
    violations = []
    rooms = rooms_of(root)
    public = {header for room in rooms.values() for header in room.headers}
    for path in sorted(public) + files_of(root, CODE, ("examples",)):
        if not os.path.exists(os.path.join(root, path)):
            violations.append(f"{path} is a public header that does not exist")
            continue
        text = text_of(root, path)
        violations += [f"{path} includes {include}, which is no public header" for include in own_includes(text) if include not in public]
        if path in public:
            may = reach(rooms, rooms[room_of(path, rooms)].public)
            for library in library_includes(text):
                if library in HEADERS and HEADERS[library] not in may:
                    violations.append(f"{path} is public and includes <{library}/...>, but DEPENDS do not name {HEADERS[library]}")
    return violations


def test_files(root, path):
    """The test and the headers of tests that it includes, itself or through them."""
    found = []
    waiting = [path]
    while waiting:
        path = waiting.pop()
        if path not in found and os.path.exists(os.path.join(root, path)):
            found.append(path)
            waiting += [include for include in own_includes(text_of(root, path)) if include.startswith("tests/")]
    return found


def check_tests(root):
    """The tests of a program include what its DEPENDS reach, and DEPENDS names no room of which none includes anything."""
    violations = []
    rooms = rooms_of(root)
    folders = {"volalign::" + name.replace("/", "_"): name for name in rooms}
    for listing in files_of(root, ("CMakeLists.txt",), ("tests",)):
        for words in cmake_calls(text_of(root, listing), "volalign_tests"):
            named = [folders.get(target, target) for target in section(words, "DEPENDS")]
            tests = [f"tests/{words[0]}/{test}_test.cc" for test in section(words, "TESTS")]
            files = sorted({file for test in tests for file in test_files(root, test)})
            for file in files:
                violations += includes_violations(root, rooms, file, reach(rooms, named) | {"CLI11::CLI11"}, None)
            included = {room_of(include, rooms) for file in files for include in own_includes(text_of(root, file))}
            for target in named:
                if target in rooms and target not in included:
                    violations.append(f"{listing} names {target}, of which its tests include nothing")
                elif target.startswith("volalign::"):
                    violations.append(f"{listing} names {target}, which is no room")
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
    for path in files_of(root, (".cc",), CODE_FOLDERS + ("examples", "tests")):
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
            names.add(os.path.relpath(path[: -len("_test.cc")], folder or "."))
        if not names & words:
            violations.append(f"{path} is not in {listing}")
    return violations


def tests_of_room(root, path, rooms):
    """The tests in the folder under tests/ that mirrors the file's, and in those above it up to its room's."""
    folder, room = os.path.dirname(path), room_of(path, rooms)
    names = []
    while True:
        where = os.path.join(root, "tests", folder)
        if os.path.isdir(where):
            names += [f"tests/{folder}/{name}" for name in os.listdir(where) if name.endswith(("_test.cc", "_test.py"))]
        if folder == room or not folder:
            return names
        folder = os.path.dirname(folder)


def check_tested(root, reasons):
    """Every .cc of TESTED_FOLDERS is named by a test of its room: by NAME_test.cc or NAME_test.py, or by a _test.cc that includes its
    header NAME.h. Or the reasons say which test reaches it; they name no other sources."""
    violations = []
    rooms = rooms_of(root)
    sources = files_of(root, (".cc",), TESTED_FOLDERS)
    for path in sources:
        name = path[: -len(".cc")]
        tests = tests_of_room(root, path, rooms)
        called = {os.path.basename(test).rsplit("_test.", 1)[0] for test in tests}
        included = {include for test in tests if test.endswith(".cc") for include in own_includes(text_of(root, test))}
        tested = os.path.basename(name) in called or name + ".h" in included
        if not tested and path not in reasons:
            violations.append(f"{path} has no test in tests/{os.path.dirname(path)} of its name or that includes its header")
        elif tested and path in reasons:
            violations.append(f"{path} has a test, and a reason for having none")
    for path, reason in sorted(reasons.items()):
        if path not in sources:
            violations.append(f"{path} has a reason for having no test, and does not exist")
        tests = re.findall(r"tests/[\w./]*_test\.(?:cc|py)", reason)
        if not tests or not all(os.path.exists(os.path.join(root, test)) for test in tests):
            violations.append(f"{path} has a reason that names no test that exists: {reason}")
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


def check_regex(root):
    """None of std::regex, whose depth of calls is the length of its text: a long line of a file, or an option, ends the program."""
    return [f"{path} includes <regex>; scan the text instead" for path in files_of(root, CODE, CODE_FOLDERS) if "#include <regex>" in text_of(root, path)]


def check_locale(root):
    """None of the functions that read a number with the decimal point of the process's locale, which a library does not choose."""
    wrong = re.compile(r"\b(strto[df]|sto[df]|atof)\(")
    return [f"{path} reads numbers by the locale; NumberOf (core/base/number.h) does not" for path in files_of(root, CODE, CODE_FOLDERS) if wrong.search(text_of(root, path))]


def check_lines(root):
    """No line of a page is longer than an editor shows and a diff can compare."""
    violations = []
    for path in files_of(root, (".md",)):
        for number, line in enumerate(text_of(root, path).splitlines(), 1):
            if len(line) > LINE:
                violations.append(f"{path}:{number} has {len(line)} characters, more than {LINE}")
    return violations


def check_lists(root):
    """A list or a table of a page begins after an empty line, and so does an item after a paragraph within an item, which is
    indented by four; otherwise Python-Markdown takes it for a part of what stands before it."""
    violations = []
    item, paragraph = re.compile(r"(-|\d+\.) "), re.compile(r" {1,3}\S")
    for path in files_of(root, (".md",)):
        before, within = "", False
        for number, line in enumerate(text_of(root, path).splitlines(), 1):
            in_list = item.match(before) or before.startswith(" ") and not within
            within = line.startswith("    ") and (within or not before)
            if before and line and (item.match(line) and not in_list or line.startswith("|") != before.startswith("|") and not before.startswith(" ")):
                violations.append(f"{path}:{number} begins a block without an empty line before it")
            if not before and paragraph.match(line):
                violations.append(f"{path}:{number} begins a paragraph that is not indented by four")
            before = line
    return violations


def check_python(root):
    """Python that no test runs compiles at least."""
    violations = []
    for path in files_of(root, (".py",), ("examples",)):
        try:
            compile(text_of(root, path), path, "exec")
        except SyntaxError as error:
            violations.append(f"{path} does not compile: {error}")
    return violations


class Repository(unittest.TestCase):
    """The rules on the repository itself."""

    def expect_none(self, violations):
        if violations:
            self.fail("\n  " + "\n  ".join(violations))

    def test_finds_the_sources(self):
        self.assertGreater(len(files_of(ROOT, (".cc",), CODE_FOLDERS)), 60)
        self.assertGreater(len(files_of(ROOT, (".md",))), 8)

        self.assertGreater(len(rooms_of(ROOT)), 20)

    def test_rooms(self):
        self.expect_none(check_rooms(ROOT))

    def test_page(self):
        self.expect_none(check_page(ROOT))

    def test_includes(self):
        self.expect_none(check_includes(ROOT))

    def test_public(self):
        self.expect_none(check_public(ROOT))

    def test_tests(self):
        self.expect_none(check_tests(ROOT))

    def test_ceres_and_torch(self):
        self.expect_none(check_ceres_and_torch(ROOT))

    def test_listed(self):
        self.expect_none(check_listed(ROOT))

    def test_tested(self):
        self.expect_none(check_tested(ROOT, REASONS))

    def test_citations(self):
        self.expect_none(check_citations(ROOT))

    def test_paths(self):
        self.expect_none(check_paths(ROOT))

    def test_regex(self):
        self.expect_none(check_regex(ROOT))

    def test_locale(self):
        self.expect_none(check_locale(ROOT))

    def test_lines(self):
        self.expect_none(check_lines(ROOT))

    def test_lists(self):
        self.expect_none(check_lists(ROOT))

    def test_python(self):
        self.expect_none(check_python(ROOT))


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

    ROOMS = {
        "core/base/CMakeLists.txt": "volalign_library(core/base SOURCES a.cc DEPENDS fmt::fmt PRIVATE_DEPENDS OpenSSL::Crypto)\n",
        "core/base/a.cc": "#include <fmt/format.h>\n",
        "core/nn/CMakeLists.txt": "volalign_library(core/nn SOURCES a.cc\n  DEPENDS volalign::core_base torch)  # x)\n",
        "core/nn/a.cc": '#include "core/base/a.h"\n',
        "render/CMakeLists.txt": "volalign_library(render SOURCES a.cc DEPENDS volalign::core_base)\n",
        "render/a.cc": '#include "core/base/a.h"\n',
        "infer/view/CMakeLists.txt": "volalign_library(infer/view SOURCES a.cc DEPENDS volalign::core_base)\n",
        "infer/view/a.cc": '#include "core/base/a.h"\n',
        "infer/refine/CMakeLists.txt": "volalign_library(infer/refine SOURCES a.cc DEPENDS volalign::infer_view PRIVATE_DEPENDS Ceres::ceres)\n",
        "infer/refine/costs/a.cc": '#include "infer/view/a.h"\n',
        "infer/segment/CMakeLists.txt": "volalign_library(infer/segment SOURCES a.cc DEPENDS volalign::infer_view PRIVATE_DEPENDS volalign::core_nn)\n",
        "infer/segment/a.cc": '#include "core/nn/a.h"\n#include "infer/view/a.h"\n',
    }

    def expect_in_rooms(self, check, path, text, expected):
        self.expect(check, {**self.ROOMS, path: text}, [path] if expected is True else expected)

    def test_rooms(self):
        def library(room, rest):
            return f"volalign_library({room} SOURCES a.cc {rest})\n"

        self.expect(check_rooms, self.ROOMS, [])
        for path, text in {
            "core/base/CMakeLists.txt": library("core/bass", "DEPENDS fmt::fmt"),
            "infer/segment/CMakeLists.txt": library("infer/segment", "DEPENDS volalign::infer_view volalign::core_nn volalign::core_base"),
            "infer/view/CMakeLists.txt": library("infer/view", "PRIVATE_DEPENDS Ceres::ceres"),
            "render/CMakeLists.txt": library("render", "DEPENDS volalign::core_base torch"),
        }.items():
            self.assertIn(path, [violation.split()[0] for violation in self.violations(check_rooms, {**self.ROOMS, path: text})])
        for path, depends, include in (
            ("render", "volalign::infer_view", "infer/view/a.h"),
            ("infer/view", "volalign::render", "render/a.h"),
            ("core/base", "volalign::render", "render/a.h"),
        ):
            files = {**self.ROOMS, path + "/CMakeLists.txt": library(path, "DEPENDS " + depends), path + "/a.cc": f'#include "{include}"\n'}
            self.expect(check_rooms, files, [path + "/CMakeLists.txt"])
        evaluate = library("infer/evaluate", "DEPENDS volalign::render")
        self.expect(check_rooms, {**self.ROOMS, "infer/evaluate/CMakeLists.txt": evaluate, "infer/evaluate/a.h": '#include "render/a.h"\n'}, [])

    def test_page(self):
        rows = {
            "core/base": "| `core/base` | files | - | fmt |\n",
            "core/nn": "| `core/nn` | the network | `core/base` | LibTorch |\n",
            "render": "| `render` | scenes | `core/base` | - |\n",
            "infer/view": "| `infer/view` | frames | `core/base` | - |\n",
            "infer/refine": "| `infer/refine` | poses | `infer/view` | Ceres |\n",
            "infer/segment": "| `infer/segment` | labels | `infer/view`, `core/nn` | - |\n",
        }

        def violations(changed):
            page = "| room | what | names | and |\n" + "".join({**rows, **changed}.values())
            return self.violations(check_page, {**self.ROOMS, "docs/architecture.md": page})

        self.assertEqual(violations({}), [])
        self.assertIn("no row of render", violations({"render": ""})[0])
        self.assertIn("which is no room", violations({"x": "| `core/x` | x | - | - |\n"})[0])
        self.assertIn("infer/segment names", violations({"infer/segment": "| `infer/segment` | labels | `infer/view` | - |\n"})[0])

    def test_includes(self):
        self.expect(check_includes, self.ROOMS, [])
        for path, include in (
            ("core/nn/b.h", "core/base/b.h"),
            ("core/nn/b.h", "core/nn/c.h"),
            ("infer/refine/b.cc", "core/base/b.h"),
            ("infer/segment/b.cc", "core/nn/b.h"),
            ("infer/refine/costs/b.h", "infer/refine/b.h"),
            ("cli/b.cc", "infer/refine/b.h"),
            ("bindings/python/b.cc", "infer/refine/b.h"),
        ):
            self.expect_in_rooms(check_includes, path, f'#include "{include}"\n', [])
        for path, include in (
            ("core/base/b.h", "core/nn/b.h"),
            ("render/b.cc", "infer/view/b.h"),
            ("infer/view/b.cc", "infer/refine/costs/b.h"),
            ("infer/segment/b.h", "core/nn/b.h"),
            ("infer/view/b.cc", "tests/core/b.h"),
            ("infer/view/b.cc", "infer/lobby/b.h"),
        ):
            self.expect_in_rooms(check_includes, path, f'#include "{include}"\n', True)
        self.expect_in_rooms(check_includes, "infer/lobby/a.cc", "", True)
        for path, library in (("infer/refine/b.cc", "ceres/ceres.h"), ("infer/refine/b.h", "ceres/ceres.h"), ("render/b.cc", "fmt/format.h")):
            self.expect_in_rooms(check_includes, path, f"#include <{library}>\n", [])
        for path, library in (("infer/view/b.cc", "ceres/ceres.h"), ("infer/view/b.h", "ATen/ATen.h"), ("render/b.cc", "openssl/evp.h")):
            self.expect_in_rooms(check_includes, path, f"#include <{library}>\n", True)

    def test_public(self):
        def files(room, *includes):
            depends = "DEPENDS fmt::fmt PRIVATE_DEPENDS OpenSSL::Crypto"
            return {
                "core/base/CMakeLists.txt": f"volalign_library(core/base COMPONENT core SOURCES a.cc\n  PUBLIC_HEADERS\n    a.h\n    b.h\n  {depends})\n",
                "core/base/a.h": "",
                "core/base/b.h": "",
                "core/base/c.h": "",
                room: "".join(f"#include {include}\n" for include in includes),
            }

        self.expect(check_public, files("core/base/a.h", '"core/base/b.h"', "<fmt/format.h>", "<vector>"), [])
        self.expect(check_public, files("examples/x/main.cc", '"core/base/a.h"'), [])
        self.expect(check_public, files("core/base/c.h", "<openssl/evp.h>"), [])
        self.expect(check_public, files("core/base/a.h", '"core/base/c.h"'), ["core/base/a.h"])
        self.expect(check_public, files("examples/x/main.cc", '"core/base/c.h"'), ["examples/x/main.cc"])
        self.expect(check_public, files("core/base/a.h", "<openssl/evp.h>"), ["core/base/a.h"])
        without = {path: text for path, text in files("core/base/c.h").items() if path != "core/base/b.h"}
        self.expect(check_public, without, ["core/base/b.h"])

    def test_tests(self):
        def files(depends, *includes):
            return {
                **self.ROOMS,
                "tests/infer/view/CMakeLists.txt": f"volalign_tests(infer/view SLOW DEPENDS {depends} TIMEOUT 60 TESTS a)\n",
                "tests/infer/view/a_test.cc": "".join(f"#include {include}\n" for include in includes),
                "tests/infer/view/frames.h": '#include "infer/view/a.h"\n',
            }

        for case in (
            ("volalign::infer_view", '"infer/view/a.h"', '"core/base/a.h"', "<fmt/format.h>"),
            ("volalign::infer_view", '"tests/infer/view/frames.h"'),
            ("volalign::infer_refine Ceres::ceres", '"infer/refine/a.h"', "<ceres/ceres.h>"),
        ):
            self.expect(check_tests, files(*case), [])
        for case, reported in (
            (("volalign::core_base", '"core/base/a.h"', '"infer/view/a.h"'), "a_test.cc"),
            (("volalign::core_base", '"core/base/a.h"', '"tests/infer/view/frames.h"'), "frames.h"),
            (("volalign::infer_refine", '"infer/refine/a.h"', "<ceres/ceres.h>"), "a_test.cc"),
            (("volalign::infer_segment", '"infer/segment/a.h"', '"core/nn/a.h"'), "a_test.cc"),
            (("volalign::infer_refine", '"infer/view/a.h"'), "CMakeLists.txt"),
            (("volalign::infer_view volalign::core", '"infer/view/a.h"'), "CMakeLists.txt"),
        ):
            self.expect(check_tests, files(*case), ["tests/infer/view/" + reported])

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
            "tests/infer/view/CMakeLists.txt": "volalign_tests(infer/view DEPENDS volalign::infer TESTS b)\n",
            "tests/infer/view/b_test.cc": "",
            "tests/train/CMakeLists.txt": "set(NAMES losses log/c)\nvolalign_tests(train TESTS ${NAMES})\n",
            "tests/train/losses_test.cc": "",
            "tests/train/log/c_test.cc": "",
        }
        self.expect(check_listed, files, [])
        for stray in ("core/c.cc", "infer/view/a.cc", "tests/infer/view/a_test.cc", "tests/train/a_test.cc"):
            self.expect(check_listed, {**files, stray: ""}, [stray])
        commented = {**files, "core/CMakeLists.txt": "set(CORE_SOURCES)  # a.cc\n"}
        self.expect(check_listed, commented, ["core/a.cc"])

    def test_tested(self):
        files = {
            "train/CMakeLists.txt": "volalign_library(train SOURCES a.cc b.cc log/c.cc)\n",
            "train/a.cc": "",
            "train/b.cc": "",
            "train/log/c.cc": "",
            "core/d.cc": "",
            "tests/train/a_test.cc": '#include "train/b.h"\n',
            "tests/train/log/c_test.py": "",
        }
        reasons = {}

        def check(root):
            return check_tested(root, reasons)

        def without(path, text=None):
            changed = {name: content for name, content in files.items() if name != path}
            return changed if text is None else {**changed, path: text}

        self.expect(check, files, [])
        # A folder of a room may have its tests beside the room's; a room has its own.
        upwards = {**without("tests/train/log/c_test.py"), "tests/train/a_test.cc": '#include "train/b.h"\n#include "train/log/c.h"\n'}
        self.expect(check, upwards, [])
        own_room = {**upwards, "train/log/CMakeLists.txt": "volalign_library(train/log SOURCES c.cc)\n"}
        self.expect(check, own_room, ["train/log/c.cc"])
        self.expect(check, without("tests/train/log/c_test.py"), ["train/log/c.cc"])
        self.expect(check, without("tests/train/a_test.cc", ""), ["train/b.cc"])
        self.expect(check, without("tests/train/a_test.cc", '#include "train/log/b.h"\n'), ["train/b.cc"])
        # Not what tests include, nor tests of other rooms.
        elsewhere = {"tests/train/b.h": '#include "train/b.h"\n', "tests/infer/b_test.cc": '#include "train/b.h"\n'}
        self.expect(check, {**without("tests/train/a_test.cc", '#include "tests/train/b.h"\n'), **elsewhere}, ["train/b.cc"])

        reasons["train/b.cc"] = "declared in train/a.h, tested by tests/train/a_test.cc"
        self.expect(check, files, ["train/b.cc"])
        self.expect(check, without("tests/train/a_test.cc", ""), [])
        reasons["train/b.cc"] = "see tests/train/none_test.cc"
        self.expect(check, without("tests/train/a_test.cc", ""), ["train/b.cc"])
        reasons["train/b.cc"] = "hard to test"
        self.expect(check, without("tests/train/a_test.cc", ""), ["train/b.cc"])
        del reasons["train/b.cc"]
        reasons["train/e.cc"] = "tests/train/a_test.cc"
        self.expect(check, files, ["train/e.cc"])

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

    def test_regex(self):
        self.expect(check_regex, {"core/a.cc": "// a regex\n", "tests/core/a_test.cc": "#include <regex>\n"}, [])
        self.expect(check_regex, {"core/a.h": "", "cli/a.cc": "#include <map>\n#include <regex>\n"}, ["cli/a.cc"])

    def test_locale(self):
        self.expect(check_locale, {"core/a.cc": "astrtod(x); std::stoi(x);\n", "tests/core/a_test.cc": "std::stod(x);\n"}, [])
        self.expect(check_locale, {"core/a.cc": "std::strtod(x, y);\n", "infer/b.cc": "double x = std::stod(y);\n"}, ["core/a.cc", "infer/b.cc"])

    def test_lines(self):
        self.expect(check_lines, {"docs/a.md": "é" * LINE + "\n", "core/a.h": "x" * (LINE + 1)}, [])
        self.expect(check_lines, {"docs/a.md": "a\n" + "x" * (LINE + 1) + "\n", "README.md": ""}, ["docs/a.md"])

    def test_lists(self):
        self.expect(check_lists, {"docs/a.md": "a\n\n- b\n  c\n- d\n\n| e |\n|---|\n\n1. f\n   g\n2. h\n", "README.md": ""}, [])
        self.expect(check_lists, {"docs/a.md": "| a |\n|---|\n- b\n"}, ["docs/a.md"])
        self.expect(check_lists, {"docs/a.md": "a\n- b\n"}, ["docs/a.md"])
        self.expect(check_lists, {"docs/a.md": "1. b\n\n   c\n"}, ["docs/a.md"])
        self.expect(check_lists, {"docs/a.md": "1. b\n\n    c\n2. d\n"}, ["docs/a.md"])
        self.expect(check_lists, {"docs/a.md": "a\n| b |\n|---|\n"}, ["docs/a.md"])

    def test_python(self):
        self.expect(check_python, {"examples/a.py": "print(1)\n"}, [])
        self.expect(check_python, {"examples/a.py": "print(1\n"}, ["examples/a.py"])


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    unittest.main()
