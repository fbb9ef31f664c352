"""`cmake --install` after ./quickstart.sh, from a build folder that may have more."""

import os
import re
import shutil
import subprocess
import tempfile


def targets(source):
    """What quickstart.sh builds."""
    with open(os.path.join(source, "quickstart.sh"), encoding="utf-8") as file:
        return re.search(r"^build_preset release (.+)$", file.read(), re.MULTILINE)[1].split()


def ninja(build, *arguments):
    return subprocess.run(["ninja", "-C", build, "-t", *arguments], stdout=subprocess.PIPE, text=True, check=True).stdout


def install(cmake, build, source, prefix):
    """Installs to `prefix` from a copy of the build folder that lacks what ./quickstart.sh does not build."""
    wanted = targets(source)
    outputs = {line.rpartition(": ")[0] for line in ninja(build, "targets", "all").splitlines()}
    if not outputs.issuperset(wanted):  # without LibTorch or Python
        subprocess.run([cmake, "--install", build, "--prefix", prefix], stdout=subprocess.DEVNULL, check=True)
        return
    made = set(ninja(build, "inputs", *wanted).splitlines())
    for target in wanted:
        made.update(re.findall(r"^    (\S+)$", ninja(build, "query", target).partition("outputs:")[0], re.MULTILINE))
    with tempfile.TemporaryDirectory(prefix="volalign_quickstart_") as copy:
        for folder, _, files in os.walk(build):
            if "cmake_install.cmake" not in files:
                continue
            with open(os.path.join(folder, "cmake_install.cmake"), encoding="utf-8") as file:
                script = file.read()
            for path in re.findall(rf'"({re.escape(build)}/[^"]+)"', script):
                name = os.path.relpath(path, build)
                # A link is made with the file that it leads to.
                if not os.path.isfile(path) or (name in outputs and made.isdisjoint({name, os.path.relpath(os.path.realpath(path), os.path.realpath(build))})):
                    continue
                os.makedirs(os.path.dirname(os.path.join(copy, name)), exist_ok=True)
                if name != os.path.join(os.path.relpath(folder, build), "cmake_install.cmake"):
                    shutil.copy2(path, os.path.join(copy, name), follow_symlinks=False)
            there = os.path.join(copy, os.path.relpath(folder, build))
            os.makedirs(there, exist_ok=True)
            with open(os.path.join(there, "cmake_install.cmake"), "w", encoding="utf-8") as file:
                file.write(script.replace(build + "/", copy + "/"))
        done = subprocess.run([cmake, "--install", copy, "--prefix", prefix], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode:
        raise AssertionError(f"`cmake --install` after quickstart.sh:\n{done.stdout}")
