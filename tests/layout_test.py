#!/usr/bin/env python3
"""Holds the layout of the source tree: which module may include which, where each library may be used, that every source file is built,
that no test is skipped, and that comments and pages cite only what is in the repository.

A module is a folder with its library. A rule is a function that gives a sentence for each violation."""

import functools
import os
import pathlib
import re
import sys
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
FOLDERS = ("bindings", "cli", "cmake", "configs", "core", "docs", "examples", "infer", "models", "render", "tests", "train")
CODE_FOLDERS = ("bindings", "cli", "core", "infer", "render", "train")
CODE = (".h", ".cc", ".inc")

# The folders of modules, and those whose modules theirs may depend on besides; bindings may include everything.
MAY_DEPEND = {"core": (), "render": ("core",), "train": ("core", "render"), "infer": ("core",), "infer/evaluate": ("core", "infer", "render"), "cli": ("core", "infer", "render", "train")}

# First folder of a library's headers, and the library's target in CMake.
HEADERS = {
    "ATen": "torch",
    "CLI": "CLI11::CLI11",
    "EGL": "PkgConfig::EGL",
    "Eigen": "Eigen3::Eigen",
    "GL": "PkgConfig::EPOXY",
    "OpenEXR": "OpenEXR::OpenEXR",
    "assimp": "assimp::assimp",
    "c10": "torch",
    "caffe2": "torch",
    "ceres": "Ceres::ceres",
    "embree3": "embree",
    "epoxy": "PkgConfig::EPOXY",
    "fmt": "fmt::fmt",
    "google": "onnx_proto",
    **dict.fromkeys(("libavcodec", "libavformat", "libavutil"), "PkgConfig::FFMPEG"),
    "nlohmann": "nlohmann_json::nlohmann_json",
    "onnx": "onnx_proto",
    "opencv2": "opencv_core",
    "openssl": "OpenSSL::Crypto",
    "torch": "torch",
    "yaml-cpp": "yaml-cpp",
}

# The modules that alone may name a library. Others build and are installed without it.
HOMES = {
    **dict.fromkeys(("BZip2::BZip2", "OpenEXR::OpenEXR", "PkgConfig::FFMPEG", "PkgConfig::LZ4", "PkgConfig::ZSTD", "SQLite::SQLite3",
                     "TIFF::TIFF", "ZLIB::ZLIB"), ("infer/formats",)),
    "Ceres::ceres": ("infer/refine",),
    "PkgConfig::EGL": ("render/egl",),
    "PkgConfig::EPOXY": ("render/egl",),
    "assimp::assimp": ("core/geometry",),
    "embree": ("core/geometry",),
    "onnx_proto": ("core/model", "core/nn", "infer/segment_onnx"),
    "opencv_core": ("cli", "infer/evaluate", "infer/segment_onnx"),
    "opencv_dnn": ("infer/segment_onnx",),
    "torch": ("core/nn", "core/nn/cpu", "train", "train/distributed"),
}

# What no line of code has, and why.
FORBIDDEN = (
    (r"#include <regex>", CODE_FOLDERS, "recurses as deep as the text is long; scan the text instead"),
    (r"\b(strto[df]|sto[df]|atof)\(", CODE_FOLDERS, "reads numbers by the locale; NumberOf (core/base/number.h) does not"),
    (r"GTEST_SKIP|pytest\.(skip|importorskip)|mark\.skip|unittest\.skip|skipTest|exit\(77\)", ("tests",), "skips a test; it needs a label (tests/missing.sh)"),
)

LINE = 200  # the most characters of a line of a page
CITATIONS = (r"\.\./shared", r"design section", r"\bfacts/", r"design\.md", r"house-style", r"review\.md")


def files_of(extensions, folders=FOLDERS + (".",)):
    """Paths, sorted; "." stands for the files beside the folders."""
    found = []
    for folder in folders:
        for where, below, names in os.walk(os.path.join(ROOT, folder)):
            found += [os.path.normpath(os.path.relpath(os.path.join(where, name), ROOT)) for name in names if name.endswith(extensions)]
            if folder == ".":
                below.clear()
    return sorted(found)


@functools.lru_cache(maxsize=None)
def text_of(path):
    return pathlib.Path(ROOT, path).read_text(encoding="utf-8")


def exists(path):
    return os.path.exists(os.path.join(ROOT, path))


def own_includes(path):
    return re.findall(r'^\s*#\s*include\s+"([^"]+)"', text_of(path), re.MULTILINE)


def library_includes(path):
    """First folders of the libraries' headers that the file includes."""
    return re.findall(r"^\s*#\s*include\s+<([^/>]+)/[^>]*>", text_of(path), re.MULTILINE)


def words_of(listing):
    return "\n".join(line.split("#")[0] for line in text_of(listing).splitlines())


def cmake_calls(listing, command):
    """The words of each call of a command."""
    return [words.split() for words in re.findall(r"\b" + command + r"\(([^()]*)\)", words_of(listing))]


def section(words, name):
    """The words of a call after the keyword, up to the next one."""
    found = []
    for word in words[words.index(name) + 1 :] if name in words else []:
        if re.fullmatch("[A-Z_]{4,}", word):
            break
        found.append(word)
    return found


class Module:
    """What it names in DEPENDS and in PRIVATE_DEPENDS, modules by their folders; and the paths of its PUBLIC_HEADERS."""

    def __init__(self, folder, words):
        self.folder, self.headers = folder, [f"{folder}/{name}" for name in section(words, "PUBLIC_HEADERS")]
        self.public, self.private = (list(map(folder_of, section(words, name))) for name in ("DEPENDS", "PRIVATE_DEPENDS"))


def folder_of(target):
    """volalign::core_nn_cpu -> core/nn/cpu, if there is that folder; else the target."""
    name = target[len("volalign::") :] if target.startswith("volalign::") else ""
    return next((folder for folder in LIBRARIES if folder.replace("/", "_") == name), target)


LIBRARIES = {words[0]: (os.path.dirname(path), words) for path in files_of(("CMakeLists.txt",), CODE_FOLDERS) for words in cmake_calls(path, "volalign_library")}
MODULES = {name: Module(folder, words) for name, (folder, words) in LIBRARIES.items()}


def reach(targets):
    """These modules and libraries, and those that come with them in headers."""
    found, waiting = set(), list(targets)
    while waiting:
        target = waiting.pop()
        if target not in found:
            found.add(target)
            waiting += MODULES[target].public if target in MODULES else []
    return found


def module_of(path):
    """The module in whose folder, or in a folder of whose folder, the file is; infer/evaluate/suite/x.h -> infer/evaluate. None outside."""
    folder = os.path.dirname(path)
    while folder and folder not in MODULES:
        folder = os.path.dirname(folder)
    return folder or None


def check_modules():
    """A module has the name of its folder, depends only on what its top folder may, and names the modules that it includes and no others."""
    for name, module in sorted(MODULES.items()):
        listing = f"{module.folder}/CMakeLists.txt"
        if name != module.folder:
            yield f"{listing} makes {name}, which is not its folder"
        top = name if name in MAY_DEPEND else name.split("/")[0]
        included = {module_of(include) for path in files_of(CODE, (name,)) if module_of(path) == name for include in own_includes(path)}
        for target in module.public + module.private:
            if target in MODULES and target.split("/")[0] not in (name.split("/")[0],) + MAY_DEPEND[top]:
                yield f"{listing} names {target}; {top} may depend on {', '.join(MAY_DEPEND[top]) or 'nothing else'}"
            if target in MODULES and target not in included:
                yield f"{listing} names {target}, of which {name} includes nothing"
            if target not in MODULES and name not in HOMES.get(target, (name,)):
                yield f"{listing} names {target}, which only {' and '.join(HOMES[target])} may"
        if f"| `{name}` |" not in text_of("docs/architecture.md"):
            yield f"docs/architecture.md has no row of {name}"


def wrong_includes(path, may, own):
    """Of what the file includes, what is neither of the module itself nor within reach."""
    for include in own_includes(path):
        module = module_of(include)
        if not (include.startswith("tests/") and path.startswith("tests/")) and (module is None or (module != own and module not in may)):
            yield f"{path} includes {include}, but {own or 'the test'} does not name {module or 'its module'}"
    for library in library_includes(path):
        if library in HEADERS and HEADERS[library] not in may:
            yield f"{path} includes <{library}/...>, but {own or 'the test'} does not name {HEADERS[library]}"


def check_includes():
    """A header includes its own module and what DEPENDS reaches, a source also what PRIVATE_DEPENDS does."""
    for path in files_of(CODE, CODE_FOLDERS):
        name = module_of(path)
        if name:
            module = MODULES[name]
            # Libraries are private too where only headers within the project include theirs.
            private = module.private if not path.endswith(".h") else [target for target in module.private if target not in MODULES]
            yield from wrong_includes(path, reach(module.public) | reach(private), name)
        elif not path.startswith("bindings/"):
            yield f"{path} is in no module"


def check_public():
    """A header that is installed includes none that is not, nor do the examples; its libraries come with its module."""
    public = {header for module in MODULES.values() for header in module.headers}
    for path in sorted(public) + files_of(CODE, ("examples",)):
        yield from (f"{path} includes {include}, which is no public header" for include in own_includes(path) if include not in public)
        for library in library_includes(path) if path in public else ():
            if library in HEADERS and HEADERS[library] not in reach(MODULES[module_of(path)].public):
                yield f"{path} is public and includes <{library}/...>, but DEPENDS do not name {HEADERS[library]}"


def with_included(path, folders):
    """The file and all of these folders that it includes, itself or through others."""
    found, waiting = [], [path]
    while waiting:
        path = waiting.pop()
        if path not in found and exists(path):
            found.append(path)
            waiting += [include for include in own_includes(path) if include.startswith(folders)]
    return found


def check_tests():
    """The tests of a program include what its DEPENDS reach, and DEPENDS names no module of which none includes anything."""
    for words in cmake_calls("tests/CMakeLists.txt", "volalign_tests"):
        named = list(map(folder_of, section(words, "DEPENDS")))
        files = {file for test in section(words, "TESTS") for file in with_included(f"tests/{words[0]}/{test}_test.cc", ("tests/",))}
        for file in sorted(files):
            yield from wrong_includes(file, reach(named) | {"CLI11::CLI11"}, None)
        included = {module_of(include) for file in files for include in own_includes(file)}
        for target in named:
            if (target in MODULES and target not in included) or target.startswith("volalign::"):
                yield f"{words[0]} names {target}, of which its tests include nothing, or which is no module"


def check_ceres_and_torch():
    """No .cc sees headers of both: each defines macros (CHECK, LOG) that the other one defines otherwise."""
    for path in files_of((".cc",), CODE_FOLDERS + ("tests",)):
        seen = {HEADERS.get(library) for file in with_included(path, CODE_FOLDERS + ("tests",)) for library in library_includes(file)}
        if {"Ceres::ceres", "torch"} <= seen:
            yield f"{path} sees headers of Ceres and of LibTorch, itself or through what it includes"


def check_listed():
    """Every .cc is in the folder of a module, or in FOLDERS of it; or is named by the nearest CMakeLists.txt, or a test of volalign_tests."""
    tests = {f"tests/{words[0]}/{test}_test.cc" for words in cmake_calls("tests/CMakeLists.txt", "volalign_tests") for test in section(words, "TESTS")}
    built = {os.path.normpath(os.path.join(folder, below)) for folder, words in LIBRARIES.values() for below in ["."] + section(words, "FOLDERS")}
    for path in files_of((".cc",), CODE_FOLDERS + ("examples", "tests")):
        folder = os.path.dirname(path)
        while not exists(folder + "/CMakeLists.txt"):
            folder = os.path.dirname(folder)
        words = words_of(f"{folder}/CMakeLists.txt")
        listed = os.path.relpath(path, folder) in re.split(r"[\s()]+", words) or '"*.cc"' in words
        if path not in tests and os.path.dirname(path) not in built and not listed:
            yield f"{path} is not in {folder}/CMakeLists.txt"


def check_lines():
    """No line has what is forbidden, cites a document that is not in the repository, or is, in a page, longer than a diff can show."""
    for path in files_of((".h", ".cc", ".inc", ".md", ".yaml", ".txt", ".cmake", ".json", ".sh", ".py")) + [".ci/run"]:
        for number, line in enumerate(text_of(path).splitlines() if path != "tests/layout_test.py" else (), 1):
            for pattern, folders, why in FORBIDDEN:
                if path.startswith(folders) and re.search(pattern, line):
                    yield f"{path}:{number} {why}"
            # Tests may use ../shared, where real frames may lie.
            if any(re.search(citation, line) for citation in CITATIONS[path.startswith("tests/") :]):
                yield f"{path}:{number} cites what is not in the repository: {line.strip()}"
            if path.endswith(".md") and path != "docs/config.md" and len(line) > LINE:
                yield f"{path}:{number} has {len(line)} characters, more than {LINE}"


def check_paths():
    """Links of pages, and paths of ours that pages, comments and options name, exist. A .yaml in code may be an example."""
    shape = r"(?<![\w/.-])(?:%s)/[\w./-]*\.(?:h|cc|sh|py|md|cmake%s)\b"
    in_code, in_pages = (re.compile(shape % ("|".join(FOLDERS), more)) for more in ("", "|yaml|pt|txt"))
    for path in files_of((".h", ".cc", ".md", ".yaml", ".sh")):
        page = path.endswith(".md")
        targets = [] if path.startswith("tests/") else [(name, name) for name in (in_pages if page else in_code).findall(text_of(path))]
        for name in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text_of(path)) if page else ():
            targets += [(name, os.path.normpath(os.path.join(os.path.dirname(path), name)))] if "://" not in name else []
        yield from (f"{path} names {name}, which does not exist" for name, target in targets if not exists(target))


class Layout(unittest.TestCase):
    def expect_none(self, check):
        violations = list(check())
        if violations:
            self.fail("\n  " + "\n  ".join(violations))

    def test_finds_the_sources(self):
        self.assertGreater(len(files_of((".cc",), CODE_FOLDERS)), 60)
        self.assertGreater(len(MODULES), 20)


for rule in (check_modules, check_includes, check_public, check_tests, check_ceres_and_torch, check_listed, check_lines, check_paths):
    setattr(Layout, "test" + rule.__name__[len("check") :], lambda self, rule=rule: self.expect_none(rule))

if __name__ == "__main__":
    sys.dont_write_bytecode = True
    unittest.main()
