#!/usr/bin/env bash
# The wheel that `pip install .` makes, in an environment of its own, calibrates the quick start's capture from another folder.
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh
install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" python3-venv
build_preset release -DVOLALIGN_TESTS=ON volalign
folder=$PWD/build/long/pip check=$PWD/tests/long/installed_package.py
rm -rf "$folder"
/usr/bin/python3 -m venv "$folder"
"$folder/bin/pip" install .
build/release/cli/volalign render --rig configs/rig_ring8.yaml -o "$folder/capture"
cd "$folder"
bin/python3 "$check" "$folder"
