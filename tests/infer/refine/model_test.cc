#include "infer/refine/model.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <vector>

#include "core/random.h"
#include "infer/refine/costs.h"
#include "tests/infer/synthetic.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// Parameters of one sensor and the build, as one vector: pose 7, offset, nuisances, build.
struct Point {
  Eigen::VectorXd x;
  Point(const BuildModel& model, const Pose& pose) : x(8 + kNuisances + model.size()) {
    x.setZero();
    const PoseBlock block(pose);
    x.head<7>() = Eigen::Map<const Eigen::Matrix<double, 7, 1>>(block.values);
  }
  SensorParameters Parameters() const {
    return {x.data(), x.data() + 7, x.data() + 8, x.data() + 8 + kNuisances};
  }
};

/// Observations on visible sides as a sensor at `pose` would make them.
SensorEvidence Observe(const Structure& structure, const Pose& pose, int stride) {
  const auto view = testing_infer::Render(structure, testing_infer::Kinect(), pose);
  const RayTable rays = ComputeRays(testing_infer::Kinect());
  SensorEvidence evidence;
  for (int v = stride / 2; v < view.labels.height(); v += stride) {
    for (int u = stride / 2; u < view.labels.width(); u += stride) {
      if (view.labels(u, v) == 0) continue;
      FaceObservation face;
      const double z = view.depth(u, v);
      face.p = z * Eigen::Vector3d(rays.at(u, v).x(), rays.at(u, v).y(), 1);
      face.label = view.labels(u, v);
      face.multipath = 0.1 * (u % 7);
      face.variance = 1e-8;
      evidence.faces.push_back(face);
    }
  }
  return evidence;
}

TEST(RefineModel, DerivativesAreThoseOfDifferences) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  SensorEvidence evidence = Observe(structure, pose, 40);
  ASSERT_GT(evidence.faces.size(), 8u);
  for (std::size_t i = 0; i < 8; ++i) {
    EdgeObservation edge;
    edge.p = evidence.faces[i].p + Eigen::Vector3d(0.01, -0.02, 0.03);
    edge.label = evidence.faces[i].label;
    edge.edge = static_cast<int>(i % 4);
    edge.axis = static_cast<int>(i % 2);
    edge.pixel = 0.008;
    evidence.edges.push_back(edge);
  }
  Point at(model, pose);
  RandomStream random(1, 0, "refine model");
  for (Eigen::Index i = 7; i < at.x.size(); ++i) at.x[i] = random.Normal(0, 0.01);
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;
  Residuals(model, evidence, at.Parameters(), &residuals, &jacobian);
  ASSERT_EQ(jacobian.cols(), at.x.size());
  constexpr double kStep = 1e-6;
  for (Eigen::Index c = 0; c < at.x.size(); ++c) {
    Eigen::VectorXd high, low;
    Point moved = at;
    moved.x[c] += kStep;
    Residuals(model, evidence, moved.Parameters(), &high, nullptr);
    moved.x[c] -= 2 * kStep;
    Residuals(model, evidence, moved.Parameters(), &low, nullptr);
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
      Point moved = at;
      LeftPoseManifold().Plus(at.x.data(), delta.data(), moved.x.data());
      Eigen::VectorXd r;
      Residuals(model, evidence, moved.Parameters(), &r, nullptr);
      return r;
    };
    const Eigen::VectorXd numeric = (evaluate(kStep) - evaluate(-kStep)) / (2 * kStep);
    for (Eigen::Index r = 0; r < numeric.size(); ++r)
      EXPECT_NEAR(tangent(r, c), numeric[r], 1e-5 * (1 + std::abs(numeric[r]))) << r << " " << c;
  }
}

TEST(RefineModel, ResidualsVanishOnTheStructureAsBuilt) {
  // Rendered from displaced, turned and enlarged boxes: zero at these parameters, by ray casting.
  const Structure nominal = PaperStructure();
  const BuildModel model(nominal);
  const Pose pose = RingPose(70);
  Point at(model, pose);
  double* build = at.x.data() + 8 + kNuisances;
  build[0] = 0.012;
  RandomStream random(2, 0, "built");
  for (int b = 0; b < static_cast<int>(nominal.boxes().size()); ++b) {
    build[BuildModel::X(b)] = random.Normal(0, 0.004);
    build[BuildModel::Z(b)] = random.Normal(0, 0.004);
    build[BuildModel::Yaw(b)] = random.Normal(0, 0.01);
  }
  const Structure built = model.Built(build);
  EXPECT_NEAR(built.FloorHeight(), nominal.FloorHeight(), 1e-9) << "it stands on the same floor";
  SensorEvidence evidence = Observe(built, pose, 20);
  for (FaceObservation& face : evidence.faces) face.multipath = 0;
  Eigen::VectorXd residuals;
  Residuals(model, evidence, at.Parameters(), &residuals, nullptr);
  ASSERT_GT(residuals.size(), 40);
  EXPECT_LT(residuals.cwiseAbs().maxCoeff(), 2e-6);
}

TEST(RefineModel, SeamsAreWhereSurfacesMeetAtAnInwardCorner) {
  const Structure structure = PaperStructure();
  const auto side = [&](const char* name) -> const Side& {
    for (const Side& s : structure.sides()) {
      if (s.name == name) return s;
    }
    throw std::runtime_error(name);
  };
  // facts/structure.yaml, metres. The bottom box's front stands on the floor (y = -0.81): the share
  // falls linearly to none at 0.3 m above it.
  const Side& front = side("bottom/front");
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.81, 0}), 1, 1e-9);
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.66, 0}), 0.5, 1e-9);
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.45, 0}), 0, 1e-9);
  // On its top, beside the next box, which ends at x = 0.05.
  EXPECT_NEAR(SeamShare(structure, side("bottom/up"), {0.11, -0.405, 0}), 0.8, 1e-9);
  // The top box's front: nothing rises before it.
  EXPECT_NEAR(SeamShare(structure, side("top/front"), {0.05, 0.6, 0}), 0, 1e-9);
}

TEST(RefineModel, NoiseIsFoundFromResiduals) {
  // Fields drawn from a Gaussian process of known size (Cholesky), pose and constants unknown.
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  SensorEvidence evidence = Observe(structure, pose, 14);
  for (FaceObservation& face : evidence.faces) face.multipath = 0;
  const auto n = static_cast<Eigen::Index>(evidence.faces.size());
  ASSERT_GT(n, 60);
  Priors priors;
  priors.offset = 0.007;
  priors.gain = 0.003;
  priors.edge_shift = 0.7;
  const SensorEvidence clean = evidence;
  for (const double sigma : {0.002, 0.008}) {
    evidence.noise = NoiseModel();
    evidence.noise.warp = sigma;
    evidence.noise.warp_length = 0.1;
    evidence.faces = clean.faces;
    SetCovariance(model, pose, &evidence);
    const Eigen::MatrixXd root = evidence.face_root;
    double logarithm = 0;
    constexpr int kDraws = 12;
    for (int draw = 0; draw < kDraws; ++draw) {
      RandomStream random(3, static_cast<std::uint64_t>(draw), "warp");
      Eigen::VectorXd white(n);
      for (Eigen::Index i = 0; i < n; ++i) white[i] = random.Normal();
      const Eigen::VectorXd distance = root * white;
      SensorEvidence seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        FaceObservation& face = seen.faces[static_cast<std::size_t>(i)];
        const Eigen::Vector3d ray = face.p / face.p.z();
        const double along = structure.SideOfLabel(face.label).normal.dot(pose.linear() * ray);
        face.p += ray * (distance[i] / along);
      }
      const Point at(model, pose);
      FitNoise(model, at.Parameters(), priors, &seen);
      logarithm += std::log(seen.noise.warp / sigma) / kDraws;
      // The factor is that of the fitted covariance.
      EXPECT_EQ(seen.face_root.rows(), n);
    }
    EXPECT_LT(std::abs(logarithm), std::log(1.6)) << sigma << ": off by " << std::exp(logarithm);
  }
}

TEST(RefineModel, CostIsWhitenedByTheCovariance) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(20);
  SensorEvidence evidence = Observe(structure, pose, 50);
  EdgeObservation edge;
  edge.p = evidence.faces.front().p;
  edge.label = evidence.faces.front().label;
  edge.pixel = 0.008;
  edge.variance = 0.1;
  evidence.edges = {edge, edge};
  evidence.edges[1].edge = 2;
  SetCovariance(model, pose, &evidence);
  Point at(model, pose);
  at.x[7] = 0.005;
  const SensorCost cost(model, evidence);
  const SensorParameters p = at.Parameters();
  const std::array<const double*, 4> blocks = {p.pose, p.offset, p.nuisance, p.build};
  Eigen::VectorXd whitened(cost.num_residuals()), residuals;
  EXPECT_TRUE(cost.Evaluate(blocks.data(), whitened.data(), nullptr));
  Residuals(model, evidence, p, &residuals, nullptr);
  const auto faces = static_cast<Eigen::Index>(evidence.faces.size());
  const Eigen::MatrixXd face = evidence.face_root * evidence.face_root.transpose(),
                        lines = evidence.edge_root * evidence.edge_root.transpose();
  const double squares = residuals.head(faces).dot(face.inverse() * residuals.head(faces)) +
                         residuals.tail(2).dot(lines.inverse() * residuals.tail(2));
  EXPECT_NEAR(whitened.squaredNorm(), squares, 1e-6 * squares);
}

}  // namespace
}  // namespace volalign::refine_internal
