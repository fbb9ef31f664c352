#!/usr/bin/env bash
# Installs packages, builds everything and runs every test.
set -euo pipefail
cd "$(dirname "$0")"
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}"
build_preset release all
ctest --preset release "$@"
