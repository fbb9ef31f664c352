#include "infer/refine/posterior.h"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/prior_scales.h"
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
  for (double& x : j.reshaped()) x = random.Normal();
  NormalEquations normal;
  normal.information = j.transpose() * j;
  normal.gradient.resize(n);
  for (double& x : normal.gradient) x = random.Normal(0, 20);
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
  const Eigen::MatrixXd struck = normal.information(rest, rest);
  const Eigen::MatrixXd inverse = struck.fullPivLu().inverse();
  for (Eigen::Index r = 0; r < inverse.rows(); ++r)
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
  const Eigen::Vector3d sigmas(priors.box, priors.box, priors.yaw);
  const auto cost = [&](const Eigen::VectorXd& x) {
    return x.cwiseQuotient(sigmas.replicate(boxes, 1)).squaredNorm();
  };
  const Eigen::VectorXd left = projection * apart;
  for (const double step : {-0.1, 0.1}) EXPECT_GT(cost(left + step * together), cost(left));
}

/// Measurements y = A x + e, e of standard deviation 1, of parameters x whose priors are normal.
struct Linear {
  Eigen::MatrixXd a;
  Eigen::VectorXd y, sigmas;

  Linear(Eigen::Index measurements, Eigen::VectorXd prior_sigmas, std::uint64_t seed)
      : a(measurements, prior_sigmas.size()), y(measurements), sigmas(std::move(prior_sigmas)) {
    RandomStream random(seed, 0, "linear");
    for (Eigen::Index k = 0; k < a.size(); ++k) a.data()[k] = random.Normal();
    for (double& of : y) of = random.Normal();
  }

  /// Of the squares of residuals and priors, at `values`.
  QuadraticCost CostAt(const Eigen::VectorXd& values) const {
    const Eigen::VectorXd precisions = sigmas.cwiseAbs2().cwiseInverse();
    QuadraticCost cost;
    cost.normal.information = a.transpose() * a;
    cost.normal.information.diagonal() += precisions;
    cost.normal.gradient = a.transpose() * (a * values - y) + precisions.cwiseProduct(values);
    cost.prior_sigmas = sigmas;
    cost.values = values;
    return cost;
  }

  /// Density of y with x integrated out: normal, with covariance A P A^T + 1.
  double LogDensity(const Eigen::VectorXd& scales) const {
    const Eigen::VectorXd variances = sigmas.cwiseProduct(scales).cwiseAbs2();
    const Eigen::MatrixXd covariance =
        a * variances.asDiagonal() * a.transpose() + Eigen::MatrixXd::Identity(a.rows(), a.rows());
    return -0.5 * y.dot(covariance.inverse() * y) - 0.5 * std::log(covariance.determinant());
  }
};

TEST(FitModel, EvidenceIsTheDensityOfTheMeasurements) {
  const Linear linear(6, Eigen::Vector4d(2, 0.5, 3, 1), 1);
  const QuadraticCost cost = linear.CostAt(Eigen::Vector4d(0.3, -0.2, 1.5, 0.7));
  const auto difference = [&](const Eigen::Vector4d& scales) {
    return FitModel(cost, scales, false).value().log_evidence -
           FitModel(cost, Eigen::Vector4d::Ones(), false).value().log_evidence;
  };
  for (const Eigen::Vector4d& scales :
       {Eigen::Vector4d(0.3, 1, 1, 1), Eigen::Vector4d(1, 0, 0.1, 1), Eigen::Vector4d(0, 0, 0, 0.5),
        Eigen::Vector4d(0, 0, 0, 0)}) {
    EXPECT_NEAR(difference(scales),
                linear.LogDensity(scales) - linear.LogDensity(Eigen::Vector4d::Ones()), 1e-9)
        << scales.transpose();
  }
}

TEST(FitModel, StepAndCovarianceAreThoseOfTheNarrowerPriors) {
  const Linear linear(6, Eigen::Vector3d(2, 0.5, 3), 2);
  const Eigen::Vector3d values(0.3, -0.2, 1.5);
  const ModelFit fit = FitModel(linear.CostAt(values), Eigen::Vector3d(0.3, 0, 1), true).value();
  Eigen::MatrixXd open(6, 2);
  open << linear.a.col(0), linear.a.col(2);
  const Eigen::Matrix2d covariance =
      (open.transpose() * open + Eigen::Matrix2d(Eigen::Vector2d(1 / 0.36, 1 / 9.0).asDiagonal()))
          .inverse();
  const Eigen::Vector2d best = covariance * open.transpose() * linear.y;
  EXPECT_TRUE((values + fit.step).isApprox(Eigen::Vector3d(best[0], 0, best[1]), 1e-9));
  EXPECT_NEAR(fit.covariance(0, 0), covariance(0, 0), 1e-12);
  EXPECT_NEAR(fit.covariance(0, 2), covariance(0, 1), 1e-12);
  EXPECT_EQ(fit.covariance.col(1).norm(), 0);
}

/// Two sensors and the paper's boxes, of which each parameter beside the poses is measured to a
/// tenth of its prior's standard deviation.
struct Measured {
  ParameterLayout layout = LayoutOf(2, 4);
  FreeSet free;
  QuadraticCost cost;

  Measured() {
    const Priors priors = testing_infer::SomePriors();
    free = AskedFor(ParseEstimate("auto"), priors, 2);
    cost.prior_sigmas = layout.PriorSigmas(priors, {ErrorsOf(""), ErrorsOf("")});
    cost.normal.information = 101 * cost.prior_sigmas.cwiseAbs2().cwiseInverse().asDiagonal();
    cost.normal.gradient = Eigen::VectorXd::Zero(layout.size());
    cost.values = Eigen::VectorXd::Zero(layout.size());
  }
};

TEST(EstimatePriorScales, AreTheLeastWhereNothingStrays) {
  const Measured measured;
  const PriorScales scales =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  for (const double scale : scales) EXPECT_LT(scale, 0.06);
}

TEST(EstimatePriorScales, FollowWhatStrays) {
  Measured measured;
  const auto stray = [&](Eigen::Index column, double sigmas) {
    measured.cost.values[column] = sigmas * measured.cost.prior_sigmas[column];
  };
  stray(measured.layout.Offset(0), 1.4);
  stray(measured.layout.Offset(1), -0.9);
  stray(measured.layout.ErrorsOfSensor(0) + kDiffuseMultipath, -0.6);
  const Eigen::Index known = measured.layout.ErrorsOfSensor(1) + kDiffuseMultipath;
  measured.cost.prior_sigmas[known] = Positive(0);
  measured.cost.normal.information(known, known) = 1 / Square(Positive(0));
  for (int box = 0; box < 4; ++box) {
    stray(measured.layout.Boxes() + BuildModel::X(box), 0.3);
    stray(measured.layout.Boxes() + BuildModel::Z(box), -0.35);
  }
  const PriorScales scales =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  EXPECT_EQ(scales[kOffsets], 1) << "no wider than the prior";
  // Of one sensor alone: the other one has no multipath, so that its prior says nothing.
  EXPECT_NEAR(scales[kDiffuseMultipaths], std::sqrt(0.6 * 0.6 * 1.0201 - 0.01), 0.01);
  // The mean square of the values, less the measurements' own variance of a hundredth.
  EXPECT_NEAR(scales[kPlaces], std::sqrt((0.3 * 0.3 + 0.35 * 0.35) / 2 * 1.0201 - 0.01), 0.01);
  EXPECT_LT(scales[kTurns], 0.06) << "boxes out of their places are not turned";
  EXPECT_LT(scales[kSizes], 0.06);
  EXPECT_LT(scales[kGains], 0.06);
  measured.free.offset = false;
  const PriorScales without =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  EXPECT_NEAR(without[kPlaces], scales[kPlaces], 1e-6) << "whatever is held";
}

TEST(WidenedScales, CountOneMoreParameterThatStrays) {
  const Measured measured;
  PriorScales scales;
  scales << 0.5, 0, 0.2, 1, 0, 0.5;
  Eigen::VectorXd sigmas = measured.cost.prior_sigmas;
  sigmas[measured.layout.ErrorsOfSensor(1) + kDiffuseMultipath] = Positive(0);
  const PriorScales widened = WidenedScales(sigmas, measured.layout, measured.free, scales);
  EXPECT_NEAR(widened[kPlaces], std::sqrt((8 * 0.25 + 1) / 9), 1e-12) << "x and z of four boxes";
  EXPECT_NEAR(widened[kTurns], std::sqrt(1 / 5.0), 1e-12);
  EXPECT_NEAR(widened[kSizes], std::sqrt((0.04 + 1) / 2), 1e-12);
  EXPECT_EQ(widened[kGains], 1);
  EXPECT_NEAR(widened[kOffsets], std::sqrt(1 / 3.0), 1e-12) << "of two sensors";
  EXPECT_NEAR(widened[kDiffuseMultipaths], std::sqrt((0.25 + 1) / 2), 1e-12) << "one is known";
}

TEST(EstimatePriorScales, SaysWhereThereAreNone) {
  // Along a pose, the cost has no minimum.
  Measured measured;
  const Eigen::Index pose = measured.layout.Pose(1);
  measured.cost.normal.information(pose, pose) = -1;
  EXPECT_FALSE(EstimatePriorScales(measured.cost, measured.layout, measured.free));
}

}  // namespace
}  // namespace volalign::refine_internal::posterior_test
