#include "infer/refine/residuals.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

#include "infer/refine/noise.h"
#include "infer/refine/pose_manifold.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::residuals_test {
namespace {

using testing_infer::KinectWithLens;
using testing_infer::Observe;
using testing_infer::PaperStructure;
using testing_infer::ParameterPoint;
using testing_infer::RingPose;

/// Faces and edges, seen through another lens than the one assumed.
FrameObservations ObserveAll(const Structure& structure, const Pose& pose) {
  FrameObservations observed = Observe(structure, pose, 40);
  for (std::size_t i = 0; i < 8; ++i) {
    EdgeObservation edge;
    edge.p = observed.faces[i].p + Eigen::Vector3d(0.01, -0.02, 0.03);
    edge.label = observed.faces[i].label;
    edge.edge = static_cast<int>(i % 4);
    edge.axis = static_cast<int>(i % 2);
    edge.pixel = 0.008;
    edge.by_lens = RayByLens(KinectWithLens(), edge.p.head<2>() / edge.p.z());
    observed.edges.push_back(edge);
  }
  for (FaceObservation& face : observed.faces)
    face.by_lens = RayByLens(KinectWithLens(), face.p.head<2>() / face.p.z());
  observed.lens = LensChange(0.001, -0.002, 0.003);
  return observed;
}

/// All that a pose shows, and every parameter but the pose drawn about its nominal value.
struct DrawnPoint {
  DrawnPoint(std::uint64_t seed, const char* name) {
    RandomStream random(seed, 0, name);
    for (Eigen::Index i = 7; i < at.x.size(); ++i) at.x[i] = random.Normal(0, 0.01);
  }

  Structure structure = PaperStructure();
  BuildModel model{structure};
  FrameObservations observed = ObserveAll(structure, RingPose(35));
  ParameterPoint at{model, RingPose(35)};
};

TEST(Residuals, DoNotShrinkWithTheWorld) {
  // Where the stack, its distance and all depths are smaller by one factor, nothing that a sensor
  // measures is different, and so no residual: only priors tell how large the world is.
  const DrawnPoint drawn(3, "scale");
  const Structure& structure = drawn.structure;
  const BuildModel& model = drawn.model;
  const FrameObservations& observed = drawn.observed;
  const ParameterPoint& at = drawn.at;
  ASSERT_GT(observed.faces.size(), 8u);
  constexpr double kFactor = 0.97;
  ParameterPoint smaller = at;
  smaller.x.segment<3>(4) *= kFactor;
  smaller.x[5] += (1 - kFactor) * model.floor();  // it shrinks about a point of the floor
  for (const Eigen::Index gain : {FrameColumns::kGain, FrameColumns::kSize})
    smaller.x[gain] = (1 + at.x[gain]) * kFactor - 1;
  for (const Eigen::Index length : {FrameColumns::kOffset, FrameColumns::kNuisance + kMultipath})
    smaller.x[length] *= kFactor;
  smaller.x.segment<kFrameErrors>(FrameColumns::kErrors) *= kFactor;
  smaller.x.tail(model.size().sides) *= kFactor;
  for (int b = 0; b < static_cast<int>(structure.boxes().size()); ++b) {
    const Eigen::Vector3d centre =
        structure.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
    double& x = smaller.x[FrameColumns::kBoxes + BuildModel::X(b)];
    double& z = smaller.x[FrameColumns::kBoxes + BuildModel::Z(b)];
    x = (centre.x() + x) * kFactor - centre.x();
    z = (centre.z() + z) * kFactor - centre.z();
  }
  Eigen::VectorXd residuals, of_smaller;
  Residuals(model, observed, at.Parameters(), &residuals, nullptr);
  Residuals(model, observed, smaller.Parameters(), &of_smaller, nullptr);
  ASSERT_GT(residuals.norm(), 0.01);
  EXPECT_LT((of_smaller - residuals).norm(), 1e-9 * residuals.norm());
}

TEST(Residuals, AreNoneOfASideThatBulges) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  FrameObservations observed = testing_infer::Observe(structure, pose, 12);
  ParameterPoint at(model, pose);
  for (int label = 1; label < structure.num_classes(); ++label)
    at.x.tail(model.size().sides)[BuildModel::Bulge(label)] = 1e-3 * label;
  for (FaceObservation& face : observed.faces) {
    const Side& side = structure.SideOfLabel(face.label);
    face.p +=
        1e-3 * face.label * side.BulgeAt(pose * face.p) * pose.linear().transpose() * side.normal;
  }
  Eigen::VectorXd residuals;
  Residuals(model, observed, at.Parameters(), &residuals, nullptr);
  EXPECT_LT(residuals.cwiseAbs().maxCoeff(), 1e-5);
}

TEST(Residuals, DerivativesAreThoseOfDifferences) {
  const DrawnPoint drawn(1, "refine model");
  const BuildModel& model = drawn.model;
  const FrameObservations& observed = drawn.observed;
  const ParameterPoint& at = drawn.at;
  ASSERT_GT(observed.faces.size(), 8u);
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;
  Residuals(model, observed, at.Parameters(), &residuals, &jacobian);
  ASSERT_EQ(jacobian.cols(), at.x.size());
  constexpr double kStep = 1e-6;
  for (Eigen::Index c = 0; c < at.x.size(); ++c) {
    Eigen::VectorXd high, low;
    ParameterPoint moved = at;
    moved.x[c] += kStep;
    Residuals(model, observed, moved.Parameters(), &high, nullptr);
    moved.x[c] -= 2 * kStep;
    Residuals(model, observed, moved.Parameters(), &low, nullptr);
    const Eigen::VectorXd numeric = (high - low) / (2 * kStep);
    // Quaternions are normalised: their radial direction counts in differences, not in tangents.
    if (c < 4) continue;
    for (Eigen::Index r = 0; r < numeric.size(); ++r)
      EXPECT_NEAR(jacobian(r, c), numeric[r], 1e-5 * (1 + std::abs(numeric[r]))) << r << " " << c;
  }
  // Rotation, in the tangent space.
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
  LeftPoseManifold().PlusJacobian(at.x.data(), plus.data());
  const Eigen::MatrixXd tangent = jacobian.leftCols<7>() * plus;
  for (int c = 0; c < 6; ++c) {
    const auto evaluate = [&](double step) {
      Vector6d delta = Vector6d::Zero();
      delta[c] = step;
      ParameterPoint moved = at;
      LeftPoseManifold().Plus(at.x.data(), delta.data(), moved.x.data());
      Eigen::VectorXd r;
      Residuals(model, observed, moved.Parameters(), &r, nullptr);
      return r;
    };
    const Eigen::VectorXd numeric = (evaluate(kStep) - evaluate(-kStep)) / (2 * kStep);
    for (Eigen::Index r = 0; r < numeric.size(); ++r)
      EXPECT_NEAR(tangent(r, c), numeric[r], 1e-5 * (1 + std::abs(numeric[r]))) << r << " " << c;
  }
}

TEST(Residuals, VanishOnTheStructureAsBuilt) {
  // Rendered from displaced, turned and enlarged boxes: zero at these parameters, by ray casting.
  const Structure nominal = PaperStructure();
  const BuildModel model(nominal);
  const Pose pose = RingPose(70);
  ParameterPoint at(model, pose);
  double* boxes = at.x.data() + FrameColumns::kBoxes;
  at.x[FrameColumns::kSize] = 0.012;
  RandomStream random(2, 0, "built");
  for (int b = 0; b < static_cast<int>(nominal.boxes().size()); ++b) {
    boxes[BuildModel::X(b)] = random.Normal(0, 0.004);
    boxes[BuildModel::Z(b)] = random.Normal(0, 0.004);
    boxes[BuildModel::Yaw(b)] = random.Normal(0, 0.01);
  }
  const Structure built = model.Built(at.Parameters().build);
  EXPECT_NEAR(built.FloorHeight(), nominal.FloorHeight(), 1e-9) << "it stands on the same floor";
  FrameObservations observed = Observe(built, pose, 20);
  for (FaceObservation& face : observed.faces) face.multipath = 0;
  Eigen::VectorXd residuals;
  Residuals(model, observed, at.Parameters(), &residuals, nullptr);
  ASSERT_GT(residuals.size(), 40);
  EXPECT_LT(residuals.cwiseAbs().maxCoeff(), 2e-6);
}

TEST(SensorCost, IsWhitenedByTheCovariance) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(20);
  FrameObservations observed = Observe(structure, pose, 50);
  EdgeObservation edge;
  edge.p = observed.faces.front().p;
  edge.label = observed.faces.front().label;
  edge.pixel = 0.008;
  edge.variance = 0.1;
  observed.edges = {edge, edge};
  observed.edges[1].edge = 2;
  SetCovariance(model, pose, &observed);
  ParameterPoint at(model, pose);
  at.x[7] = 0.005;
  const SensorCost cost(model, observed);
  const FrameParameters p = at.Parameters();
  const std::array<const double*, 10> blocks = {p.pose,        p.offset,      p.gain, p.focal,
                                                p.nuisance,    p.errors,      p.lens, p.build.size,
                                                p.build.boxes, p.build.bulges};
  Eigen::VectorXd whitened(cost.num_residuals()), residuals;
  EXPECT_TRUE(cost.Evaluate(blocks.data(), whitened.data(), nullptr));
  Residuals(model, observed, p, &residuals, nullptr);
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const Eigen::MatrixXd face = observed.face_root * observed.face_root.transpose(),
                        lines = observed.edge_root * observed.edge_root.transpose();
  const double squares = residuals.head(faces).dot(face.inverse() * residuals.head(faces)) +
                         residuals.tail(2).dot(lines.inverse() * residuals.tail(2));
  EXPECT_NEAR(whitened.squaredNorm(), squares, 1e-6 * squares);
}

}  // namespace
}  // namespace volalign::refine_internal::residuals_test
