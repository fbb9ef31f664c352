#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "core/metrics.h"
#include "core/pose.h"
#include "infer/calibrate.h"

namespace volalign {

inline constexpr char kExtrinsicsFormat[] = "volalign.extrinsics/1";

/// extrinsics.json (design section 9). An empty string or optional is a key that is absent.
struct Extrinsics {
  struct Sensor {
    std::string name;
    std::string status;  ///< "ok", "weak", "failed"
    std::string code, reason, hint;
    // Of placed sensors.
    std::optional<Pose> structure_from_sensor, initial;
    std::string refinement;  ///< "accepted", "kept_initial"
    std::vector<std::string> sides;
    int points = 0;
    double rms_to_structure_m = 0, initial_rms_to_structure_m = 0, inlier_share = 0;
    double miou = 0, label_iou = 0, explained_share = 0;
    /// True depth = measured depth (m) * depth_gain + depth_offset_m.
    double depth_offset_m = 0, depth_gain = 1;
    double sigma_depth_offset_m = 0, sigma_depth_gain = 0;
    std::vector<std::string> unconstrained;  ///< UnconstrainedDirections of the covariance
    Matrix6d covariance = Matrix6d::Zero();
    Eigen::Vector3d sigma_translation_m = Eigen::Vector3d::Zero();
    Eigen::Vector3d sigma_rotation_deg = Eigen::Vector3d::Zero();
    std::optional<PoseError> error, initial_error;
    // Of every sensor.
    Intrinsics intrinsics;
    std::vector<std::string> depth;  ///< one file is written as a string, several as a list
    double depth_scale = 0.001;
    int quarter_turns = 0;
    std::string serial;
  };

  /// How the boxes stand (infer/checks/assembly.h).
  struct Assembly {
    std::string code;  ///< empty: as described
    std::string sentence;
    std::string box, other_box;
    int turn_deg = 0;
    double overlap = 0, described_overlap = 0;
  };

  std::string tool;
  std::string capture;
  std::string structure_name, structure_sha256;
  std::string model_file, model_sha256;
  std::string verdict;
  std::vector<Sensor> sensors;
  /// A box as it was found: displacement of its centre, m, and turn about the vertical through it.
  struct Box {
    std::string name;
    bool estimated = false;
    Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();
    double yaw_deg = 0;
    double sigma_x_m = 0, sigma_z_m = 0, sigma_yaw_deg = 0;
  };
  std::vector<Box> boxes;
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
  std::optional<Assembly> assembly;
  std::vector<PairResult> pairs;
  std::optional<SetDistances> metrics;
  std::vector<std::pair<std::string, double>> timings_s;
};

/// Where a calibration's input came from.
struct ExtrinsicsSource {
  std::string capture;
  std::string model_file, model_sha256;  ///< empty without a network
};

Extrinsics MakeExtrinsics(const CalibrationResult& result, const std::vector<SensorFrame>& frames,
                          const Structure& structure, const ExtrinsicsSource& source);

/// Writes atomically. Throws IoError, or Error for a number that is not finite.
void WriteExtrinsics(const std::filesystem::path& path, const Extrinsics& extrinsics);

/// Reads what WriteExtrinsics wrote, strictly. Throws IoError or DataError.
Extrinsics ReadExtrinsics(const std::filesystem::path& path);

}  // namespace volalign
