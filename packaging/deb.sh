#!/usr/bin/env bash
# Makes Debian packages of what is built: packaging/deb.sh [FOLDER] [BUILD FOLDER], by default out/packages and build/release. Install them with
# `apt install ./out/packages/*.deb`. Needs dpkg-dev and file. Set SOURCE_DATE_EPOCH for packages that are equal whenever they are made.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-out/packages}
build=${2:-build/release}
mkdir -p "$out"
cpack --config "$build/CPackConfig.cmake" -B "$out" | grep -v "^CPack: - "
rm -rf "$out/_CPack_Packages"
ls -l "$out"
