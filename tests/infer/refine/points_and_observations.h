#pragma once

// What the tests of the refinement's parts share: points and observations of synthetic views.

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/base/random.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"
#include "infer/refine/refine.h"
#include "infer/refine/sensor_points.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::refine_internal {

/// Of so many frames, each of a sensor of its own, all in one capture, with one lens.
inline std::vector<FrameOf> EachItsOwn(std::size_t frames) {
  std::vector<FrameOf> each(frames);
  for (std::size_t i = 0; i < frames; ++i) each[i].sensor = i;
  return each;
}

inline ParameterLayout LayoutOf(std::size_t frames, std::size_t boxes) {
  const auto count = static_cast<int>(boxes);
  return {EachItsOwn(frames), 1, {count, 5 * count}, 1};
}

/// Of such frames, whose lens is known.
inline State NominalState(const Structure& structure, const std::vector<Pose>& poses) {
  return NominalState(structure, poses, {SensorLens()}, EachItsOwn(poses.size()),
                      {Pose::Identity()});
}

}  // namespace volalign::refine_internal

namespace volalign::testing_infer {

inline std::vector<SensorPoints> PointsOf(const Rig& rig) {
  std::vector<SensorPoints> points;
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    const SensorView view = MakeSensorView(rig.frames[i].depth, rig.frames[i].intrinsics);
    points.push_back(SamplePoints(view, Certain(rig.labels[i]), rig.structure, RefineOptions()));
    points.back().cloud = SampleCloud(view);
    points.back().intrinsics = rig.frames[i].intrinsics;
  }
  return points;
}

/// Points that live as long as the test.
inline std::shared_ptr<const SensorPoints> Borrowed(const SensorPoints& points) {
  return {std::shared_ptr<void>(), &points};
}

/// A displacement of exactly this size in a random direction, about the sensor itself.
inline Pose Displaced(const Pose& pose, double translation, double rotation_deg,
                      std::uint64_t seed) {
  RandomStream random(seed, 0, "displaced");
  const auto direction = [&] {
    return Eigen::Vector3d{random.Normal(), random.Normal(), random.Normal()}.normalized();
  };
  Pose moved = pose;
  moved.translation() += translation * direction();
  moved.linear() = moved.linear() * RotationExp(rotation_deg * M_PI / 180 * direction());
  return moved;
}

inline Eigen::Vector3d RandomVector(RandomStream& random, double scale) {
  return {random.Normal(0, scale), random.Normal(0, scale), random.Normal(0, scale)};
}

inline Pose RandomPose(RandomStream& random) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(RandomVector(random, 1.5));
  pose.translation() = RandomVector(random, 2);
  return pose;
}

/// A matrix R with R R^T = `covariance`, which may be singular.
inline Eigen::MatrixXd RootOf(const Eigen::MatrixXd& covariance) {
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(covariance);
  return ldlt.transpositionsP().transpose() * Eigen::MatrixXd(ldlt.matrixL()) *
         ldlt.vectorD().cwiseMax(0).cwiseSqrt().asDiagonal();
}

inline Eigen::VectorXd WhiteNoise(Eigen::Index size, RandomStream& random) {
  Eigen::VectorXd noise(size);
  for (double& x : noise) x = random.Normal();
  return noise;
}

/// A silhouette where a face was seen.
inline refine_internal::EdgeObservation EdgeOf(const refine_internal::FaceObservation& face) {
  refine_internal::EdgeObservation edge;
  edge.p = face.p;
  edge.label = face.label;
  edge.pixel = 0.008;
  edge.variance = 0.1;
  return edge;
}

/// Two neighbours that see the structure and the floor, where they stand.
struct Neighbours {
  Rig rig{PaperStructure(), {}, {}};
  std::vector<SensorPoints> points;
  std::vector<FrameInput> frames;
  std::vector<Pose> poses;

  Neighbours() {
    rig.Add("A", RingPose(40));
    rig.Add("B", RingPose(85));
    points = PointsOf(rig);
    for (std::size_t i = 0; i < 2; ++i) {
      const Pose& truth = *rig.frames[i].ground_truth;
      poses.push_back(truth);
      frames.push_back({Borrowed(points[i]), truth});
    }
  }
};

/// Parameters of one sensor and the build, as one vector in the order of FrameColumns.
struct ParameterPoint {
  Eigen::VectorXd x;
  Eigen::Index boxes;
  ParameterPoint(const refine_internal::BuildModel& model, const Pose& pose)
      : x(refine_internal::FrameColumns::kBoxes + model.size().parameters()),
        boxes(model.size().boxes) {
    x.setZero();
    const refine_internal::PoseBlock block(pose);
    x.head<7>() = Eigen::Map<const Eigen::Matrix<double, 7, 1>>(block.values);
  }
  refine_internal::FrameParameters Parameters() const {
    using Columns = refine_internal::FrameColumns;
    return {x.data(),
            x.data() + Columns::kOffset,
            x.data() + Columns::kErrors,
            x.data() + Columns::kLens,
            {x.data() + Columns::kSize, x.data() + Columns::kBoxes,
             x.data() + Columns::kBoxes + 3 * boxes}};
  }
};

/// Of the sizes that the options have by default, each another number.
inline refine_internal::Priors SomePriors() {
  refine_internal::Priors priors;
  priors.offset = 0.007;
  priors.gain = 0.003;
  priors.edge_shift = 0.7;
  priors.size = 0.01;
  priors.focal = 0.002;
  priors.box = 0.004;
  priors.yaw = 0.009;
  priors.bulge = 0.002;
  return priors;
}

/// Observations on visible sides as a sensor at `pose` would make them.
inline refine_internal::FrameObservations Observe(const Structure& structure, const Pose& pose,
                                                  int stride) {
  const auto view = Render(structure, Kinect(), pose);
  const RayTable rays = ComputeRays(Kinect());
  refine_internal::FrameObservations observed;
  for (int v = stride / 2; v < view.labels.height(); v += stride) {
    for (int u = stride / 2; u < view.labels.width(); u += stride) {
      if (view.labels(u, v) == 0) continue;
      refine_internal::FaceObservation face;
      const double z = view.depth(u, v);
      face.p = z * Eigen::Vector3d(rays.at(u, v).x(), rays.at(u, v).y(), 1);
      face.label = view.labels(u, v);
      face.bulge = structure.SideOfLabel(face.label).BulgeAt(pose * face.p);
      face.by_errors << face.p.head<2>() * z / 4, 0.1 * (u % 3), 0.2 * (v % 5), -0.1 * (u % 7), z,
          0, 0, 0;
      face.variance = 1e-8;
      observed.faces.push_back(face);
    }
  }
  return observed;
}

}  // namespace volalign::testing_infer
