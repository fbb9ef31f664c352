"""The program as a user runs it, in an empty folder of its own: what the scripts of this folder share."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PROGRAM = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""
sys.path.insert(0, os.path.join(ROOT, "tests"))

TWO_SENSORS = """room: true
noise: none
seed: 3
sensors:
  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30}
  - {name: B, sensor: realsense_d415, rho_cm: 200, phi_deg: 80}
"""


class InAFolder(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="volalign_cli_")
        self.addCleanup(shutil.rmtree, self.folder)

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def write(self, name, text):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with open(self.path(name), **({"mode": "wb"} if isinstance(text, bytes) else {"mode": "w", "encoding": "utf-8"})) as file:
            file.write(text)

    def remove(self, name):
        """A file or a folder, or nothing."""
        if os.path.isdir(self.path(name)):
            shutil.rmtree(self.path(name))
        elif os.path.exists(self.path(name)):
            os.remove(self.path(name))

    def read(self, *names, **how):
        with open(self.path(*names), **(how or {"encoding": "utf-8"})) as file:
            return file.read()

    def json(self, *names):
        return json.loads(self.read(*names))

    def run_line(self, line, **options):
        """Status and output (both streams) of a command line of a shell, of which `volalign` is the program."""
        done = subprocess.run(["bash", "-c", f'volalign() {{ "{PROGRAM}" "$@"; }}; {line}'], cwd=self.folder, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False, **options)
        return done.returncode, done.stdout

    def expect(self, arguments, status, *parts, **environment):
        found, output = self.run_line("volalign " + arguments, env={**os.environ, **environment})
        self.assertEqual(found, status, output)
        for part in parts:
            self.assertIn(part, output)
        return output

    def expect_error(self, arguments, *parts, **environment):
        """One line that begins with "error: ", and status 1."""
        self.assertRegex(self.expect(arguments, 1, *parts, **environment), r"\Aerror: .*\n\Z")

    def start(self, arguments):
        """The program at work; what it prints is in its stdout."""
        process = subprocess.Popen([PROGRAM, *arguments.split()], cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                   preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))  # ignored where a shell runs the tests in the background
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.kill)
        return process

    def files(self, name, unfinished=False):
        """Bytes of a file, or of each file of a folder, by path: of those that are being written, or of all others."""
        top = self.path(name)
        paths = [top] if os.path.isfile(top) else [os.path.join(where, file) for where, _, files in os.walk(top) for file in files]
        return {path: self.read(path, mode="rb") for path in paths if (".tmp-" in path) == unfinished}


def main(doc):
    if not PROGRAM:
        sys.exit(doc)
    unittest.main()
