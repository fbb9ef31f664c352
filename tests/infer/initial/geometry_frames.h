#pragma once

// Stacks of boxes, what a sensor sees of them, and the pose that geometry finds.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/rig_choice.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// What a sensor at `pose` sees of a structure in a room, with noise.
inline SensorView See(const Structure& structure, const Pose& pose,
                      const Scene& scene = {true, 3.5}) {
  DepthImage depth = Render(structure, Kinect(), pose, scene).depth;
  AddNoise(&depth, 0.005, 1);
  return MakeSensorView(depth, Kinect());
}

inline std::vector<GeometricPose> Find(const SensorView& view, const Structure& structure) {
  return FindPosesByGeometry(view, structure, FindSymmetries(structure));
}

/// The pose that geometry and the floor decide on.
inline PoseChoice Choose(const SensorView& view, const Structure& structure) {
  return ChooseTogether({{&view,
                          FindHypotheses(view, structure, FindSymmetries(structure), {}, false,
                                         PoseMethod::kAuto),
                          0}},
                        structure)
      .front();
}

/// Found as one of the poses, to 5 cm and 2 deg.
inline bool Contains(const std::vector<GeometricPose>& poses, const Pose& truth) {
  return std::any_of(poses.begin(), poses.end(), [&](const GeometricPose& pose) {
    const PoseError error = ComparePoses(pose.structure_from_sensor, truth);
    return error.translation_m < 0.05 && error.rotation_deg < 2;
  });
}

inline void ExpectChosen(const PoseChoice& choice, const Pose& truth) {
  ASSERT_TRUE(choice.found);
  EXPECT_FALSE(choice.ambiguous());
  EXPECT_TRUE(Within(ComparePoses(choice.best.structure_from_sensor, truth), 0.05, 2));
}

/// A box that stands with its foot at y, m; turned about the vertical.
inline Box Standing(const std::string& name, const Eigen::Vector3d& size,
                    const Eigen::Vector3d& foot, double yaw_deg = 0) {
  Box box{name, size, Pose::Identity()};
  box.structure_from_box.translation() = foot + Eigen::Vector3d(0, size.y() / 2, 0);
  box.structure_from_box.linear() =
      Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return box;
}

/// Two to five boxes of a random size, one on the other, each turned as it likes.
inline Structure RandomStack(std::uint64_t seed) {
  RandomStream random(seed, 0, "stack");
  const int count = 2 + random.Below(4);
  std::vector<Box> boxes;
  Eigen::Vector3d foot(0, 0, 0);
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector3d size{random.Uniform(0.25, 0.6), random.Uniform(0.2, 0.45),
                               random.Uniform(0.25, 0.6)};
    const double yaw = random.Below(2) == 0 ? 0 : random.Uniform(-45, 45);
    boxes.push_back(Standing("box" + std::to_string(k), size, foot, yaw));
    foot += Eigen::Vector3d{random.Uniform(-0.12, 0.12), size.y(), random.Uniform(-0.12, 0.12)};
  }
  return Structure::FromBoxes("stack", boxes);
}

}  // namespace volalign::testing_infer
