#include "infer/lens/likelihood.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <limits>

#include "core/base/random.h"

namespace volalign::refine_internal::likelihood_test {
namespace {

Eigen::MatrixXd Normal(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  RandomStream random(seed, 0, "likelihood");
  Eigen::MatrixXd m(rows, columns);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = random.Normal();
  return m;
}

// Matern's function of order 3/2 as it is defined, by a modified Bessel function of the second kind
// (Rasmussen and Williams, "Gaussian Processes for Machine Learning", equation 4.14).
TEST(Correlation, IsMaternsOfOrderThreeHalves) {
  constexpr double kOrder = 1.5;
  for (const double length : {0.05, 1.0, 7.0}) {
    EXPECT_DOUBLE_EQ(Correlation(0, length), 1);
    for (const double share : {0.01, 0.3, 1.0, 2.5, 6.0}) {
      const double x = std::sqrt(2 * kOrder) * share;
      const double expected = std::pow(2, 1 - kOrder) / std::tgamma(kOrder) * std::pow(x, kOrder) *
                              std::cyl_bessel_k(kOrder, x);
      EXPECT_NEAR(Correlation(share * length, length), expected, 1e-7);
    }
  }
}

/// Of what no values of the parameters change: the residuals' components at right angles to J.
double CostOfContrasts(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                       const Eigen::MatrixXd& jacobian) {
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(jacobian);
  const Eigen::MatrixXd q = qr.householderQ();
  const Eigen::MatrixXd contrasts = q.rightCols(r.size() - jacobian.cols());
  const Eigen::MatrixXd of = contrasts.transpose() * covariance * contrasts;
  const Eigen::VectorXd left = contrasts.transpose() * r;
  return 0.5 * std::log(of.determinant()) + 0.5 * left.dot(of.inverse() * left);
}

// Patterson and Thompson's likelihood is that of these contrasts, but for half the logarithm of
// |J^T J|, which no covariance changes.
TEST(RestrictedCost, IsTheLikelihoodOfErrorContrasts) {
  constexpr Eigen::Index kRows = 9, kParameters = 3;
  const Eigen::MatrixXd jacobian = 100 * Normal(kRows, kParameters, 1);
  const double constant = 0.5 * std::log((jacobian.transpose() * jacobian).determinant());
  for (std::uint64_t seed = 2; seed < 8; ++seed) {
    const Eigen::MatrixXd root = Normal(kRows, kRows, seed);
    const Eigen::MatrixXd covariance =
        root * root.transpose() + 0.1 * Eigen::MatrixXd::Identity(kRows, kRows);
    const Eigen::VectorXd r = 3 * Normal(kRows, 1, 100 + seed);
    EXPECT_NEAR(RestrictedCost(covariance, r, jacobian),
                CostOfContrasts(covariance, r, jacobian) + constant, 1e-4);
    // What the parameters explain costs nothing.
    const Eigen::VectorXd moved = r + jacobian * Normal(kParameters, 1, 200 + seed);
    EXPECT_NEAR(RestrictedCost(covariance, moved, jacobian),
                RestrictedCost(covariance, r, jacobian), 0.05);
  }
}

TEST(RestrictedCost, IsLeastNearTheTrueVariance) {
  constexpr Eigen::Index kRows = 400;
  const Eigen::MatrixXd jacobian = 100 * Normal(kRows, 2, 1);
  const Eigen::VectorXd r = 0.7 * Normal(kRows, 1, 2);
  double sigma = 0;
  MinimiseOverLog(
      0.3, 2,
      [&](double s) {
        return RestrictedCost(s * s * Eigen::MatrixXd::Identity(kRows, kRows), r, jacobian);
      },
      &sigma);
  // The variance's own standard error is sigma^2 sqrt(2 / 398).
  EXPECT_NEAR(sigma, 0.7, 3 * 0.7 / std::sqrt(2 * 398.0));
}

TEST(RestrictedCost, HasNoFactorOfWhatIsNoCovariance) {
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(3, 3);
  covariance(2, 2) = -1;
  EXPECT_EQ(RestrictedCost(covariance, Eigen::Vector3d::Ones(), Eigen::MatrixXd::Ones(3, 1)),
            std::numeric_limits<double>::infinity());
}

TEST(MinimiseOverLog, FindsAParabolasVertexBetweenItsSteps) {
  for (const double vertex : {0.02, 0.37, 1.0, 5.5}) {
    double best = 0;
    const double least = MinimiseOverLog(
        0.01, 10,
        [&](double x) {
          const double away = std::log(x / vertex);
          return 2 + 3 * away * away;
        },
        &best);
    EXPECT_NEAR(best, vertex, 1e-9 * vertex);
    EXPECT_GE(least, 2) << "the value at the nearest step";
    // Half a step of eight away: ln(1000) / 7 / 2.
    EXPECT_LE(least, 2 + 3 * std::pow(std::log(1000.0) / 14, 2) + 1e-9);
  }
}

TEST(MinimiseOverLog, StaysWithinItsBounds) {
  double best = 0;
  EXPECT_DOUBLE_EQ(MinimiseOverLog(
                       0.1, 10, [](double x) { return x; }, &best),
                   0.1);
  EXPECT_DOUBLE_EQ(best, 0.1);
  MinimiseOverLog(
      0.1, 10, [](double x) { return -x; }, &best);
  EXPECT_NEAR(best, 10, 1e-12);
  // An infinite neighbour bends nothing.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  MinimiseOverLog(
      1, 128, [&](double x) { return std::abs(x - 8) < 0.1 ? 0 : kInfinity; }, &best);
  EXPECT_NEAR(best, 8, 1e-12);
}

}  // namespace
}  // namespace volalign::refine_internal::likelihood_test
