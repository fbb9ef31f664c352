#!/usr/bin/env bash
# Fuzzes the readers of tests/fuzz/targets.cc under the sanitizers (preset fuzz). New inputs are kept in build/fuzz/found, what a reader
# does not take well in build/fuzz/findings; the script fails where there is one.
#   tests/long/fuzz.sh [SECONDS [TARGET ...]]   each target, or these, for so many seconds of processor time, without arguments 600
#   tests/long/fuzz.sh --keep [TARGET ...]      packs into tests/fuzz/corpus/TARGET.tar its inputs that have a name, and of the others, and of
#                                               those found of at most 4 kB, the fewest that reach all that they reach together
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
build_preset fuzz fuzz >/dev/null
export ASAN_SYMBOLIZER_PATH=/usr/lib/llvm-14/bin/llvm-symbolizer ASAN_OPTIONS=allocator_may_return_null=1
# Readers of files get theirs in memory.
export TMPDIR=/dev/shm
what=${1:-600}
shift || true
[ $# -gt 0 ] || set -- $(basename -s .tar tests/fuzz/corpus/*)

failed=0
for target in "$@"; do
  archive=tests/fuzz/corpus/$target.tar corpus=build/fuzz/corpus/$target found=build/fuzz/found/$target findings=build/fuzz/findings/$target-
  rm -rf "$corpus" build/fuzz/kept
  mkdir -p "$corpus" build/fuzz/kept "$found" build/fuzz/findings
  tar -xf "$archive" -C "$corpus"
  options=(--target="$target" -rss_limit_mb=1024 -timeout=10 -artifact_prefix="$findings")
  # OpenEXR asks for up to 2 GiB for an attribute before it reads it, and does not touch what the file does not have: what is used counts.
  case "$target" in exr) options+=(-malloc_limit_mb=2560) ;; esac
  if [ "$what" = --keep ]; then
    find "$corpus" -type f -regextype posix-extended ! -regex '.*/[0-9a-f]{40}' -exec cp -t build/fuzz/kept {} +
    build/fuzz/tests/fuzz/fuzz "${options[@]}" -merge=1 -max_len=4096 build/fuzz/kept "$corpus" "$found" 2>&1 | grep 'MERGE-OUTER' | tail -n 1
    tar --sort=name --format=ustar --owner=0 --group=0 --numeric-owner --mtime=@0 --mode=644 -cf "$archive" -C build/fuzz/kept $(ls build/fuzz/kept)
    continue
  fi
  dictionary=build/fuzz/$target.dict
  awk -v part="[$target]" '/^\[/ {within = $0 == part; next} within' tests/fuzz/dictionaries.txt | grep -v '^#' | grep -oE '"([^"\\]|\\.)*"' >"$dictionary" || true
  [ ! -s "$dictionary" ] || options+=(-dict="$dictionary")
  log=build/fuzz/$target.log
  build/fuzz/tests/fuzz/fuzz "${options[@]}" -max_len=65536 -print_final_stats=1 "$found" "$corpus" >"$log" 2>&1 &
  # libFuzzer counts seconds of the clock alone, and ends with its figures at this signal.
  ticks=$(($(getconf CLK_TCK) * what))
  while used=$(awk '{print $14 + $15}' /proc/$!/stat 2>/dev/null) && [ "$used" -lt "$ticks" ]; do sleep 1; done
  kill -USR1 $! 2>/dev/null || true
  wait $! || failed=1
  echo "$target: $(grep -E 'number_of_executed_units|SUMMARY|ERROR: libFuzzer' "$log" | tr -s ' \n' ' ')"
done
exit $failed
