#include "infer/refine/posterior.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/sensor_kind.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::posterior_test {
namespace {

/// Of all parameters: 1.
Eigen::VectorXd PriorSigmas(const ParameterLayout& layout) {
  Priors priors;
  priors.gain = priors.offset = priors.size = priors.box = priors.yaw = priors.bulge =
      priors.edge_shift = 1;
  return layout.PriorSigmas(priors, std::vector<DepthErrorModel>(layout.sensors(), ErrorsOf("")));
}

/// Random measurements of everything.
NormalEquations RandomNormal(const ParameterLayout& layout) {
  RandomStream random(5, 0, "normal equations");
  const Eigen::Index n = layout.size();
  Eigen::MatrixXd j(3 * n, n);
  for (Eigen::Index r = 0; r < j.rows(); ++r) {
    for (Eigen::Index c = 0; c < n; ++c) j(r, c) = random.Normal();
  }
  NormalEquations normal;
  normal.information = j.transpose() * j;
  normal.gradient.resize(n);
  for (Eigen::Index c = 0; c < n; ++c) normal.gradient[c] = random.Normal(0, 20);
  return normal;
}

TEST(Posterior, IsTheInverseWidenedByWhatWasLeftOut) {
  const ParameterLayout layout = LayoutOf(2, 2);
  const NormalEquations normal = RandomNormal(layout);
  const Eigen::MatrixXd inverse = normal.information.fullPivLu().inverse();
  std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  const Posterior asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  constant[static_cast<std::size_t>(layout.Size())] = 1;
  const Posterior not_asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  const Eigen::VectorXd step = inverse * normal.gradient;
  EXPECT_TRUE(asked.covariance.isApprox(inverse, 1e-9));
  EXPECT_TRUE(not_asked.covariance.isApprox(inverse + step * step.transpose(), 1e-9));
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
