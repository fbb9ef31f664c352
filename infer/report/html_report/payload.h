#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/report/extrinsics.h"
#include "infer/report/panels.h"
#include "infer/report/ply.h"

namespace volalign {

/// What the report shows of one frame: its pictures and its cloud, ready for the page.
struct ReportFrame {
  std::string sensor;
  FramePanels panels;
  std::vector<AlignedPoint> cloud;  ///< thinned, in the structure frame of the first still
};

/// One still: the structure as found, and its frames as JSON (ReportFrameJson).
struct ReportStill {
  std::string name;
  Structure built;
  std::vector<nlohmann::ordered_json> frames;
};

/// How a calibration was made.
struct ReportRun {
  std::string command;                 ///< as typed
  std::string options;                 ///< all of them, YAML
  std::vector<std::string> next = {};  ///< commands that may follow, each after a comment
  /// Of a check of an earlier calibration: check.json, and what it says in sentences, the headline
  /// first.
  std::string check = "";
  std::vector<std::string> checked = {};
};

/// A frame's part of the payload. Encodes pictures: to be called for several frames at a time.
nlohmann::ordered_json ReportFrameJson(const ReportFrame& frame);

/// What the page says and shows of the rig as a whole.
struct ReportRig {
  std::string notes;                ///< sentences, a line each
  std::vector<std::string> advice;  ///< Advise
  std::string from_above;           ///< PlacedFromAbove
  std::vector<nlohmann::ordered_json>
      alternatives;  ///< AlternativeJson, of each of Extrinsics::alternatives
};

/// Everything that the page shows (docs/report.md): extrinsics.json as it is written, and beside it
/// what that file does not have.
nlohmann::ordered_json ReportPayload(const Extrinsics& extrinsics,
                                     const std::vector<ReportStill>& stills, const ReportRig& rig,
                                     const ReportRun& run);

}  // namespace volalign
