"""Calibrates capture/capture.json by the package that is installed in the folder of the argument (tests/long/pip.sh)."""

import sys

import volalign

assert volalign.__file__.startswith(sys.argv[1] + "/lib/"), volalign.__file__
result = volalign.calibrate(volalign.Capture.load("capture/capture.json"))
print(volalign.__version__, result.model, result)
assert result.model and [sensor.status for sensor in result.sensors.values()] == ["ok"] * 8
