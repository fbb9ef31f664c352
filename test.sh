#!/usr/bin/env bash
# Installs packages, builds everything and runs every test. Arguments go to ctest, for example: ./test.sh -R infer/initial
# With VOLALIGN_NO_SKIPS=1 a test that was skipped is a failure, unless all of its name matches VOLALIGN_MAY_SKIP.
set -euo pipefail
cd "$(dirname "$0")"
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}"
build_preset release -DVOLALIGN_TESTS=ON all
results=build/release/Testing/results.log
mkdir -p "$(dirname "$results")"
ctest --preset release "$@" | tee "$results"
# By CTest's list, and one by one of those that GoogleTest, pytest and a script skipped within a program that passed.
skipped=$({
  sed -nE 's/^\t *[0-9]+ - ([^ ]+) \(Skipped\)$/\1/p' "$results"
  sed -nE 's/^\[  SKIPPED \] ([^ ]+\.[^ :]+).*/\1/p; s/^SKIPPED \[[0-9]+\] ([^ ]+):[0-9]+: .*/\1/p' build/release/Testing/Temporary/LastTest.log
} | sort -u)
[ -z "${VOLALIGN_MAY_SKIP:-}" ] || skipped=$(grep -vxE "$VOLALIGN_MAY_SKIP" <<<"$skipped" || true)
if [ -n "$skipped" ] && [ -n "${VOLALIGN_NO_SKIPS:-}" ]; then
  echo "error: skipped, though VOLALIGN_NO_SKIPS is set:" $skipped >&2
  exit 1
fi
