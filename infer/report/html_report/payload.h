#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/clouds.h"
#include "infer/report/extrinsics.h"
#include "infer/report/panels.h"

namespace volalign {

/// "data:image/png;base64,...", with a palette where 256 colours suffice.
std::string PngDataUri(const RgbImage& picture);

/// "#rrggbb"
std::string HexColour(Rgb colour);

/// A cloud in the page: little-endian bytes, in base64.
inline constexpr double kPointStep = 0.0005;      ///< m, of a coordinate, in 16 bits
inline constexpr double kResidualStep = 0.00025;  ///< m, of a residual, in 8 bits
inline constexpr int kNoResidual = -128;
struct EncodedCloud {
  std::size_t count = 0;
  std::string positions;  ///< x y z, int16 each, in steps of kPointStep
  std::string labels;     ///< uint8
  std::string residuals;  ///< int8, in steps of kResidualStep; kNoResidual for background
};
EncodedCloud EncodeCloud(const std::vector<AlignedPoint>& points);

/// Takes at most `most` of the points, evenly. Points with a label come first, up to six tenths.
std::vector<AlignedPoint> ThinCloud(const std::vector<AlignedPoint>& points, std::size_t most);

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

/// A frame's part of the payload. `cloud`: thinned, in the structure frame of the first capture. It
/// encodes pictures, so call it for several frames in parallel.
nlohmann::ordered_json ReportFrameJson(const std::string& sensor, const FramePanels& panels,
                                       const std::vector<AlignedPoint>& cloud);

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

/// The placed sensors from above as SVG (RigFromAbove). Each name has its horizontal distance from
/// the structure's origin and its height above the floor. With `alternative`, the sensors are as in
/// that set, without ellipses; other poses have another colour.
std::string PlacedFromAbove(const std::vector<FrameResult>& sensors, const Structure& built,
                            const RigAlternative* alternative = nullptr);

/// The page's content on another set of the rig's poses: the rig from above and each sensor with
/// another pose. A sensor has its picture with the edges at that pose, and the difference of the
/// structure's outlines at both poses. The difference is 1 - intersection over union of the pixels
/// that show it. `of_capture`: the sensors with their images, of the capture with this choice.
/// Their poses and `built` are in the structure as it stood then. `sensors`: of all captures.
nlohmann::ordered_json AlternativeJson(const RigAlternative& alternative,
                                       const std::vector<FrameResult>& sensors,
                                       const std::vector<FrameResult>& of_capture,
                                       const Structure& built, const Pose& first_from_placement);

/// The report as one HTML file that needs no other. It has the page's files beside this header and
/// three.js, embedded when the program was built, around the payload (ReportPayload).
std::string ReportPage(const nlohmann::ordered_json& payload);

}  // namespace volalign
