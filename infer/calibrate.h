#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/config.h"
#include "core/metrics.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/checks/assembly.h"
#include "infer/checks/outcome.h"
#include "infer/pose/agreement.h"
#include "infer/pose/initial_pose.h"
#include "infer/refine/refine.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What a placed sensor has to show. All shares are of pixels that contradict or confirm the pose,
/// so that neither a near nor a far sensor is favoured.
struct VerdictOptions {
  double min_valid_share = 0.01;
  double min_inlier_share = 0.5;
  double min_explained_share = 0.4;
  double max_see_through_share = 0.2;
  double min_label_iou = 0.25;
  double max_sigma_translation_m = 0.25;
  double weak_inlier_share = 0.8;
  double weak_label_iou = 0.5;
  double weak_rms_m = 0.02;
  double weak_sigma_translation_m = 0.02;
  double weak_sigma_rotation_deg = 1.5;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("min_valid_share", min_valid_share,
       "least share of pixels with depth; below it: failed, no_depth", Between(0, 1));
    ar("min_inlier_share", min_inlier_share,
       "least share of confidently labelled pixels within 3 cm of the side that they name; chance "
       "finds a "
       "side or two in a room, but not most of what the network marked",
       Between(0, 1));
    ar("min_explained_share", min_explained_share,
       "least share of the pixels that would show the structure whose depth is on it; under a half "
       "leaves room for "
       "something that stands in front",
       Between(0, 1));
    ar("max_see_through_share", max_see_through_share,
       "largest share of unoccluded such pixels that measured something behind the structure, "
       "which no "
       "true pose does but along borders",
       Between(0, 1));
    ar("min_label_iou", min_label_iou,
       "least intersection over union of side-labelled pixels, as predicted and as seen from the "
       "pose",
       Between(0, 1));
    ar("max_sigma_translation_m", max_sigma_translation_m,
       "standard deviation of the position that the sensor's own view leaves, m, above which it "
       "fixes no pose",
       Above(0));
    ar("weak_inlier_share", weak_inlier_share, "inlier share below which a placed sensor is weak",
       Between(0, 1));
    ar("weak_label_iou", weak_label_iou,
       "that intersection over union below which a placed sensor is weak", Between(0, 1));
    ar("weak_rms_m", weak_rms_m, "RMS to the structure, m, above which a placed sensor is weak",
       Above(0));
    ar("weak_sigma_translation_m", weak_sigma_translation_m,
       "standard deviation of the sensor's position, m, above which it is weak", Above(0));
    ar("weak_sigma_rotation_deg", weak_sigma_rotation_deg,
       "standard deviation of its rotation, deg, above which it is weak", Above(0));
  }
};

struct CalibrateOptions {
  InitialPoseOptions initial;
  RefineOptions refine;
  VerdictOptions verdict;
  AssemblyOptions assembly;
  int threads = 2;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("initial", initial, "initial pose of each sensor");
    ar("refine", refine, "joint refinement");
    ar("verdict", verdict, "what a placed sensor has to show");
    ar("assembly", assembly, "recognition of a stack that is built otherwise");
    ar("threads", threads, "threads over sensors", AtLeast(1));
  }
};

/// One sensor's outcome (design section 9). Failed: code, reason and hint, no pose. Weak: a pose,
/// and what to be wary of.
struct SensorOutcome {
  std::string name;
  SensorStatus status = SensorStatus::kFailed;
  SensorCode code = SensorCode::kNone;
  std::string reason;  ///< a sentence
  std::string hint;    ///< what to do about it

  std::optional<Pose> structure_from_sensor;
  Pose initial = Pose::Identity();  ///< of a placed sensor
  bool refinement_accepted = false;
  std::vector<std::string> sides;  ///< found and in agreement with the pose
  int points = 0;                  ///< side-labelled pixels with depth
  double rms_to_structure_m = 0;
  double initial_rms_to_structure_m = 0;
  double inlier_share = 0;
  double miou = 0;             ///< predicted labels against those rendered at the pose
  double label_iou = 0;        ///< Agreement::score
  double explained_share = 0;  ///< of the pixels that would show the structure, on it
  Matrix6d covariance = Matrix6d::Zero();
  /// True depth = measured depth * depth_gain + depth_offset_m; 1 and 0 where the capture does not
  /// tell. Residuals are corrected by it. The sigmas are posterior ones in either case.
  double depth_offset_m = 0, depth_gain = 1;
  double sigma_depth_offset_m = 0, sigma_depth_gain = 0;
  std::optional<PoseError> error, initial_error;  ///< where there is a ground truth

  int quarter_turns = 0;

  Eigen::Vector3d sigma_translation_m() const {
    return covariance.diagonal().head<3>().cwiseSqrt();
  }
  Eigen::Vector3d sigma_rotation_deg() const;
};

/// The outcome with the images that it comes from.
struct SensorResult : SensorOutcome {
  SegmentationResult segmentation;  ///< full size
  SensorView view;                  ///< the frame as it was used: depths as measured, and rays
};

struct PairResult {
  std::string a, b;
  double overlap = 0;
  double rms_m = 0;
};

struct CalibrationResult {
  std::vector<SensorResult> sensors;
  std::vector<PairResult> pairs;
  std::optional<SetDistances> metrics;     ///< absent when no sensor was placed
  std::optional<AssemblyReport> assembly;  ///< absent when no sensor sees four sides for sure
  std::vector<std::pair<std::string, double>> timings_s;
  /// The structure with its boxes where the capture shows them and the size that it shows, which
  /// residuals and d1, d2 refer to; the nominal one where nothing was estimated.
  Structure built;
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;

  /// The worst of the sensors' statuses.
  SensorStatus verdict() const;
  int placed() const;
};

/// Calibrates a rig from depth maps and intrinsics in memory: no file, no GL context. A sensor that
/// cannot be placed is `failed` with a code; the others are placed without it. d1 and d2 (design
/// section 10) compare at most 100 000 side-labelled points within 10 cm of the structure, evenly
/// taken from all placed sensors, with its surface sampled at 5 mm. Throws ConfigError for invalid
/// options and DataError for frames that contradict their intrinsics or share a name.
CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options = {});

/// Point-to-surface residuals of design section 9.
struct SurfaceFit {
  int points = 0;           ///< pixels with a side label and depth
  double rms_m = 0;         ///< over those within 10 cm
  double inlier_share = 0;  ///< within 3 cm
};
SurfaceFit FitToSurface(const SensorView& view, const LabelImage& labels,
                        const Structure& structure, const Pose& structure_from_sensor);

}  // namespace volalign
