#!/usr/bin/env bash
# From a fresh Debian 12 to calibrated sensors: installs packages, builds what `cmake --install` installs (program, Python package, C and C++ libraries),
# renders an eight-sensor capture with sensor noise in a furnished room, and calibrates it with the shipped checkpoint.
set -euo pipefail
cd "$(dirname "$0")"
source cmake/packages.sh

out=${1:-out/quickstart}
install_packages "${VOLALIGN_BUILD_PACKAGES[@]}"
build_preset release volalign volalign_python volalign_c
volalign=build/release/cli/volalign

"$volalign" render --rig configs/rig_ring8.yaml -o "$out/capture" --force
"$volalign" calibrate --capture "$out/capture/capture.json" -o "$out/calibration"

cat <<END

Look at:
  $out/calibration/report.html           the report: open it in a browser (docs/report.md explains it)
  $out/capture/contact_sheet.png         what the eight sensors measure, and the true labels
  $out/calibration/pictures/overview.png depth, labels found, the structure at the estimated poses, residuals
  $out/calibration/clouds/merged.ply     all sensors' points in the structure's frame (any point cloud viewer)
  $out/calibration/rig.glb               stack, sensors and points as glTF (Blender, MeshLab)
  $out/calibration/extrinsics.json       the poses, with their convention and uncertainty
END
