#pragma once

// Two sensors that see one plane, for tests of what they have in common.

#include <Eigen/Core>
#include <cmath>
#include <utility>
#include <vector>

#include "infer/refine/frame_observations.h"
#include "infer/refine/problem.h"
#include "infer/refine/sensor_points.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::testing_infer {

/// Two rows of points of a plane that faces the sensor, along the image's x or y axis: 1.2 m, of 2
/// m away four correlation lengths of 0.15 rad.
inline std::vector<CloudPoint> Strip(bool along_x, double z, int count = 15) {
  std::vector<CloudPoint> cloud;
  for (int i = 0; i < count; ++i) {
    for (const double across : {0.02, 0.1}) {
      const double along = 0.01 + 1.162 / (count - 1) * i;
      CloudPoint point;
      point.p = along_x ? Eigen::Vector3d(along, across, z) : Eigen::Vector3d(across, along, z);
      point.normal = {0, 0, -1};
      cloud.push_back(point);
    }
  }
  return cloud;
}

/// Of two frames whose smooth errors have that length.
inline std::vector<refine_internal::FrameObservations> TwoFrames() {
  std::vector<refine_internal::FrameObservations> observed(2);
  for (refine_internal::FrameObservations& of : observed) of.noise.depth.smooth_rad = 0.15;
  return observed;
}

/// Standard deviation of the difference of two points at 2 m, m: of the smooth error of both, and
/// of two thousandths of their distances from the optical axis.
inline double SigmaOfPair(const Eigen::Vector3d& p, double warp = 0.005) {
  return std::sqrt(2 * (warp * warp + 0.002 * 0.002 * p.head<2>().squaredNorm()));
}

/// Two sensors in one place, far from the structure. All is as the options have it, but
/// for what a test changes before it asks for the problem, which refers to this.
struct TwoSensors {
  Structure structure = PaperStructure();
  Pose pose = Eigen::Translation3d(30, 0, 0) * RingPose(40);
  SensorPoints a, b;
  RefineOptions options;
  std::vector<FrameInput> frames = {{Borrowed(a), pose}, {Borrowed(b), pose}};
  refine_internal::State state = refine_internal::NominalState(structure, {pose, pose});

  TwoSensors(std::vector<CloudPoint> of_a, std::vector<CloudPoint> of_b) {
    a.cloud = SampledCloud(std::move(of_a));
    b.cloud = SampledCloud(std::move(of_b));
    a.intrinsics = b.intrinsics = Kinect();
  }
  refine_internal::JointProblem Problem() const { return {structure, frames, options}; }
};

}  // namespace volalign::testing_infer
