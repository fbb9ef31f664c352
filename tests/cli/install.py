#!/usr/bin/env python3
"""Does the installed program work where the source tree is not?

    tests/cli/install.py CMAKE BUILD_FOLDER SOURCE_FOLDER [Install | WithoutSource]

Installs what ./quickstart.sh builds to a new prefix, and runs it in an empty folder. For WithoutSource an empty folder is mounted over the
source tree meanwhile, of which only the LibTorch of tests/compat/libtorch.sh stays: it needs mount namespaces for ordinary users.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "install"))
import quickstart_build  # noqa: E402

# Arguments: the source tree, the folder in it that stays if it is there, a folder to keep it in, and the command.
HIDE = """
source=$1 stays=$2 kept=$3
shift 3
if [ -d "$stays" ]; then mount --bind "$stays" "$kept"; fi
mount -t tmpfs none "$source" || exit
if mountpoint -q "$kept"; then mkdir -p "$stays" && mount --bind "$kept" "$stays"; fi
exec "$@"
"""

CMAKE, BUILD, SOURCE = sys.argv[1:4] if len(sys.argv) > 3 else ("", "", "")
del sys.argv[1:4]


class Installed(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="volalign_install_")
        self.addCleanup(shutil.rmtree, self.folder)
        self.prefix, self.work = (os.path.join(self.folder, name) for name in ("prefix", "work"))
        os.makedirs(self.work)
        quickstart_build.install(CMAKE, BUILD, SOURCE, self.prefix)
        self.hide = []

    def volalign(self, *arguments, status=0):
        environment = {key: value for key, value in os.environ.items() if key != "VOLALIGN_DATA_DIR"}
        command = self.hide + [os.path.join(self.prefix, "bin", "volalign"), *arguments]
        done = subprocess.run(command, cwd=self.work, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        self.assertEqual(done.returncode, status, done.stdout)
        return done.stdout

    def expect_a_calibration(self):
        found = self.volalign("doctor")
        self.assertIn(os.path.join(self.prefix, "share", "volalign") + "\n", found)
        self.assertIn("everything is there", found)
        self.assertIn("loss:", self.volalign("config", "show", "configs/m05.yaml"))
        self.volalign("render", "--rig", "configs/rig_ring4.yaml", "-o", "capture")
        self.volalign("calibrate", "--capture", "capture/capture.json", "--model", "models/m05-lite.safetensors", "-o", "out")
        with open(os.path.join(self.work, "out", "extrinsics.json"), encoding="utf-8") as file:
            sensors = json.load(file)["sensors"]
        self.assertEqual([sensor["status"] for sensor in sensors.values()], ["ok"] * 4)


class Install(Installed):
    def test_installed_program(self):
        self.expect_a_calibration()

    def test_completion_is_installed(self):
        file = os.path.join(self.prefix, "share", "bash-completion", "completions", "volalign")
        script = f"source '{file}'; COMP_WORDS=(volalign cali); COMP_CWORD=1; _volalign; echo ${{COMPREPLY[@]}}"
        done = subprocess.run(["bash", "-c", script], stdout=subprocess.PIPE, text=True, check=True)
        self.assertEqual(done.stdout.split(), ["calibrate"])


class WithoutSource(Installed):
    def test_installed_program(self):
        self.assertFalse(self.folder.startswith(os.path.join(SOURCE, "")), "TMPDIR lies in the source tree")
        kept = os.path.join(self.folder, "kept")
        os.makedirs(kept)
        self.hide = ["unshare", "--map-root-user", "--mount", "bash", "-c", HIDE, "bash", SOURCE, os.path.join(SOURCE, "build", "libtorch"), kept]
        with self.assertRaises(AssertionError):
            self.volalign("structure", "show", os.path.join(SOURCE, "configs", "structure.yaml"))
        self.expect_a_calibration()


if __name__ == "__main__":
    if not SOURCE:
        sys.exit(__doc__)
    unittest.main()
