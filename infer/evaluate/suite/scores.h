#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/suite_config.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The metrics of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor Alignment"
/// (section Results) for one view with a pose and predicted labels.
struct PoseScore {
  /// Mean IoU of the predicted labels and the model's labels at the pose, over the pixels with
  /// depth and all classes; a class that both lack counts as 1, as in the code of the paper's
  /// authors.
  double miou_authors = 0;
  int sides = 0;  ///< predicted with at least `min_pixels` pixels
  /// The paper's 3D RMSE: root mean square, m, of the distance of each such side's mean point at
  /// the pose from the side's centre. Absent without sides.
  std::optional<double> rmse_m;
};
PoseScore ScorePose(const SensorView& view, const LabelImage& labels, const Structure& structure,
                    const Pose& structure_from_sensor, int min_pixels);

/// A column of the paper's tables.
struct ColumnStatistics {
  int count = 0;
  double mean = 0;
  double std = 0;  ///< of the population
  double rsd = 0;  ///< std / mean
  /// Mean of the groups' own std / mean. None if each group has one value. In the paper's table of
  /// the arc the RSD is 2 to 5 times below STD / mean. In all its other tables the RSD is STD /
  /// mean. This mean is as low if distances differ more than captures at one distance.
  std::optional<double> rsd_within;
};
/// `groups`: the set-up of each value.
ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups);

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

/// All scores as the JSON text of suite.json.
std::string FormatScores(const std::vector<CaptureScores>& scores);

}  // namespace volalign
