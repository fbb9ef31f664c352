#!/usr/bin/env bash
# Installs packages, builds everything, and runs every test that this machine can (tests/missing.sh). Arguments go to ctest, for example:
# ./test.sh -R infer/initial, or ./test.sh -L 'quick|slow' for all but the longest. The Python of build/venv is taken where there is one.
set -euo pipefail
cd "$(dirname "$0")"
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}"
python=/usr/bin/python3
[ ! -x build/venv/bin/python3 ] || python=$PWD/build/venv/bin/python3
build_preset release -DVOLALIGN_TESTS=ON -DPython3_EXECUTABLE="$python" -DPython_EXECUTABLE="$python" all
ctest --preset release -LE "$(tests/missing.sh "$python")" "$@"
