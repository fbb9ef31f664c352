#!/usr/bin/env bash
# All that a machine with a GPU is asked for, in one command:
#   tests/gpu.sh [--minutes N] [--device cuda|cpu] [--output FOLDER]
# builds against the LibTorch that CMake finds (CMAKE_PREFIX_PATH, docs/install.md), runs the tests, prints one table (tests/bench/gpu_table.py), and spends
# what is left of N minutes (30) on training m01 to m07 (configs/paper/long.yaml), in three processes, one for each set of samples. The same command goes on where it
# was stopped. FOLDER (out/gpu) then has table.md, the runs, and the weights of each model in a file under 16 MB.
# A rehearsal without a GPU: tests/gpu.sh --device cpu --minutes 5. VOLALIGN_BUILD names a build folder to take as it is, without building and testing.
set -euo pipefail
cd "$(dirname "$0")/.."

minutes=30 device=cuda output=out/gpu
while [ $# -gt 0 ]; do
  case "$1" in
    --minutes) minutes=$2 ;;
    --device) device=$2 ;;
    --output) output=$2 ;;
    *) sed -n '3s/^# *//p' "$0" >&2; exit 1 ;;
  esac
  shift 2
done
export OMP_WAIT_POLICY=${OMP_WAIT_POLICY:-PASSIVE}  # threads that spin take the time of others
end=$((SECONDS + minutes * 60))
mkdir -p "$output"

build=${VOLALIGN_BUILD:-build/gpu}
if [ -z "${VOLALIGN_BUILD:-}" ]; then
  preset=cuda
  [ "$device" = cpu ] && preset=release
  cmake --preset "$preset" -B "$build" -DVOLALIGN_TESTS=ON
  cmake --build "$build" --target volalign core_nn_tests core_nn_cpu_tests render_tests render_egl_tests render_tiles_tests train_tests train_distributed_tests train_log_tests
  ctest --test-dir "$build" --output-on-failure -j "$(nproc)" -L quick -LE "$(tests/missing.sh "$(command -v python3)")" -R '^(core/nn|render|train)'
fi
program=$build/cli/volalign
[ -x "$program" ] || program=$build/volalign

# The table may take half of the time, and has fewer lines where that is short.
{
  echo "Relative differences from training on the CPU in float32, contiguous; the weights' are over the way that they have gone (tests/train/device_test.cc):"
  printf '%s\n' '' '| training | loss of step 1 | gradient of step 1 | weights after 4 steps |' '|---|---|---|---|'
  grep -hE '^\| c(pu|uda)' "$build/Testing/Temporary/LastTest.log" || true
  python3 tests/bench/gpu_table.py --program "$program" --device "$device" --seconds $(((end - SECONDS) / 2))
} | tee "$output/table.md"

# Each model trains in a process of its own.
left=$((end - SECONDS))
children=()
stop() { for child in "${children[@]}"; do kill -INT "$child" 2>/dev/null || true; done; }
trap stop INT TERM
for model in m01 m02 m03 m04 m05 m06 m07; do
  sed "s#^recipes:.*#recipes: [configs/$model.yaml]#" configs/paper/long.yaml >"$output/$model.yaml"
  timeout -s INT "$((left > 20 ? left - 10 : 10))" "$program" train --sweep "$output/$model.yaml" --device "$device" -o "$output/runs" >"$output/$model.log" 2>&1 &
  children+=($!)
done
for child in "${children[@]}"; do wait "$child" || true; done

for run in "$output"/runs/*/; do
  [ -f "$run/model.safetensors" ] || continue
  weights=$output/$(basename "$run").safetensors
  cp "$run/model.safetensors" "$weights"
  [ "$(stat -c %s "$weights")" -lt 16000000 ] || { echo "error: $weights has 16 MB or more" >&2; exit 1; }
done
"$program" runs list "$output/runs"
ls -l "$output"/*.safetensors
