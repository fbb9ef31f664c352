#include "infer/refine/posterior.h"

#include <gtest/gtest.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/model_choice.h"
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

namespace volalign::refine_internal::model_choice_test {
namespace {

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
    free = AskedFor(ParseEstimate("auto"), priors, 2, 4);
    cost.prior_sigmas = layout.PriorSigmas(priors, {ErrorsOf(""), ErrorsOf("")});
    cost.normal.information = 101 * cost.prior_sigmas.cwiseAbs2().cwiseInverse().asDiagonal();
    cost.normal.gradient = Eigen::VectorXd::Zero(layout.size());
    cost.values = Eigen::VectorXd::Zero(layout.size());
  }
};

TEST(MostProbableScales, AreNominalWhereNothingStrays) {
  const Measured measured;
  const PriorScales scales =
      MostProbableScales(measured.cost, measured.layout, measured.free, 2).value();
  EXPECT_EQ(scales.places, 0);
  EXPECT_EQ(scales.turns, 0);
  EXPECT_EQ(scales.size, 0);
  EXPECT_EQ(scales.gain, 0);
  EXPECT_EQ(scales.offset, 0);
}

TEST(MostProbableScales, FollowWhatStrays) {
  Measured measured;
  const auto stray = [&](Eigen::Index column, double sigmas) {
    measured.cost.values[column] = sigmas * measured.cost.prior_sigmas[column];
  };
  stray(measured.layout.Offset(0), 1.2);
  stray(measured.layout.Offset(1), -0.9);
  for (int box = 0; box < 4; ++box) {
    stray(measured.layout.Boxes() + BuildModel::X(box), 0.3);
    stray(measured.layout.Boxes() + BuildModel::Z(box), -0.35);
  }
  const PriorScales scales =
      MostProbableScales(measured.cost, measured.layout, measured.free, 2).value();
  EXPECT_EQ(scales.offset, 1);
  EXPECT_EQ(scales.places, 0.3);
  EXPECT_EQ(scales.turns, 0) << "boxes out of their places are not turned";
  EXPECT_EQ(scales.size, 0);
  EXPECT_EQ(scales.gain, 0);
  measured.free.offset = {0, 0};
  EXPECT_EQ(MostProbableScales(measured.cost, measured.layout, measured.free, 2)->places, 0.3)
      << "whatever is held";
}

TEST(WithoutAlwaysFree, EvidenceDiffersByAConstant) {
  const ParameterLayout layout = LayoutOf(2, 3);
  const auto n = static_cast<int>(layout.size());
  const Linear linear(Eigen::Index{2} * n, Eigen::VectorXd::LinSpaced(n, 0.5, 2), 7);
  Eigen::VectorXd at = Eigen::VectorXd::LinSpaced(n, -0.3, 0.4);
  const QuadraticCost all = linear.CostAt(at);
  const MarginalCost marginal = WithoutAlwaysFree(all, layout).value();
  EXPECT_EQ(marginal.columns.size(), 2u + 2 + 2 + 3 + 1 + 9)
      << "offsets, gains, focal lengths, lens, size, boxes";
  double constant = 0;
  for (const PriorScales& scales :
       {PriorScales{1, 1, 1, 1, 1}, {0, 0, 0, 0, 0}, {0.3, 0, 1, 0.3, 0}, {1, 0.3, 0, 0, 1}}) {
    const Eigen::VectorXd of_all = layout.Scales(scales);
    const double difference =
        FitModel(all, of_all, false)->log_evidence -
        FitModel(marginal.cost, of_all(marginal.columns), false)->log_evidence;
    if (scales.places == 1 && scales.turns == 1) constant = difference;
    EXPECT_NEAR(difference, constant, 1e-8);
  }
}

/// What is believed of a parameter of prior N(0, 1), measured as y with a standard deviation of
/// 0.1, where it is not known whether its prior is 0, 0.3 or 1 wide: the mean square of its
/// distance from `from`.
double SpreadOverWidths(double y, double from) {
  double weights = 0, sum = 0;
  for (const double width : {0.0, 0.3, 1.0}) {
    const double variance = width * width + 0.01;  // of y
    const double weight = std::exp(-0.5 * y * y / variance) / std::sqrt(variance);
    const double mean = width * width / variance * y;
    const double left = width * width * 0.01 / variance;
    sum += weight * (left + (mean - from) * (mean - from));
    weights += weight;
  }
  return sum / weights;
}

TEST(CovarianceOverModels, CountsHowFarModelsAreApart) {
  Measured measured;
  const Eigen::Index size = measured.layout.Size(), offset = measured.layout.Offset(0);
  const double size_sigma = measured.cost.prior_sigmas[size];
  // The solution is where the widest prior has it, 1 in 101 nearer to zero than the measurement.
  const double measured_at = 0.2525, solution = measured_at * 100 / 101;
  measured.cost.values[size] = solution * size_sigma;
  const Eigen::MatrixXd covariance =
      CovarianceOverModels(measured.cost, measured.layout, 2).value();
  const double expected = SpreadOverWidths(measured_at, solution);
  ASSERT_GT(expected, 1.5 * SpreadOverWidths(0, 0)) << "there is something to be counted";
  // Models of little weight are left out.
  EXPECT_NEAR(covariance(size, size) / (size_sigma * size_sigma), expected, 0.03 * expected);
  // What the models agree on is as each of them has it.
  const Eigen::Index pose = measured.layout.Pose(1);
  EXPECT_NEAR(covariance(pose, pose), 1 / measured.cost.normal.information(pose, pose), 1e-12);
  EXPECT_LT(covariance(offset, offset), measured.cost.prior_sigmas[offset] / 10);
}

TEST(CovarianceOverModels, IsTheMeanOverAllModels) {
  const ParameterLayout layout = LayoutOf(2, 3);
  const auto n = static_cast<int>(layout.size());
  const Linear linear(Eigen::Index{2} * n, Eigen::VectorXd::LinSpaced(n, 0.5, 2), 7);
  const QuadraticCost cost = linear.CostAt(Eigen::VectorXd::LinSpaced(n, -0.3, 0.4));
  std::vector<ModelFit> fits;
  double most = -1e9;
  for (int k = 0; k < 243; ++k) {
    const auto scale = [&](int of) { return std::array{0.0, 0.3, 1.0}[k / of % 3]; };
    const PriorScales scales{scale(1), scale(3), scale(9), scale(27), scale(81)};
    fits.push_back(FitModel(cost, layout.Scales(scales), true).value());
    most = std::max(most, fits.back().log_evidence);
  }
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(n, n);
  double weights = 0;
  for (const ModelFit& fit : fits) {
    const double weight = std::exp(fit.log_evidence - most);
    expected += weight * (fit.covariance + fit.step * fit.step.transpose());
    weights += weight;
  }
  expected /= weights;
  const Eigen::MatrixXd covariance = CovarianceOverModels(cost, layout, 2).value();
  // Models of little weight are left out.
  EXPECT_LT((covariance - expected).norm(), 0.01 * expected.norm());
}

TEST(CovarianceOverModels, SaysWhereThereIsNone) {
  // Of a direction that is always free, the cost is no minimum.
  Measured measured;
  const Eigen::Index pose = measured.layout.Pose(1);
  measured.cost.normal.information(pose, pose) = -1;
  EXPECT_FALSE(WithoutAlwaysFree(measured.cost, measured.layout));
  EXPECT_FALSE(MostProbableScales(measured.cost, measured.layout, measured.free, 2));
  EXPECT_FALSE(CovarianceOverModels(measured.cost, measured.layout, 2));
}

TEST(CovarianceOverModels, IsFiniteOrNone) {
  // A pull on what is always free that is finite, but whose square is not: the scales can be
  // judged without it, and the covariance cannot be computed under any.
  Measured measured;
  measured.cost.normal.gradient[measured.layout.Pose(1)] = 1e200;
  ASSERT_TRUE(WithoutAlwaysFree(measured.cost, measured.layout));
  ASSERT_TRUE(MostProbableScales(measured.cost, measured.layout, measured.free, 2));
  EXPECT_FALSE(CovarianceOverModels(measured.cost, measured.layout, 2));
}

}  // namespace
}  // namespace volalign::refine_internal::model_choice_test
