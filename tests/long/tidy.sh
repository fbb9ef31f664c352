#!/usr/bin/env bash
# clang-tidy (.clang-tidy) on what changed; fails when it finds anything.
#   tests/long/tidy.sh                  every .cc file
#   tests/long/tidy.sh COMMIT           the C++ files that differ from COMMIT, and for a header every .cc that includes it directly
#   tests/long/tidy.sh FILE.cc ...      these files
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_TIDY_PACKAGES[@]}"
cmake --preset tidy >/dev/null

all() { git ls-files --cached --others --exclude-standard '*.cc'; }
case "${1:-}" in
  "") files=$(all) ;;
  *.cc) files=$(printf '%s\n' "$@") ;;
  *)
    changed=$({ git diff --name-only --diff-filter=d "$1"; git ls-files --others --exclude-standard; } | grep -E '\.(cc|h)$' || true)
    files=$(for path in $changed; do
      case "$path" in
        *.cc) echo "$path" ;;
        *.h) all | xargs grep -lF "#include \"$path\"" || true ;;
      esac
    done | sort -u)
    ;;
esac
# Benchmarks and examples are not in this preset.
files=$(grep -vE '^(tests/bench|examples)/' <<<"$files" || true)
[ -n "$files" ] || { echo "tidy: no C++ file changed"; exit 0; }
echo "tidy: $(wc -l <<<"$files") files"
# One file per process: xargs returns 123 where one of them found something.
xargs -P "$(nproc)" -n 1 clang-tidy-14 -p build/tidy --quiet --warnings-as-errors='*' <<<"$files"
