#pragma once

// All parameters of the joint refinement: their values, order and priors, and which are free. No
// other file knows the order. Not for callers of Refine.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/geometry/frame_errors.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/build_model.h"
#include "infer/refine/options.h"
#include "infer/refine/pose_block.h"

namespace volalign::refine_internal {

/// A sensor's own errors, one coefficient each. First those of FrameError, then multipath in
/// concave corners in m, and depth gain - 1. Then the logarithm of the sensor's own factor on the
/// focal length of its lens. Last, the outward shift in px of silhouettes along image rows and
/// along columns. A stereo matcher widens silhouettes along its baseline.
enum SensorError {
  kMultipath = kFrameErrors,
  kGain,
  kFocal,
  kEdgeShift,
  kSensorErrors = kEdgeShift + 2
};
using SensorErrorVector = Eigen::Matrix<double, kSensorErrors, 1>;

/// The parameters that are estimated beside the poses and the nuisances that are always free.
struct FreeSet {
  bool boxes = false, size = false, gain = false, offset = false;
  std::vector<char> lens;  ///< of each lens
};

/// Parameters that share a prior scale: places (x, z) and turns of boxes, the size, depth gains and
/// offsets, and diffuse multipath.
enum PriorGroup { kPlaces, kTurns, kSizes, kGains, kOffsets, kDiffuseMultipaths, kPriorGroups };

/// How far the parameters of each group deviate from their nominal values: a factor on their prior
/// standard deviations.
using PriorScales = Eigen::Array<double, kPriorGroups, 1>;

/// Sigma of the pose priors, m and rad. They bound directions that nothing constrains.
inline constexpr double kPoseSigma = 1;

/// The sensor, the capture and the lens of a frame, as indices. The frames of one sensor are of
/// different captures.
struct FrameOf {
  std::size_t sensor = 0, capture = 0, lens = 0;
};

/// One frame's parameter blocks. `pose`: in the structure of its capture (7). `offset`: of its
/// depths, m (1). `errors`: its sensor's (SensorError). `lens`: a LensChange. `build`: of its
/// capture.
struct FrameParameters {
  const double* pose;
  const double* offset;
  const double* errors;
  const double* lens;
  BuildParameters build;
};

/// Columns of the derivatives of one frame's residuals with respect to its blocks. The pose has 7
/// columns as a block and 6 in its tangent space.
struct FrameColumns {
  static constexpr Eigen::Index kPose = 0,
                                kOffset = Eigen::Index{sizeof(PoseBlock) / sizeof(double)},
                                kErrors = kOffset + 1, kLens = kErrors + kSensorErrors,
                                kSize = kLens + kLensParameters, kBoxes = kSize + 1;
  /// Replaces the pose's columns of a matrix over blocks by those of its tangent space.
  static Eigen::MatrixXd InTangentSpace(const Eigen::MatrixXd& over_blocks, const double* pose);
};

/// Prior standard deviations of everything but the poses and the multipath error.
struct Priors {
  double offset = 0;  ///< m
  /// If given, every sensor has it instead of its kind's DepthErrorModel::unit_gain.
  std::optional<double> gain;
  double edge_shift = 0;    ///< px
  double size = 0;          ///< 1
  double box = 0, yaw = 0;  ///< m, rad
  double bulge = 0;         ///< m
  /// The LensChange of one sensor; zero: the lens is known.
  Eigen::Vector3d lens = Eigen::Vector3d::Zero();
  double focal = 0;  ///< see SensorLens::own_focal_sigma
};
/// A single box stands where the structure stands: it has no place of its own.
Priors PriorsOf(const RefineOptions& options, std::size_t boxes);

/// A standard deviation of zero means "known". This is the least one to divide by.
inline double Positive(double sigma) { return std::max(sigma, 1e-6); }

inline double Square(double x) { return x * x; }

/// Prior standard deviations of all that moves one frame's residuals beside its pose, in the order
/// of FrameColumns: offset, errors of the sensor, lens, size, boxes, bulges. `errors`: the frame's
/// noise model.
Eigen::VectorXd SharedPriorSigmas(const Priors& priors, const DepthErrorModel& errors,
                                  const BuildSize& build);

/// The values of the same parameters. The lens has zero, as its prior is about its current value.
Eigen::VectorXd SharedValues(const FrameParameters& parameters, const BuildSize& build);

/// The true place of a measured point, sensor frame, m. True depth = measured * (1 + gain_error) +
/// offset along the same ray.
inline Eigen::Vector3d Corrected(const Eigen::Vector3d& measured, double gain_error,
                                 double offset) {
  return measured * (1 + gain_error + offset / measured.z());
}

/// A sensor's pose and depth errors.
struct FrameState {
  Pose structure_from_sensor;
  double gain_error = 0, offset = 0;  ///< see Corrected

  Eigen::Vector3d Corrected(const Eigen::Vector3d& measured) const {
    return refine_internal::Corrected(measured, gain_error, offset);
  }
  /// The point that the sensor would have measured for a true one.
  Eigen::Vector3d AsMeasured(const Eigen::Vector3d& point) const {
    return point * ((1 - offset / point.z()) / (1 + gain_error));
  }
  Eigen::Vector3d InStructure(const Eigen::Vector3d& measured) const {
    return structure_from_sensor * Corrected(measured);
  }
};

/// Values of all parameters.
struct State {
  std::vector<FrameOf> frame_of;
  std::vector<PoseBlock> poses;       ///< of each frame, in the structure of its capture
  std::vector<PoseBlock> placements;  ///< of each capture: first_from_placement, the first identity
  std::vector<double> offsets;        ///< of each frame, since a sensor's offset may drift
  std::vector<SensorErrorVector> errors;     ///< of each sensor
  std::vector<LensChange> lenses;            ///< from the assumed intrinsics
  PoseBlock world;                           ///< structure_from_world of the pose priors
  double world_scale = 0;                    ///< logarithm of its scale
  double size = 0;                           ///< of all boxes, scale - 1
  std::vector<std::vector<double>> boxes;    ///< of each capture, see BuildModel
  std::vector<std::vector<double>> bulges;   ///< of each capture, see BuildModel
  PriorScales scales = PriorScales::Ones();  ///< of the priors, estimated
  /// Each capture's structure as built, at the last solution. Points are matched with it.
  std::vector<Structure> built;
  bool converged = true;  ///< the last solution ended by its tolerances

  // The following take the index of a frame.
  const Structure& Built(std::size_t i) const { return built[frame_of[i].capture]; }
  const LensChange& Lens(std::size_t i) const { return lenses[frame_of[i].lens]; }
  LensChange& Lens(std::size_t i) { return lenses[frame_of[i].lens]; }
  const SensorErrorVector& Errors(std::size_t i) const { return errors[frame_of[i].sensor]; }
  SensorErrorVector& Errors(std::size_t i) { return errors[frame_of[i].sensor]; }
  FrameState Frame(std::size_t i) const { return Frame(i, poses[i].ToPose()); }
  /// The sensor's depth errors, at another pose.
  FrameState Frame(std::size_t i, const Pose& pose) const {
    return {pose, Errors(i)[kGain], offsets[i]};
  }
  BuildParameters Build(std::size_t capture) const {
    return {&size, boxes[capture].data(), bulges[capture].data()};
  }
  FrameParameters Parameters(std::size_t i) const {
    return {poses[i].values, &offsets[i], Errors(i).data(), Lens(i).data(),
            Build(frame_of[i].capture)};
  }
  /// Updates `built` from the parameters.
  void UpdateBuilt(const BuildModel& model);
};
/// All parameters nominal, the frames at `poses`, the captures at `placements`. Lenses begin at
/// SensorLens::change.
State NominalState(const Structure& structure, const std::vector<Pose>& poses,
                   const std::vector<SensorLens>& lenses, std::vector<FrameOf> frame_of,
                   const std::vector<Pose>& placements);

/// The parameters that the options ask for and the prior leaves open. The lens of a single frame is
/// free only if large planes determine it.
FreeSet AskedFor(const EstimateSet& asked, const Priors& priors, std::size_t frames,
                 const std::vector<SensorLens>& lenses = {SensorLens()});

/// Order of all parameters in tangent spaces: columns of a Jacobian, rows of a covariance. First
/// the frames' poses (6 each) and the placements of all captures but the first (6 each). Then the
/// frames' depth offsets, the sensors' errors (kSensorErrors each) and the lenses (kLensParameters
/// each). Then the size, the boxes of each capture, and the bulges of each capture. Last the
/// motion of the pose priors' world (6) and its scale.
class ParameterLayout {
 public:
  ParameterLayout(std::vector<FrameOf> frame_of, std::size_t captures, const BuildSize& build,
                  std::size_t lenses);

  std::size_t frames() const { return frame_of_.size(); }
  std::size_t sensors() const { return sensors_; }
  std::size_t captures() const { return captures_; }
  std::size_t boxes() const { return static_cast<std::size_t>(build_.boxes); }  ///< of one capture
  std::size_t lenses() const { return lenses_; }
  Eigen::Index size() const { return WorldScale() + 1; }

  Eigen::Index Pose(std::size_t frame) const { return static_cast<Eigen::Index>(6 * frame); }
  /// `capture`: not the first.
  Eigen::Index Placement(std::size_t capture) const {
    return static_cast<Eigen::Index>(6 * (frames() + capture - 1));
  }
  Eigen::Index Offset(std::size_t frame) const {
    return Placement(captures_) + static_cast<Eigen::Index>(frame);
  }
  Eigen::Index ErrorsOfSensor(std::size_t sensor) const {
    return Offset(frames()) + static_cast<Eigen::Index>(kSensorErrors * sensor);
  }
  /// An error of the frame's sensor.
  Eigen::Index Error(std::size_t frame, SensorError which) const {
    return ErrorsOfSensor(frame_of_[frame].sensor) + which;
  }
  Eigen::Index Lens(std::size_t lens) const {
    return ErrorsOfSensor(sensors_) + static_cast<Eigen::Index>(kLensParameters * lens);
  }
  /// The size that all boxes share.
  Eigen::Index Size() const { return Lens(lenses_); }
  /// The first of x, z and yaw of each box in a capture, box by box.
  Eigen::Index Boxes(std::size_t capture = 0) const {
    return Size() + 1 + static_cast<Eigen::Index>(3 * boxes() * capture);
  }
  /// The bulges of all sides in a capture.
  Eigen::Index Bulges(std::size_t capture) const {
    return Boxes(captures_) +
           static_cast<Eigen::Index>(build_.sides) * static_cast<Eigen::Index>(capture);
  }
  Eigen::Index World() const { return Bulges(captures_); }
  Eigen::Index WorldScale() const { return World() + 6; }

  /// A block of Ceres parameters and the first of its columns.
  struct Block {
    double* values;
    Eigen::Index column;
    int size;          ///< of the block
    int tangent_size;  ///< its number of columns
  };
  /// The blocks of a state in the order of their columns. They point into it.
  std::vector<Block> Blocks(State* state) const;

  /// Standard deviation of every parameter's prior. Poses and the world have 1 m and 1 rad (see
  /// PosePriorCost), its scale has 1.
  /// `errors`: of each frame. Offsets of n frames of one sensor have a prior that is wider by the
  /// root of n: DriftCost ties them.
  Eigen::VectorXd PriorSigmas(const Priors& priors, const std::vector<DepthErrorModel>& errors,
                              const std::vector<SensorLens>& lenses = {SensorLens()}) const;

  /// The columns that move a frame's residuals, in the order of FrameColumns, with 6 of the pose.
  std::vector<Eigen::Index> ColumnsOf(std::size_t frame) const;

  /// The group of a column. Nothing if its prior is never narrowed.
  std::optional<PriorGroup> GroupOf(Eigen::Index column) const;
  /// The scale of every parameter's prior.
  Eigen::VectorXd Scales(const PriorScales& scales) const;
  /// How far every parameter is from its prior's mean; 0 of poses.
  Eigen::VectorXd Values(const State& state) const;

  /// Which columns are constant. `free`: what is estimated. Fixed frames keep their pose and
  /// offset. A sensor keeps its errors if all its frames are fixed.
  std::vector<char> Constant(const FreeSet& free, const std::vector<char>& fixed = {}) const;

 private:
  std::vector<FrameOf> frame_of_;
  BuildSize build_;
  std::size_t sensors_ = 0, captures_, lenses_;
};

}  // namespace volalign::refine_internal
