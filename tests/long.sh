#!/usr/bin/env bash
# What takes hours, in steps that can be run singly; each leaves its log in build/long.
#   tests/long.sh               all of them
#   tests/long.sh STEP ...      these: coverage tsan tests kills sanitize tidy fuzz figures flat leaks pip
set -uo pipefail
cd "$(dirname "$0")/.."
source cmake/packages.sh

all=(coverage tsan tests kills sanitize tidy fuzz figures flat leaks pip)
declare -A commands=(
  [coverage]=tests/long/coverage.sh
  [tsan]=tests/long/tsan.sh
  [tests]='env VOLALIGN_LONG=1 ./test.sh'  # with all that they draw by chance
  [kills]='env VOLALIGN_KILLS=200 ./test.sh -R ^(train/kill|core/base/file_util|infer/report/export|render/dataset)$'
  [sanitize]=tests/sanitize.sh
  [tidy]='tests/tidy.sh --all'
  [fuzz]='tests/fuzz/run.sh 600'
  [figures]='/usr/bin/python3 tests/long/figures.py'
  [flat]='/usr/bin/python3 tests/long/flat.py'
  # 2,000 times, in one process, a calibration, its result as a dict, and two calls that fail.
  [leaks]='env VOLALIGN_LONG=1 PYTHONPATH=build/release/bindings/python /usr/bin/python3 -m pytest -q -rP -p no:cacheprovider
    tests/bindings/python/process_test.py -k nothing_leaks'
  [pip]=tests/long/pip.sh
)
[ $# -gt 0 ] || set -- "${all[@]}"
mkdir -p build/long
failed=0
for step in "$@"; do
  command=${commands[$step]:-}
  [ -n "$command" ] || { echo "error: no step $step; there are: ${all[*]}" >&2; exit 1; }
  start=$SECONDS
  case "$step" in figures | flat | leaks) build_preset release -DVOLALIGN_TESTS=ON volalign volalign_python >/dev/null || exit ;; esac
  set -f  # words, and no names of files
  if $command >"build/long/$step.log" 2>&1; then outcome=passed; else outcome=FAILED failed=1; fi
  set +f
  echo "$step: $outcome after $(((SECONDS - start) / 60)) min; build/long/$step.log"
done
exit $failed
