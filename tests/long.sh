#!/usr/bin/env bash
# What takes hours: scripts of tests/long, which can be run by themselves, too. Each leaves its log in build/long.
#   tests/long.sh               all of them
#   tests/long.sh STEP ...      these: coverage tsan tests sanitize tidy fuzz figures flat pip
set -uo pipefail
cd "$(dirname "$0")/.."

all=(coverage tsan tests sanitize tidy fuzz figures flat pip)
[ $# -gt 0 ] || set -- "${all[@]}"
mkdir -p build/long
failed=0
for step in "$@"; do
  script=$(compgen -G "tests/long/$step.*") || { echo "error: no step $step; there are: ${all[*]}" >&2; exit 1; }
  start=$SECONDS
  if "$script" >"build/long/$step.log" 2>&1; then outcome=passed; else outcome=FAILED failed=1; fi
  echo "$step: $outcome after $(((SECONDS - start) / 60)) min; build/long/$step.log"
done
exit $failed
