#include "infer/refine/costs.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "core/base/random.h"
#include "infer/refine/pose_manifold.h"

namespace volalign::refine_internal::costs_test {
namespace {

Eigen::Vector3d RandomVector(RandomStream& random, double scale) {
  return {random.Normal(0, scale), random.Normal(0, scale), random.Normal(0, scale)};
}

Pose RandomPose(RandomStream& random) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(RandomVector(random, 1.5));
  pose.translation() = RandomVector(random, 2);
  return pose;
}

/// Jacobians by central differences, over PerturbLeft in a pose's tangent space and over other
/// parameters as they stand, against the cost's own (times PlusJacobian). Parameters: the poses,
/// then blocks of the other parameters.
void ExpectDerivatives(const ceres::CostFunction& cost, const std::vector<Pose>& poses,
                       const std::vector<std::vector<double>>& others, int rows) {
  using Others = std::vector<std::vector<double>>;
  const auto evaluate = [&](const std::vector<Pose>& at, const Others& other, double** jacobians) {
    std::vector<PoseBlock> blocks;
    for (std::size_t i = 0; i < at.size(); ++i) {
      blocks.emplace_back(at[i]);
      // Of the two quaternions of a rotation, the one that the unmoved pose has.
      const PoseBlock reference(poses[i]);
      Eigen::Map<Eigen::Vector4d> q(blocks.back().values);
      if (q.dot(Eigen::Map<const Eigen::Vector4d>(reference.values)) < 0) q = -q;
    }
    std::vector<const double*> parameters;
    parameters.reserve(blocks.size() + other.size());
    for (const PoseBlock& block : blocks) parameters.push_back(block.values);
    for (const std::vector<double>& block : other) parameters.push_back(block.data());
    Eigen::VectorXd residuals(rows);
    EXPECT_TRUE(cost.Evaluate(parameters.data(), residuals.data(), jacobians));
    return residuals;
  };
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  std::vector<RowMajor> storage;
  for (std::size_t i = 0; i < poses.size(); ++i) storage.emplace_back(rows, 7);
  for (const std::vector<double>& block : others)
    storage.emplace_back(rows, static_cast<Eigen::Index>(block.size()));
  std::vector<double*> jacobians;
  jacobians.reserve(storage.size());
  for (RowMajor& s : storage) jacobians.push_back(s.data());
  evaluate(poses, others, jacobians.data());

  constexpr double kStep = 1e-6;
  const auto expect_equal = [&](const Eigen::VectorXd& high, const Eigen::VectorXd& low,
                                const Eigen::VectorXd& analytic, const char* what, int column) {
    for (int row = 0; row < rows; ++row) {
      const double numeric = (high[row] - low[row]) / (2 * kStep);
      EXPECT_FALSE(!(std::abs(numeric - analytic[row]) <= 1e-5 * (1 + std::abs(numeric))))
          << what << " row " << row << " column " << column << ": " << numeric << " against "
          << analytic[row];
    }
  };
  for (std::size_t b = 0; b < poses.size(); ++b) {
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    LeftPoseManifold().PlusJacobian(PoseBlock(poses[b]).values, plus.data());
    const Eigen::MatrixXd analytic = storage[b] * plus;
    for (int column = 0; column < 6; ++column) {
      const Vector6d delta = kStep * Vector6d::Unit(column);
      std::vector<Pose> high = poses, low = poses;
      high[b] = PerturbLeft(delta, poses[b]);
      low[b] = PerturbLeft(-delta, poses[b]);
      expect_equal(evaluate(high, others, nullptr), evaluate(low, others, nullptr),
                   analytic.col(column), "pose", column);
    }
  }
  for (std::size_t b = 0; b < others.size(); ++b) {
    for (std::size_t k = 0; k < others[b].size(); ++k) {
      Others high = others, low = others;
      high[b][k] += kStep;
      low[b][k] -= kStep;
      expect_equal(evaluate(poses, high, nullptr), evaluate(poses, low, nullptr),
                   storage[poses.size() + b].col(static_cast<Eigen::Index>(k)), "other",
                   static_cast<int>(b));
    }
  }
}

/// A point in front of a sensor.
Eigen::Vector3d RandomPoint(RandomStream& random) {
  return {random.Normal(0, 0.5), random.Normal(0, 0.5), random.Uniform(1, 4)};
}

/// PointToPlane as a cost.
class PointToPlaneCost : public ceres::SizedCostFunction<1, 7, 7> {
 public:
  PointToPlaneCost(Eigen::Vector3d p, Eigen::Vector3d q, Eigen::Vector3d n)
      : p_(std::move(p)), q_(std::move(q)), n_(std::move(n)) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    *residuals = PointToPlane(p_, q_, n_, 2.5, parameters, jacobians);
    return true;
  }

 private:
  Eigen::Vector3d p_, q_, n_;
};

TEST(RefineCosts, PointToPlaneIsTheDistanceInTheOtherSensorAndItsDerivative) {
  RandomStream random(3, 0, "overlap_cost");
  for (int trial = 0; trial < 20; ++trial) {
    const Pose a = RandomPose(random), b = RandomPose(random);
    const Eigen::Vector3d p = RandomPoint(random), q = RandomPoint(random);
    const Eigen::Vector3d n = RandomVector(random, 1).normalized();
    const PointToPlaneCost cost(p, q, n);
    const PoseBlock block_a(a), block_b(b);
    const double* parameters[] = {block_a.values, block_b.values};
    double residual = 0;
    ASSERT_TRUE(cost.Evaluate(parameters, &residual, nullptr));
    EXPECT_NEAR(residual, 2.5 * n.dot(b.inverse() * (a * p) - q), 1e-9);
    ExpectDerivatives(cost, {a, b}, {}, 1);
  }
}

TEST(RefineCosts, PosePriorDerivative) {
  RandomStream random(4, 0, "prior");
  for (int trial = 0; trial < 20; ++trial) {
    const Pose prior = RandomPose(random);
    Vector6d delta;
    for (int i = 0; i < 6; ++i) delta[i] = random.Normal(0, 0.2);
    ExpectDerivatives(PosePriorCost(prior, 0.5, 0.3), {PerturbLeft(delta, prior)}, {}, 6);
    const PoseBlock block(prior);
    const double* parameters[] = {block.values};
    Vector6d residual;
    PosePriorCost(prior, 0.5, 0.3).Evaluate(parameters, residual.data(), nullptr);
    EXPECT_LT(residual.norm(), 1e-12);
  }
}

TEST(RefineCosts, ARobustResidualIsTheRootOfCauchysLossAndItsDerivative) {
  const auto root = [](double r) { return MakeRobust(r, 0.3); };
  for (const double r : {-30.0, -2.0, -0.1, 0.0, 1e-9, 0.5, 7.0}) {
    EXPECT_NEAR(root(r).value * root(r).value, 0.3 * 4 * std::log1p(r * r / 4), 1e-12);
    EXPECT_EQ(std::signbit(root(r).value), std::signbit(r));
    constexpr double kStep = 1e-5;
    EXPECT_NEAR(root(r).slope, (root(r + kStep).value - root(r - kStep).value) / (2 * kStep), 1e-8);
  }
}

/// Where a point is when its sensor's lens has changed and its depth is off: the pixel's ray, at
/// the true depth.
Eigen::Vector3d TruePoint(const LensPoint& point, double offset, double gain_error,
                          const LensChange& lens) {
  const Eigen::Vector2d ray = point.p.head<2>() / point.p.z() + point.by_lens * (lens - point.lens);
  return (point.p.z() * (1 + gain_error) + offset) * ray.homogeneous();
}

TEST(RefineCosts, MeasuredOverlapIsThatOfThePointsWhereTheyReallyAre) {
  RandomStream random(6, 0, "lens_overlap");
  for (int trial = 0; trial < 20; ++trial) {
    const bool shared = trial % 2 == 0;
    const auto point = [&] {
      LensPoint of{RandomPoint(random), RayByLensMatrix::Zero(), RandomVector(random, 0.01),
                   FrameErrorVector::Zero()};
      for (double& error : of.by_errors) error = random.Normal();
      for (double& entry : of.by_lens.reshaped()) entry = random.Normal();
      return of;
    };
    const LensPoint a = point(), b = point();
    const Eigen::Vector3d normal = RandomVector(random, 1).normalized();
    const std::vector<Pose> poses = {RandomPose(random), RandomPose(random)};
    // Offsets, gains, own focal lengths, errors of the frames, lenses.
    const FrameErrorVector of_a(0.002, -0.004, 0.001, 0.002, 0.003),
        of_b(-0.001, 0.003, 0.002, -0.004, -0.002);
    std::vector<std::vector<double>> others = {{0.004},  {-0.003}, {0.006},
                                               {-0.002}, {0.003},  {-0.005}};
    for (const FrameErrorVector* of : {&of_a, &of_b})
      others.emplace_back(of->data(), of->data() + kFrameErrors);
    const Eigen::Vector3d lens_a = RandomVector(random, 0.01);
    const Eigen::Vector3d lens_b = shared ? lens_a : RandomVector(random, 0.01);
    others.emplace_back(lens_a.data(), lens_a.data() + 3);
    if (!shared) others.emplace_back(lens_b.data(), lens_b.data() + 3);
    const LensPoint other = point();
    const MeasuredOverlapCost cost({{a, b, normal, 1.7}, {other, b, normal, 1.7}}, 0.3, shared);

    const PoseBlock block_a(poses[0]), block_b(poses[1]);
    std::vector<const double*> parameters = {block_a.values, block_b.values};
    for (const std::vector<double>& block : others) parameters.push_back(block.data());
    std::array<double, 2> residuals{};
    ASSERT_TRUE(cost.Evaluate(parameters.data(), residuals.data(), nullptr));
    const Eigen::Vector3d q = poses[1] * TruePoint(b, -0.003 + b.by_errors.dot(of_b), -0.002,
                                                   lens_b - 0.005 * LensChange::UnitX());
    const auto expected = [&](const LensPoint& of) {
      const Eigen::Vector3d p = poses[0] * TruePoint(of, 0.004 + of.by_errors.dot(of_a), 0.006,
                                                     lens_a + 0.003 * LensChange::UnitX());
      // The mean of the gains is 1.002.
      return MakeRobust(1.7 * (poses[1].linear() * normal).dot(p - q) / 1.002, 0.3).value;
    };
    EXPECT_NEAR(residuals[0], expected(a), 1e-12);
    EXPECT_NEAR(residuals[1], expected(other), 1e-12);
    ExpectDerivatives(cost, poses, others, 2);
  }
}

TEST(RefineCosts, LensEvidenceIsItsQuadraticForm) {
  LensEvidence evidence;
  Eigen::Matrix3d root;
  root << 0, 0, 0, 0, 30, 5, 0, 0, 12;  // nothing about the focal length
  evidence.information = root.transpose() * root;
  const LensChange mean(0, -0.3, 0.1);
  evidence.moment = evidence.information * mean;
  const LensEvidenceCost cost(evidence);
  for (const LensChange& at :
       {LensChange(0, 0, 0), LensChange(0.02, -0.3, 0.1), LensChange(-0.01, 0.2, 0.3)}) {
    Eigen::Vector3d residuals;
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> jacobian;
    const double* block = at.data();
    double* jacobians = jacobian.data();
    ASSERT_TRUE(cost.Evaluate(&block, residuals.data(), &jacobians));
    EXPECT_NEAR(residuals.squaredNorm(), (root * (at - mean)).squaredNorm(), 1e-9);
    EXPECT_LT((jacobian.transpose() * residuals - evidence.information * (at - mean)).norm(), 1e-9);
  }
}

}  // namespace
}  // namespace volalign::refine_internal::costs_test
