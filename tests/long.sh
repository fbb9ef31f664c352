#!/usr/bin/env bash
# What takes hours, in steps that can be run singly; each leaves its log in build/long.
#   tests/long.sh               all of them
#   tests/long.sh STEP ...      these: coverage tsan tests kills sanitize tidy fuzz mutations figures flat pip
set -uo pipefail
cd "$(dirname "$0")/.."
source cmake/packages.sh

# Lines of each room that ran in the quick and slow tests of the four libraries.
coverage() {
  install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
  build_preset coverage all
  rm -rf build/coverage/profiles
  ctest --preset coverage -R '^(core|render|train|infer)/' || return 1
  llvm-profdata-14 merge -o build/coverage/all.profdata build/coverage/profiles/*.profraw
  local programs
  mapfile -t programs < <(find build/coverage/tests -name '*_tests' -type f -printf '-object\n%p\n')
  llvm-cov-14 export -summary-only -instr-profile build/coverage/all.profdata "${programs[@]:1}" >build/coverage/lines.json
  python3 - <<'PYTHON'
import collections, json, os

lines, ran = collections.Counter(), collections.Counter()
for entry in json.load(open("build/coverage/lines.json"))["data"][0]["files"]:
    room = os.path.dirname(os.path.relpath(entry["filename"]))
    for name in {room, room.split("/")[0]}:
        lines[name] += entry["summary"]["lines"]["count"]
        ran[name] += entry["summary"]["lines"]["covered"]
for name in sorted(lines):
    if name.split("/")[0] in ("core", "render", "train", "infer"):
        print(f"{name:24} {100 * ran[name] / lines[name]:5.1f} % of {lines[name]} lines")
PYTHON
}

# Races between threads of the parts that have any.
tsan() {
  install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
  build_preset tsan quick_tests_core quick_tests_render quick_tests_train render_slow_tests infer_calib_slow_tests
  ctest --preset tsan -R '^(core|render|train)/.*|^infer/calib/calibrate$' -L 'quick|slow'
}

# With all that they draw by chance.
tests() { VOLALIGN_LONG=1 ./test.sh; }
kills() { VOLALIGN_KILLS=200 ./test.sh -R '^(cli/stopped|train/kill|core/base/folder|infer/report/export|render/dataset)$'; }
sanitize() { tests/sanitize.sh; }
fuzz() { tests/fuzz/run.sh 600; }
mutations() { tests/mutate.sh; }
tidy() { tests/tidy.sh --all; }

# The wheel that `pip install .` makes, in an environment of its own, calibrates the quick start's capture from another folder.
pip() {
  install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" python3-venv
  build_preset release -DVOLALIGN_TESTS=ON volalign
  rm -rf build/long/pip
  /usr/bin/python3 -m venv build/long/pip
  build/long/pip/bin/pip install .
  build/release/cli/volalign render --rig configs/rig_ring8.yaml -o build/long/pip/capture
  cd build/long/pip
  bin/python3 - <<'PYTHON'
import volalign

assert "/build/long/pip/lib/" in volalign.__file__, volalign.__file__
result = volalign.calibrate(volalign.Capture.load("capture/capture.json"))
print(volalign.__version__, result.model, result)
assert result.model and [sensor.status for sensor in result.sensors.values()] == ["ok"] * 8
PYTHON
}

# The command of docs/results.md again, whose numbers are the README's: as many sensors, medians and 95th percentiles within a tenth, shares of
# the intervals within 3 of 100.
figures() {
  build_preset release -DVOLALIGN_TESTS=ON volalign
  rm -rf build/long/evaluation
  /usr/bin/python3 - <<'PYTHON'
import json, re, statistics, subprocess, sys

import numpy

page = open("docs/results.md", encoding="utf-8").read().split("### ")[0]
command = re.search(r"^    volalign (evaluate .*?) -o \S+$", page, re.DOTALL | re.MULTILINE)[1].replace("\\\n", " ").split()
subprocess.run(["build/release/cli/volalign", *command, "-o", "build/long/evaluation"], check=True)
evaluation = json.load(open("build/long/evaluation/evaluation.json"))
failed = False
for kind in ("azure_kinect_nfov_binned", "realsense_d415"):
    errors_row, placed_row = ([cell.strip() for cell in row.split("|")] for row in re.findall(rf"^\| all rigs \| {kind} \|.*$", page, re.MULTILINE))
    median, p95, _ = map(float, errors_row[5].split("/"))
    placed = int(placed_row[3].split()[0])
    shares = [float(placed_row[column].split()[0]) / 100 for column in (7, 8)]
    errors = [1000 * sensor["error"]["refined"]["translation_m"] for case in evaluation["cases"] if case["sensor_model"] == kind
              for sensor in case["sensors"] if "refined" in sensor.get("error", {})]
    rows = [row for row in evaluation["summary"] if row["sensor_model"] == kind]
    weight = sum(row["measured"] for row in rows)
    cover = [sum(row[key] * row["measured"] for row in rows) / weight for key in ("cover_68", "cover_95")]
    found = statistics.median(errors), numpy.percentile(errors, 95)
    print(f"{kind}: {found[0]:.1f} / {found[1]:.1f} mm, page {median} / {p95}; {cover[0]:.2f} and {cover[1]:.2f} of the intervals, page {shares}; "
          f"{len(errors)} sensors, page {placed}")
    failed |= len(errors) != placed or found[0] > 1.1 * median or found[1] > 1.1 * p95
    failed |= any(abs(share - said) > 0.03 for share, said in zip(cover, shares))
sys.exit(failed)
PYTHON
}

# Memory (kB) and handles of a process that repeats one thing, after the first tenth and at the end.
flat() {
  build_preset release -DVOLALIGN_TESTS=ON volalign volalign_python
  python3 - <<'PYTHON'
import subprocess, sys, time, os, tempfile

def use(pid):
    status = open(f"/proc/{pid}/status").read()
    return int(status.split("VmRSS:")[1].split()[0]), len(os.listdir(f"/proc/{pid}/fd"))

with tempfile.TemporaryDirectory() as folder:
    run = subprocess.Popen(
        ["build/release/cli/volalign", "train", "--config", "configs/m05-lite.yaml", "-o", folder + "/run", "--set", "run.samples=100000",
         "run.batch_size=2", "model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36]",
         "data.sensors=[azure_kinect_nfov_binned]", "run.threads=1", "run.validation_samples=2", "loss.min_side_pixels=3",
         "run.checkpoint_every=20000"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seen = []
    while run.poll() is None:
        time.sleep(2)
        try:
            seen.append(use(run.pid))
        except (OSError, IndexError):
            break
    if run.wait() != 0 or len(seen) < 20:
        sys.exit(f"training: status {run.returncode}, {len(seen)} looks")
    early, late = seen[len(seen) // 10], seen[-2]
    print(f"50,000 training steps: {early} -> {late} kB, handles")
    if late[0] > 1.1 * early[0] or late[1] > early[1] + 2:
        sys.exit("training grows")
PYTHON
  # 2,000 times, in one process, a calibration, its result as a dict, and two calls that fail.
  VOLALIGN_LONG=1 PYTHONPATH=build/release/bindings/python /usr/bin/python3 -m pytest -q -rP -p no:cacheprovider tests/bindings/python/process_test.py -k nothing_leaks
}

all=(coverage tsan tests kills sanitize tidy fuzz mutations figures flat pip)
[ $# -gt 0 ] || set -- "${all[@]}"
mkdir -p build/long
failed=0
for step in "$@"; do
  case " ${all[*]} " in *" $step "*) ;; *) echo "error: no step $step; there are: ${all[*]}" >&2; exit 1 ;; esac
  start=$SECONDS
  if (set -e; "$step") >"build/long/$step.log" 2>&1; then outcome=passed; else outcome=FAILED failed=1; fi
  echo "$step: $outcome after $(((SECONDS - start) / 60)) min; build/long/$step.log"
done
exit $failed
