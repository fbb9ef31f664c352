#!/usr/bin/env bash
# Trains one small network on six variants of its recipe, and the full one with two more seeds, and scores all on
# the same validation samples (configs/ablation.yaml, all effects on) and, where given, on real captures.
#   tests/bench/ablation.sh PROGRAM OUT [CAPTURE.json...]
# A variant whose scores are in OUT already is not run again.
set -euo pipefail
program=$1
out=$2
shift 2
captures=("$@")

exact=(data.assembly.position_mm=0 data.assembly.yaw_deg=0 data.assembly.size_scale_percent=0 data.assembly.floor_tilt_deg=0)
bare=(data.scene.room_probability=0 data.scene.distractor_probability=0 data.scene.occluder_probability=0
      "data.scene.clutter_count=[0,0]" "data.scene.tripod_count=[0,0]")

# run NAME KEY=VALUE...
run() {
  local name=$1
  shift
  [ ! -f "$out/$name/done" ] || return 0
  rm -rf "${out:?}/$name"
  mkdir -p "$out/$name"
  local assignments=()
  for assignment in "$@"; do assignments+=(--set "$assignment"); done
  "$program" train --config configs/ablation.yaml "${assignments[@]}" -o "$out/$name" 2>"$out/$name/train.log"
  "$program" validate --model "$out/$name/model.safetensors" --config configs/ablation.yaml --samples 1000 >"$out/$name/validation.txt"
  if [ ${#captures[@]} -gt 0 ]; then
    "$program" evaluate --model "$out/$name/model.safetensors" --captures "${captures[@]}" -o "$out/$name/captures" \
      >"$out/$name/captures.md" 2>/dev/null || true
  fi
  touch "$out/$name/done"
}

run paper-noise data.noise.models=paper "${bare[@]}" "${exact[@]}"
run rooms data.noise.models=paper "${exact[@]}"
run sensors "${exact[@]}"
run full
run no-attention model.attention=false
run no-procrustes loss.procrustes=false
run full-seed-2 run.seed=2
run full-seed-3 run.seed=3

for name in paper-noise rooms sensors full no-attention no-procrustes full-seed-2 full-seed-3; do
  echo "## $name"
  grep ' all ' "$out/$name/validation.txt"
  [ ! -f "$out/$name/captures.md" ] || cat "$out/$name/captures.md"
done
