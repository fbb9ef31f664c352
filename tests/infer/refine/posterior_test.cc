#include "infer/refine/posterior.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::posterior_test {
namespace {

constexpr double kShift = 0.7;

/// Of all parameters: 1, but for silhouette shifts.
Eigen::VectorXd PriorSigmas(const ParameterLayout& layout) {
  Priors priors;
  priors.offset = priors.gain = priors.size = priors.box = priors.yaw = 1;
  priors.edge_shift = kShift;
  return layout.PriorSigmas(priors, std::vector<double>(layout.sensors(), 1));
}

/// Random measurements of everything, and a prior of kShift px on silhouette shifts.
NormalEquations RandomNormal(const ParameterLayout& layout) {
  RandomStream random(5, 0, "normal equations");
  const Eigen::Index n = layout.size();
  Eigen::MatrixXd j(3 * n, n);
  for (Eigen::Index r = 0; r < j.rows(); ++r) {
    for (Eigen::Index c = 0; c < n; ++c) j(r, c) = random.Normal();
  }
  NormalEquations normal;
  normal.information = j.transpose() * j;
  for (std::size_t i = 0; i < layout.sensors(); ++i) {
    for (const int k : {kEdgeShift, kEdgeShift + 1}) {
      const Eigen::Index column = layout.Nuisance(i, k);
      normal.information(column, column) += 1 / (kShift * kShift);
    }
  }
  normal.gradient.resize(n);
  for (Eigen::Index c = 0; c < n; ++c) normal.gradient[c] = random.Normal(0, 20);
  return normal;
}

TEST(Posterior, IsTheInverseWidenedByWhatWasLeftOut) {
  const ParameterLayout layout = LayoutOf(2, 2);
  NormalEquations normal = RandomNormal(layout);
  normal.pulls = PullsOf(normal.information, layout, PriorSigmas(layout), {});
  const Eigen::MatrixXd inverse = normal.information.fullPivLu().inverse();
  // All silhouettes shifted by 0.3 px: the estimate takes its prior's share of that for nothing.
  Eigen::VectorXd pull = Eigen::VectorXd::Zero(layout.size());
  for (std::size_t i = 0; i < 2; ++i) {
    for (const int k : {kEdgeShift, kEdgeShift + 1})
      pull[layout.Nuisance(i, k)] = 0.3 / (kShift * kShift);
  }
  const Eigen::VectorXd error = inverse * pull;
  const Eigen::MatrixXd widened = inverse + error * error.transpose();
  std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  const Posterior asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  constant[static_cast<std::size_t>(layout.Size())] = 1;
  const Posterior not_asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  const Eigen::VectorXd step = inverse * normal.gradient;
  for (Eigen::Index r = 0; r < layout.size(); ++r) {
    for (Eigen::Index c = 0; c < layout.size(); ++c) {
      const auto is_shift = [&](Eigen::Index column) {
        return column == layout.Nuisance(0, kEdgeShift) ||
               column == layout.Nuisance(0, kEdgeShift) + 1 ||
               column == layout.Nuisance(1, kEdgeShift) ||
               column == layout.Nuisance(1, kEdgeShift) + 1;
      };
      if (is_shift(r) || is_shift(c)) continue;
      EXPECT_NEAR(asked.covariance(r, c), widened(r, c), 1e-12);
      EXPECT_NEAR(not_asked.covariance(r, c), widened(r, c) + step[r] * step[c], 1e-12);
    }
  }
}

// An estimate that takes consider parameters for 0 is off by its least squares' answer to them, and
// has the covariance that it has where they are 0.
TEST(Posterior, CountsConsiderParameters) {
  const ParameterLayout layout = LayoutOf(2, 1);
  const Eigen::VectorXd sigmas = PriorSigmas(layout);
  NormalEquations normal = RandomNormal(layout);
  const std::vector<FrameErrorVector> considered = {FrameErrorVector(0.01, 0.02, 0.03, 0.05, 0.04),
                                                    FrameErrorVector(0.02, 0.01, 0, 0.02, 0.03)};
  std::vector<char> is_considered(static_cast<std::size_t>(layout.size()), 0);
  for (std::size_t i = 0; i < 2; ++i) {
    for (int k = 0; k < kFrameErrors; ++k)
      is_considered[static_cast<std::size_t>(layout.Considered(i) + k)] = 1;
  }
  const Eigen::MatrixXd held = ConditionalPosterior(normal, is_considered, sigmas).covariance;
  Eigen::MatrixXd expected = held;
  Eigen::VectorXd bounced = Eigen::VectorXd::Zero(layout.size());
  for (std::size_t i = 0; i < 2; ++i) {
    for (int k = 0; k < kFrameErrors; ++k) {
      const Eigen::VectorXd error =
          considered[i][k] * held * normal.information.col(layout.Considered(i) + k);
      expected += error * error.transpose();
      if (k == kBounced) bounced += kMeanOfBounced * error;
    }
  }
  expected += bounced * bounced.transpose();
  for (std::size_t k = 0; k < is_considered.size(); ++k) {
    const auto column = static_cast<Eigen::Index>(k);
    if (is_considered[k]) normal.information(column, column) += 1 / Square(sigmas[column]);
  }
  normal.pulls =
      PullsOf(normal.information, layout, sigmas, considered).rightCols(1 + 2 * kFrameErrors);
  const std::vector<char> none(is_considered.size(), 0);
  const Eigen::MatrixXd covariance = ComputePosterior(normal, none, sigmas).covariance;
  for (Eigen::Index r = 0; r < layout.size(); ++r) {
    for (Eigen::Index c = 0; c < layout.size(); ++c) {
      if (is_considered[static_cast<std::size_t>(r)] || is_considered[static_cast<std::size_t>(c)])
        continue;
      EXPECT_NEAR(covariance(r, c), expected(r, c),
                  1e-6 * std::sqrt(expected(r, r) * expected(c, c)));
    }
  }
  EXPECT_GT(expected(0, 0), held(0, 0));
}

TEST(Posterior, IsThePriorsWhereTheNormalEquationsTellNothing) {
  const ParameterLayout layout = LayoutOf(2, 1);
  const Eigen::VectorXd sigmas = PriorSigmas(layout);
  const std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  NormalEquations normal;
  normal.information = 100 * Eigen::MatrixXd::Identity(layout.size(), layout.size());
  normal.gradient = Eigen::VectorXd::Zero(layout.size());
  EXPECT_TRUE(ComputePosterior(normal, constant, sigmas).exact);
  // Neither measured nor even held by its prior; and not a number.
  for (const double nothing : {0.0, std::nan("")}) {
    NormalEquations singular = normal;
    singular.information(layout.Offset(0), layout.Offset(0)) = nothing;
    singular.information(layout.Pose(1) + 2, layout.Pose(1) + 2) = nothing;
    const Posterior posterior = ComputePosterior(singular, constant, sigmas);
    EXPECT_FALSE(posterior.exact);
    ASSERT_TRUE(posterior.covariance.allFinite());
    EXPECT_NEAR(posterior.Sigma(layout.Offset(0)), 1, 1e-9);
    EXPECT_NEAR(posterior.Sigma(layout.Pose(1) + 2), 1, 1e-9);
    EXPECT_NEAR(posterior.Sigma(layout.Pose(0)), 0.1, 1e-9) << "what is known stays known";
    EXPECT_TRUE(ConditionalPosterior(singular, constant, sigmas).covariance.allFinite());
  }
}

TEST(ConditionalPosterior, KnowsWhatIsConstant) {
  const ParameterLayout layout = LayoutOf(1, 1);
  const NormalEquations normal = RandomNormal(layout);
  std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  constant[2] = constant[9] = 1;
  const Posterior posterior = ConditionalPosterior(normal, constant, PriorSigmas(layout));
  // The inverse of what is left when the rows and columns of the constant ones are struck out.
  std::vector<Eigen::Index> rest;
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    if (!constant[static_cast<std::size_t>(k)]) rest.push_back(k);
  }
  const auto n = static_cast<Eigen::Index>(rest.size());
  Eigen::MatrixXd struck(n, n);
  for (Eigen::Index r = 0; r < n; ++r) {
    for (Eigen::Index c = 0; c < n; ++c)
      struck(r, c) =
          normal.information(rest[static_cast<std::size_t>(r)], rest[static_cast<std::size_t>(c)]);
  }
  const Eigen::MatrixXd inverse = struck.fullPivLu().inverse();
  for (Eigen::Index r = 0; r < n; ++r)
    EXPECT_NEAR(posterior.Sigma(rest[static_cast<std::size_t>(r)]), std::sqrt(inverse(r, r)),
                1e-12);
}

TEST(GaugeProjection, TakesOutWhatAllBoxesDoTogether) {
  const Structure structure = testing_infer::PaperStructure();
  Priors priors;
  priors.box = 0.004;
  priors.yaw = 0.009;
  const Eigen::MatrixXd projection = GaugeProjection(structure, priors);
  const auto boxes = static_cast<Eigen::Index>(structure.boxes().size());
  // A small turn of the whole stack about the structure's vertical, and a shift of it.
  Eigen::VectorXd together(3 * boxes);
  constexpr double kTurn = 1e-3;
  for (Eigen::Index b = 0; b < boxes; ++b) {
    const Eigen::Vector3d centre =
        structure.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
    const Eigen::Vector3d moved = Eigen::AngleAxisd(kTurn, Eigen::Vector3d::UnitY()) * centre +
                                  Eigen::Vector3d(0.01, 0, -0.02);
    together.segment<3>(3 * b) << moved.x() - centre.x(), moved.z() - centre.z(), kTurn;
  }
  EXPECT_LT((projection * together).cwiseAbs().maxCoeff(), 1e-6) << "nothing is left of it";
  EXPECT_TRUE((projection * projection).isApprox(projection, 1e-9));
  // What is left has the least prior cost of all that differ by the gauge alone.
  Eigen::VectorXd apart = Eigen::VectorXd::Zero(3 * boxes);
  apart[0] = 0.01;
  const auto cost = [&](const Eigen::VectorXd& x) {
    double sum = 0;
    for (Eigen::Index k = 0; k < x.size(); ++k) {
      const double sigma = k % 3 == 2 ? priors.yaw : priors.box;
      sum += x[k] * x[k] / (sigma * sigma);
    }
    return sum;
  };
  const Eigen::VectorXd left = projection * apart;
  for (const double step : {-0.1, 0.1}) EXPECT_GT(cost(left + step * together), cost(left));
}

}  // namespace
}  // namespace volalign::refine_internal::posterior_test
