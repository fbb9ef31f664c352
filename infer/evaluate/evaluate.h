#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/metrics.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/calibrate.h"
#include "infer/io/capture.h"
#include "infer/view/segmenter.h"
#include "render/rig.h"

namespace volalign {

class DepthRenderer;

/// One still of a rig, with what is known about it.
struct EvaluationStill {
  Structure structure;              ///< nominal
  std::vector<SensorFrame> frames;  ///< with ground truth where there is one
  std::vector<LabelImage> labels;   ///< what each sensor truly sees; empty for a real capture
  /// Best rigid fit of the boxes' corners as they stand onto the nominal ones: no capture can tell
  /// the nominal frame from the one in which the boxes' displacements average out.
  Pose nominal_from_built = Pose::Identity();
};

/// A still that is made when its turn comes.
struct EvaluationItem {
  std::string rig;      ///< name of the rig, or the capture's path
  std::string sensors;  ///< pool name that all sensors were set to; "as the rig"; "" for a capture
  std::optional<std::uint64_t> seed;
  std::string identity;  ///< everything that the still depends on
  std::function<EvaluationStill()> load;
};

/// The still of a rendered rig.
EvaluationStill StillOf(const RigCapture& capture);

/// A rig to render. `sensors`, where not empty, takes the place of every sensor's own model (at the
/// pool's own image size). The renderer must outlive the item. Throws IoError when the structure or
/// the intrinsics cannot be read.
EvaluationItem RigItem(const std::string& name, Rig rig, const std::string& sensors,
                       DepthRenderer* renderer);

/// A capture.json, of the structure that it names or else `structure`. Throws IoError.
EvaluationItem CaptureItem(const std::filesystem::path& path, const Structure& structure);

/// Calibration options to compare, e.g. {"paper", ...} and {"robust", ...}.
struct EvaluationVariant {
  std::string name;
  CalibrateOptions options;
};

/// One sensor's outcome. Errors and intervals stand where there is a ground truth and the sensor
/// was placed.
struct EvaluatedSensor {
  std::string name;
  std::string status;  ///< "ok", "weak", "failed"
  std::string code;
  int sides = 0;
  /// Whether the sides that it truly sees, each with evidence.min_pixels, fix six degrees of
  /// freedom (SidesFixPose).
  std::optional<bool> sides_fix_pose;
  double initial_rms_to_structure_m = 0, rms_to_structure_m = 0, inlier_share = 0;

  /// Estimated against true poses. `built`: against those in the frame in which the boxes'
  /// displacements average out.
  struct Errors {
    PoseError initial, refined;
    /// [translation; rotation vector], m and rad, that takes the refined pose to the true one
    /// (PerturbLeft), which the covariance is of.
    Vector6d delta = Vector6d::Zero();
  };
  std::optional<Errors> nominal, built;
  Vector6d sigma = Vector6d::Zero();  ///< square roots of the covariance's diagonal, m and rad

  bool placed() const { return status != "failed"; }
};

/// One still under one variant.
struct EvaluatedCase {
  std::string fingerprint;  ///< of the item, the variant and the program
  std::string rig, sensors, variant;
  std::optional<std::uint64_t> seed;
  std::vector<EvaluatedSensor> results;
  std::map<std::string, double> timings_s;
};

/// [translation; rotation vector] with PerturbLeft(delta, from) = to.
Vector6d LeftDifference(const Pose& from, const Pose& to);

/// Calibrates a still under each variant; the network sees each frame once.
std::vector<EvaluatedCase> EvaluateStill(const EvaluationStill& still,
                                         const std::vector<EvaluationVariant>& variants,
                                         Segmenter& segmenter);

struct ErrorStatistics {
  double median = 0, p95 = 0, max = 0;
};

/// Sensors of one rig (or "all"), one choice of sensors and one variant. Statistics are over the
/// placed sensors with a ground truth.
struct EvaluationSummary {
  std::string rig, sensors, variant;
  int count = 0, placed = 0, weak = 0;
  int fixable = 0;  ///< sensors whose true sides fix a pose
  int lost = 0;     ///< of those: failed
  int wrong = 0;    ///< placed, over 10 cm or 5 deg off
  int measured = 0;
  ErrorStatistics initial_mm, initial_deg, refined_mm, refined_deg;
  ErrorStatistics built_initial_mm, built_initial_deg, built_refined_mm, built_refined_deg;
  /// Shares of the six components of all sensors within their central 68 % and 95 % intervals.
  double cover68 = 0, cover95 = 0, built_cover68 = 0, built_cover95 = 0;
};

/// Every rig x sensors x variant in order of appearance, then pooled over rigs, then over all.
/// Cases of captures without any ground truth are left out.
std::vector<EvaluationSummary> SummariseCases(const std::vector<EvaluatedCase>& cases);

struct EvaluateRun {
  std::filesystem::path output;  ///< evaluation.json; what is in it is not done again
  std::string model_file, model_sha256;
  std::string program;                                    ///< identifies the program's build
  std::function<void(const std::string& line)> progress;  ///< a line a still
};

/// Evaluates every item under every variant and writes `output` after each still (atomically), so
/// that a killed run continues where it was. Results in it that another program, model, option or
/// still gave are dropped. `structure` is the network's: a still whose structure has other sides is
/// an error. Throws what loading, rendering and calibration throw, and DataError for an `output`
/// that is no evaluation.
std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    Segmenter& segmenter, const Structure& structure,
                                    const EvaluateRun& run);

inline constexpr char kEvaluationFormat[] = "volalign.evaluation/1";
std::vector<EvaluatedCase> ReadEvaluation(const std::filesystem::path& path);

/// Markdown: accuracy; placement and intervals; one row a sensor of every capture.
std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases);

/// "1000:1020" (1000 to 1019), "7" or "1,5,9". Throws ConfigError.
std::vector<std::uint64_t> ParseSeeds(const std::string& text);

}  // namespace volalign
