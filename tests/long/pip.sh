#!/usr/bin/env bash
# The wheel that `pip install .` makes, in an environment of its own, calibrates the quick start's capture from another folder.
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh
install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" python3-venv
build_preset release -DVOLALIGN_TESTS=ON volalign
folder=$PWD/build/long/pip
rm -rf "$folder"
/usr/bin/python3 -m venv "$folder"
"$folder/bin/pip" install .
build/release/cli/volalign render --rig configs/rig_ring8.yaml -o "$folder/capture"
cd "$folder"
bin/python3 - <<'PYTHON'
import sys, volalign
assert volalign.__file__.startswith(sys.prefix + "/lib/"), volalign.__file__
result = volalign.calibrate(volalign.Capture.load("capture/capture.json"))
print(volalign.__version__, result.model, result)
assert result.model and [sensor.status for sensor in result.sensors.values()] == ["ok"] * 8
PYTHON
