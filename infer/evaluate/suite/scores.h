#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/metrics.h"
#include "infer/evaluate/suite/suite_config.h"

namespace volalign {

/// A pose of one view, scored.
struct ViewPoseScore {
  bool placed = false;
  std::optional<PoseScore> labels;  ///< placed, by a method with labels
  std::optional<PoseError> error;   ///< placed, where there is a ground truth
};

struct ViewScores {
  std::string name;
  std::vector<ViewPoseScore> stages;    ///< of CaptureScores::stages
  std::optional<PoseScore> floor;       ///< the method's labels at the true pose
  std::optional<double> miou_of_truth;  ///< the method's labels against the true ones
};

struct StageScores {
  std::string stage;  ///< of a PoseStage
  std::optional<double> d1_m, d2_m;
};

/// The scores of one method on one capture.
struct CaptureScores {
  std::string fingerprint;  ///< of everything that it depends on
  std::string dataset, set_up, capture, method;
  std::vector<StageScores> stages;
  std::vector<ViewScores> views;
  std::optional<double> d1_floor_m, d2_floor_m;  ///< at the true poses, of all views
  double seconds = 0;
};

/// Scores a method's poses. The points of d1 and d2 are those of the pixels that truly show the
/// structure, in the views that the method placed. They are the same for every method. For a
/// recording, whose true labels nobody knows, they are those that the method labelled. Errors and
/// floors are in the frame in which the boxes' own displacements average out
/// (EvaluationCapture::nominal_from_built).
CaptureScores ScoreCapture(const SuiteCapture& capture, const MethodResult& result, int min_pixels);

void WriteScores(const std::filesystem::path& path, const CaptureScores& scores);
/// Reads the scores of a capture. Throws IoError or DataError.
CaptureScores ReadScores(const std::filesystem::path& path);

/// All scores as the JSON text of suite.json.
std::string FormatScores(const std::vector<CaptureScores>& scores);

}  // namespace volalign
