#!/usr/bin/env bash
# Installs packages, builds everything and runs every test. Arguments go to ctest, for example: ./test.sh -R infer/initial
set -euo pipefail
cd "$(dirname "$0")"
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}"
build_preset release -DVOLALIGN_TESTS=ON all
ctest --preset release "$@"
