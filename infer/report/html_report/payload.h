#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/report/extrinsics.h"
#include "infer/report/panels.h"
#include "infer/report/ply.h"

namespace volalign {

/// A frame's pictures and its cloud for the report.
struct ReportFrame {
  std::string sensor;
  FramePanels panels;
  std::vector<AlignedPoint> cloud;  ///< thinned, in the structure frame of the first capture
};

/// One capture: the structure as found, and its frames as JSON (ReportFrameJson).
struct ReportCapture {
  std::string name;
  Structure built;
  std::vector<nlohmann::ordered_json> frames;
};

/// The origin of a calibration.
struct ReportRun {
  std::string command;                 ///< as typed
  std::string options;                 ///< all of them, YAML
  std::vector<std::string> next = {};  ///< commands that may follow, each after a comment
  /// The check of an earlier calibration: check.json, and its sentences, the headline first.
  std::string check = "";
  std::vector<std::string> checked = {};
};

/// A frame's part of the payload. It encodes pictures, so call it for several frames in parallel.
nlohmann::ordered_json ReportFrameJson(const ReportFrame& frame);

/// The page's content on the rig as a whole.
struct ReportRig {
  std::string notes;                ///< sentences, a line each
  std::vector<std::string> advice;  ///< Advise
  std::string from_above;           ///< PlacedFromAbove
  std::vector<nlohmann::ordered_json>
      alternatives;  ///< AlternativeJson of each of Extrinsics::alternatives
};

/// The page's content (docs/report.md): extrinsics.json as written, and everything that this file
/// does not have.
nlohmann::ordered_json ReportPayload(const Extrinsics& extrinsics,
                                     const std::vector<ReportCapture>& captures,
                                     const ReportRig& rig, const ReportRun& run);

}  // namespace volalign
