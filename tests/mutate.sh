#!/usr/bin/env bash
# Makes mutations of tests/mutations.tsv, one after the other, and finds the test that fails: first the one of the table, then those
# of the file's own room, then all. Notes it in the table. Fails where no test notices one ("survives") or its line is gone. Each costs minutes.
#   tests/mutate.sh             all but those that make no difference ("equivalent")
#   tests/mutate.sh 3 17        these
#   tests/mutate.sh --own 3 17  these, with the tests of the room alone; what they miss is left open
set -euo pipefail
cd "$(dirname "$0")/.."
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}"
own=
if [ "${1:-}" = --own ]; then own=1; shift; fi
[ $# -gt 0 ] || set -- $(awk -F'\t' '$7 !~ /^equivalent/ {print $1}' tests/mutations.tsv)
[ -z "$(git status --porcelain core render infer train)" ] || { echo "error: core, render, infer or train has changes" >&2; exit 1; }
for number in "$@"; do tests/mutations.py applies "$number"; done
trap 'git checkout -q -- core render infer train' EXIT
cmake --preset release -DVOLALIGN_TESTS=ON >/dev/null

# first_failure CTEST-ARGUMENTS: the first test that fails or takes too long; nothing where all pass.
first_failure() { ctest --preset release --stop-on-failure --timeout 600 "$@" 2>&1 | sed -nE 's/.*Test +#[0-9]+: ([^ ]+) .*(Failed|Timeout|Exception|Subprocess).*/\1/p' | head -n 1 || true; }

# of_room LABEL ROOM TESTS: the same of a room's quick or slow tests, where it has any, that match.
of_room() {
  local program=${2//\//_}_tests
  [ "$1" = quick ] || program=${2//\//_}_slow_tests
  if cmake --build --preset release --target "$program" >/dev/null 2>&1; then first_failure -L "$1" -R "^$3\$"; fi
}

survivors=0
for number in "$@"; do
  known=$(awk -F'\t' -v number="$number" '$1 == number && $7 !~ / / {print $7}' tests/mutations.tsv)
  room=$(tests/mutations.py apply "$number")
  caught=
  if ! cmake --build --preset release --target "volalign_${room//\//_}" >/dev/null; then
    caught="the compiler"
  else
    if [ -n "$known" ]; then
      for label in quick slow; do caught=${caught:-$(of_room "$label" "$(dirname "$known")" "$known")}; done
    fi
    for label in quick slow; do caught=${caught:-$(of_room "$label" "$room" "$room/[^/]*")}; done
    if [ -z "$caught" ] && [ -z "$own" ]; then
      cmake --build --preset release --target all >/dev/null
      caught=$(first_failure)
      caught=${caught:-survives}
    fi
  fi
  git checkout -q -- core render infer train
  [ -z "$caught" ] || tests/mutations.py record "$number" "$caught"
  [ "$caught" != survives ] || survivors=$((survivors + 1))
  echo "$number $room: ${caught:-open}"
done
[ "$survivors" -eq 0 ] || { echo "error: $survivors survived" >&2; exit 1; }
