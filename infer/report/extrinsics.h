#pragma once

#include <filesystem>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/provenance.h"
#include "core/geometry/camera.h"
#include "core/geometry/metrics.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/checks/assembly.h"
#include "infer/checks/outcome.h"
#include "infer/report/world_frame.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

inline constexpr char kExtrinsicsFormat[] = "volalign.extrinsics/1";
inline constexpr char kExtrinsicsFile[] = "extrinsics.json";  ///< in a calibration's folder

/// The origin of a calibration's input.
struct ExtrinsicsSource {
  std::vector<std::string> captures;                    ///< file of each capture
  std::string model_file, model_sha256, model_runtime;  ///< empty without a network
  std::string date = UtcNow();                          ///< of the calibration
  std::string note;                                     ///< the operator's words
  std::optional<WorldFrame> world = std::nullopt;
};

/// The content of extrinsics.json (docs/formats.md). Its keys are in extrinsics.cc and
/// describe_result.h. A number that is not finite is absent from the file and NaN when it is read.
/// It thus does not spoil the other sensors' poses.
struct Extrinsics {
  /// The colour camera beside a depth camera, with its pose if the depth camera has one.
  struct Colour : ColourCamera {
    std::optional<Pose> structure_from_colour;
  };

  struct Sensor : SensorOutcome {
    std::string sensor;  ///< its kind, as the capture names it
    std::vector<std::string> depth_files;
    double depth_scale = 0.001;  ///< m per unit of the depth files
    std::string serial, renderer;
    std::optional<Colour> colour;
    /// In Extrinsics::world, with its covariance; written from that and from the pose.
    std::optional<Pose> world_from_sensor;
    Matrix6d world_covariance = Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
  };

  /// A box as found: displacement of its centre, m, and turn about the vertical through it.
  struct Box {
    std::string name;
    bool estimated = false;
    Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();
    double yaw_deg = 0;
    double sigma_x_m = 0, sigma_z_m = 0, sigma_yaw_deg = 0;
  };

  /// The common size of all boxes.
  struct Size {
    bool estimated = false;
    double scale = 1, sigma = 0;
  };

  /// The stack's place in a capture.
  struct Placement {
    std::string name;     ///< folder of its labels and pictures, if there are several
    std::string capture;  ///< its file
    Pose first_from_placement = Pose::Identity();
    Eigen::Vector3d sigma_translation_m = Eigen::Vector3d::Zero();
    Eigen::Vector3d sigma_rotation_deg = Eigen::Vector3d::Zero();
    std::vector<std::string> sensors;  ///< the placed ones
    std::vector<Box> boxes;
    /// Covariance of delta, see PerturbLeft. NaN in files of an earlier version, which have the
    /// sigmas alone.
    Matrix6d covariance = Matrix6d::Zero();
  };

  struct StructureId {
    std::string name, sha256;
    std::optional<double> floor_m;  ///< height of the floor, its lowest y; none in files of 0.1.0
  };
  struct Model {
    std::string file, sha256;
    std::string runtime;  ///< library that ran it: "LibTorch 1.13.1"; "" in files of 0.1.0
  };

  // The origin of the file; date and libraries are "" in files of 0.1.0.
  std::string tool, date;  ///< see core/base/provenance.h
  std::string libraries;   ///< those that affect poses: "Ceres 2.1.0, Eigen 3.4.0"
  std::string note;        ///< the operator's words
  std::vector<std::string> captures;
  StructureId structure;
  std::optional<Model> model;
  std::optional<WorldFrame> world;
  SensorStatus verdict = SensorStatus::kOk;
  std::vector<RigFinding> findings;        ///< CalibrationResult::findings
  std::optional<AssemblyReport> assembly;  ///< without its structure, which is not stored
  std::vector<Sensor> sensors;
  std::vector<Box> boxes;  ///< as the first capture shows them
  Size size;
  std::vector<Placement> placements;  ///< of the captures
  SolveReport solution;
  std::vector<PairResult> pairs;
  std::vector<RigAlternative> alternatives;
  std::optional<SetDistances> metrics;
  std::vector<std::pair<std::string, double>> timings_s;
};

/// Gathers the file's content. A sensor with numbers that are not finite is demoted
/// (DemoteIfNotFinite).
Extrinsics MakeExtrinsics(const CalibrationResult& result, const std::vector<Capture>& captures,
                          const Structure& structure, const ExtrinsicsSource& source);

/// The file's JSON. `where` begins every message. Throws as WriteExtrinsics.
nlohmann::ordered_json ExtrinsicsJson(const Extrinsics& extrinsics, const std::string& where);

/// Writes atomically. Throws IoError, or Error for a sensor's own pose or intrinsics that are not
/// finite.
void WriteExtrinsics(const std::filesystem::path& path, const Extrinsics& extrinsics);

/// Reads a file of WriteExtrinsics strictly, or the extrinsics.json of a folder. Sensors and
/// timings come in alphabetical order. Throws IoError or DataError.
Extrinsics ReadExtrinsics(const std::filesystem::path& file_or_folder);

}  // namespace volalign
