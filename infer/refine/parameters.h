#pragma once

// All parameters of the joint refinement: their values, their order, their priors, and which of
// them are free. Everything that has to know that order asks here. Not for callers of Refine.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "core/pose.h"
#include "core/structure.h"
#include "infer/refine/build_model.h"
#include "infer/refine/options.h"
#include "infer/refine/pose_block.h"
#include "infer/view/sensor_lens.h"

namespace volalign::refine_internal {

/// A sensor's nuisance block: depth gain - 1, multipath in m, outward shift in px of silhouettes
/// along image rows and along columns (a stereo matcher widens them along its baseline).
inline constexpr int kNuisances = 4;
inline constexpr int kDepthGain = 0, kMultipath = 1, kEdgeShift = 2;

/// One sensor's parameter blocks: pose (7), depth offset in m (1), nuisances, its lens
/// (LensChange), and the build that all sensors share.
struct SensorParameters {
  const double* pose;
  const double* offset;
  const double* nuisance;
  const double* lens;
  const double* build;
};

/// Columns of the derivatives of one sensor's residuals by its blocks, one after the other. The
/// pose has 7 columns as a block and 6 in its tangent space.
struct SensorColumns {
  static constexpr Eigen::Index kPose = 0, kOffset = 7, kNuisance = 8,
                                kLens = kNuisance + kNuisances, kBuild = kLens + kLensParameters;
  /// How many columns are the sensor's own depth and silhouette errors.
  static constexpr Eigen::Index kOwn = kLens - kOffset;
  /// Columns of a matrix over blocks, with those of the pose replaced by its tangent space's.
  static Eigen::MatrixXd InTangentSpace(const Eigen::MatrixXd& over_blocks, const double* pose);
};

/// Prior standard deviations of everything but the poses and the multipath error.
struct Priors {
  double offset = 0, gain = 0;  ///< m, 1
  double edge_shift = 0;        ///< px
  double size = 0;              ///< 1
  double box = 0, yaw = 0;      ///< m, rad
  /// Of the LensChange of the sensor that they are for; zero: the lens is known.
  Eigen::Vector3d lens = Eigen::Vector3d::Zero();
};
Priors PriorsOf(const RefineOptions& options);

/// A standard deviation of zero stands for "known"; this is the least with which one can divide.
inline double Positive(double sigma) { return std::max(sigma, 1e-6); }

/// Prior standard deviations of what moves one sensor's residuals beside its pose, in the order of
/// SensorColumns: offset, nuisances, lens, build. `multipath`, m, belongs to the sensor's noise
/// model.
Eigen::VectorXd SharedPriorSigmas(const Priors& priors, double multipath, int boxes);

/// How far each kind of what is estimated beside the poses strays from its nominal value, as a
/// factor on its prior standard deviation; 0: not at all.
struct PriorScales {
  double boxes = 1, size = 1, gain = 1, offset = 1;
};

/// How a sensor stands and how it measures depth.
struct SensorState {
  Pose structure_from_sensor;
  double gain_error = 0, offset = 0;  ///< true depth = measured * (1 + gain_error) + offset, m

  Eigen::Vector3d Corrected(const Eigen::Vector3d& measured) const {
    return measured * (1 + gain_error + offset / measured.z());
  }
  Eigen::Vector3d InStructure(const Eigen::Vector3d& measured) const {
    return structure_from_sensor * Corrected(measured);
  }
};

/// Values of all parameters.
struct State {
  std::vector<PoseBlock> poses;
  std::vector<double> offsets;
  std::vector<std::array<double, kNuisances>> nuisances;
  std::vector<LensChange> lenses;  ///< from the assumed intrinsics
  std::vector<int> lens_of;        ///< index of each sensor's lens
  std::vector<double> build;       ///< see BuildModel
  PriorScales scales;              ///< of the priors; they are estimated as well
  /// The structure as `build` had it when it was last solved for: what points are matched with.
  Structure built;

  SensorState Sensor(std::size_t i) const { return Sensor(i, poses[i].ToPose()); }
  /// The sensor's depth errors, seen from another pose.
  SensorState Sensor(std::size_t i, const Pose& pose) const {
    return {pose, nuisances[i][kDepthGain], offsets[i]};
  }
  /// Of a sensor.
  const LensChange& Lens(std::size_t i) const {
    return lenses[static_cast<std::size_t>(lens_of[i])];
  }
  LensChange& Lens(std::size_t i) { return lenses[static_cast<std::size_t>(lens_of[i])]; }
  SensorParameters Parameters(std::size_t i) const {
    return {poses[i].values, &offsets[i], nuisances[i].data(), Lens(i).data(), build.data()};
  }
};
/// Everything nominal, the sensors at `poses`, each with the lens of this index.
/// Lenses begin at SensorLens::change. By default all sensors have one lens, which is known.
State NominalState(const Structure& structure, const std::vector<Pose>& poses,
                   const std::vector<SensorLens>& lenses = {SensorLens()},
                   std::vector<int> lens_of = {});

/// What is estimated beside the poses and the nuisances that are always free.
struct FreeSet {
  std::vector<char> boxes, gain, offset;  ///< of each box, each sensor, each sensor
  std::vector<char> lens;                 ///< of each lens
  bool size = false;

  bool AllBoxes() const;
};
/// What the options ask for, where the prior leaves it open at all. Of the lens of a single sensor,
/// only where large planes tell about it.
FreeSet AskedFor(const EstimateSet& asked, const Priors& priors, std::size_t sensors,
                 std::size_t boxes, const std::vector<SensorLens>& lenses = {SensorLens()});

/// Order of all parameters in tangent spaces, as columns of a Jacobian, rows of a covariance: the
/// poses (6 each), the depth offsets, the nuisances (kNuisances of each sensor), the lenses
/// (kLensParameters each), the build.
class ParameterLayout {
 public:
  ParameterLayout(std::size_t sensors, std::size_t boxes, std::size_t lenses = 1)
      : sensors_(sensors), boxes_(boxes), lenses_(lenses) {}

  std::size_t sensors() const { return sensors_; }
  std::size_t boxes() const { return boxes_; }
  std::size_t lenses() const { return lenses_; }
  Eigen::Index size() const { return Build() + 1 + static_cast<Eigen::Index>(3 * boxes_); }

  Eigen::Index Pose(std::size_t i) const { return static_cast<Eigen::Index>(6 * i); }
  Eigen::Index Offset(std::size_t i) const { return static_cast<Eigen::Index>(6 * sensors_ + i); }
  /// `which`: kDepthGain, kMultipath, kEdgeShift or kEdgeShift + 1.
  Eigen::Index Nuisance(std::size_t i, int which) const {
    return static_cast<Eigen::Index>(7 * sensors_ + kNuisances * i) + which;
  }
  /// Of the lens of this index.
  Eigen::Index Lens(std::size_t lens) const {
    return static_cast<Eigen::Index>((7 + kNuisances) * sensors_ + kLensParameters * lens);
  }
  /// Of the whole block. Its first parameter is the size of all boxes.
  Eigen::Index Build() const { return Lens(lenses_); }
  Eigen::Index Size() const { return Build(); }
  /// The three of each box (x, z, yaw), box by box from here.
  Eigen::Index Boxes() const { return Build() + 1; }

  /// A block of Ceres parameters and the first of its columns.
  struct Block {
    double* values;
    Eigen::Index column;
    int size;          ///< of the block
    int tangent_size;  ///< as many columns
  };
  /// The blocks of a state in the order of their columns. They point into it.
  std::vector<Block> Blocks(State* state) const;

  /// Standard deviation of every parameter's prior; of a pose, 1 m and 1 rad (see PosePriorCost).
  /// `multipath`: m, of each sensor.
  Eigen::VectorXd PriorSigmas(const Priors& priors, const std::vector<double>& multipath,
                              const std::vector<SensorLens>& lenses = {SensorLens()}) const;

  /// The scale of every parameter's prior; 1 of those that are of none of these kinds.
  Eigen::VectorXd Scales(const PriorScales& scales) const;
  /// How far every parameter is from its prior's mean; 0 of poses.
  Eigen::VectorXd Values(const State& state) const;

  /// Which columns are held constant where only `free` is estimated, and where all of the sensors
  /// marked in `kept_initial` stands where it is (none where that is empty).
  std::vector<char> Constant(const FreeSet& free, const std::vector<char>& kept_initial = {}) const;

  /// Gives what `free` leaves out its nominal value, zero.
  void SetNominal(const FreeSet& free, State* state) const;

 private:
  std::size_t sensors_, boxes_, lenses_;
};

}  // namespace volalign::refine_internal
