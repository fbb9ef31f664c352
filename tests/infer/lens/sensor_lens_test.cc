#include "infer/lens/sensor_lens.h"

#include <gtest/gtest.h>
#include <Eigen/LU>
#include <Eigen/QR>

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "infer/lens/likelihood.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::sensor_lens_test {
namespace {

using namespace refine_internal;
using namespace testing_infer;

/// A change of a size that lenses of one kind have.
const LensChange kChange(0.004, -0.03, 0.05);

/// Some lenses: none, Brown's with tangential terms, the rational one.
std::vector<Intrinsics> Lenses() {
  Intrinsics brown = Kinect();
  brown.distortion = {-0.12, 0.03, 0.002, -0.003, 0.01};
  return {Kinect(), brown, KinectWithLens()};
}

TEST(RayByLens, IsTheDerivativeOfTheRayOfAFixedPixel) {
  constexpr double kStep = 1e-5;
  for (const Intrinsics& lens : Lenses()) {
    for (const double u : {3.0, 90.5, 163.9, 310.0}) {
      for (const double v : {5.0, 140.0, 280.0}) {
        const RayByLensMatrix by_lens = RayByLens(lens, RayThroughLens(lens, u, v));
        for (int k = 0; k < kLensParameters; ++k) {
          const LensChange step = kStep * LensChange::Unit(k);
          const Eigen::Vector2d numeric = (RayThroughLens(WithLensChange(lens, step), u, v) -
                                           RayThroughLens(WithLensChange(lens, -step), u, v)) /
                                          (2 * kStep);
          EXPECT_LT((by_lens.col(k) - numeric).norm(), 1e-5) << k << " at " << u << ", " << v;
        }
      }
    }
  }
}

TEST(LookThrough, MakesAnewWhatIsSeenThroughAnotherLens) {
  const DepthImage depth(Kinect().width, Kinect().height, 2.0F);
  std::vector<SensorFrame> frames(2);
  for (std::size_t i = 0; i < 2; ++i) {
    frames[i].name = i == 0 ? "stays" : "changes";
    frames[i].depth = depth;
    frames[i].intrinsics = Kinect();
  }
  const CaptureSet capture({{"", frames}}, {});
  const LensSet before = GivenLenses(capture);
  PerFrame<SensorView> views = LookThrough(capture, before, 1);
  constexpr float kMark = 7;
  for (const FrameId id : views.Ids()) views[id].depth(0, 0) = kMark;
  LensSet after = before;
  after.lenses[after.of_frame[{0, 1}]].change = kChange;
  after.own_focal[{0, 1}] = 0.004;
  EXPECT_EQ((after.Effective({0, 1})), WithLensChange(Kinect(), kChange + LensChange(0.004, 0, 0)));
  const PerFrame<SensorView> again = LookThrough(capture, after, views, before, 2);
  EXPECT_EQ((again[{0, 0}].depth(0, 0)), kMark) << "the same view";
  EXPECT_EQ((again[{0, 1}].depth(0, 0)), depth(0, 0));
  EXPECT_EQ((again[{0, 1}].rays.rays),
            MakeSensorView(frames[1], after.Effective({0, 1})).rays.rays);
}

TEST(SamePixelRay, SeesTheSamePixelThroughAnotherLens) {
  for (const Intrinsics& from : Lenses()) {
    for (const Intrinsics& to : Lenses()) {
      const Intrinsics changed = WithLensChange(to, kChange);
      for (const double u : {3.0, 200.0, 310.0}) {
        const Eigen::Vector2d expected = RayThroughLens(changed, u, 30);
        EXPECT_LT((SamePixelRay(from, changed, RayThroughLens(from, u, 30)) - expected).norm(),
                  1e-7);
      }
    }
  }
}

TEST(SamePixelRay, IsNaNWhereTheModelFoldsOver) {
  Intrinsics folded = Kinect();
  folded.distortion = {-1.5, 0, 0, 0};
  EXPECT_FALSE(SamePixelRay(Kinect(), folded, RayThroughLens(Kinect(), 0, 0)).allFinite());
}

SensorFrame FrameOf(const std::string& kind, std::vector<double> distortion) {
  SensorFrame frame;
  frame.sensor = kind;
  frame.intrinsics = Kinect();
  frame.intrinsics.distortion = std::move(distortion);
  return frame;
}

/// Of frames in the order of their captures.
template <class T>
std::vector<T> InOrder(const PerFrame<T>& values) {
  std::vector<T> all;
  for (const FrameId id : values.Ids()) all.push_back(values[id]);
  return all;
}

CaptureSet CaptureOf(std::vector<SensorFrame> frames) { return {{{"", std::move(frames)}}, {}}; }

TEST(AssumeLenses, SensorsOfAKindShareALensAndTheOthersHaveTheirOwn) {
  const std::vector<double> given(5, 0.0);
  std::vector<SensorFrame> frames = {FrameOf("azure_kinect_nfov_binned", {}),
                                     FrameOf("realsense_d415", {}),
                                     FrameOf("azure_kinect_nfov_binned", {}),
                                     FrameOf("azure_kinect_nfov_binned", given),
                                     FrameOf("", {}),
                                     FrameOf("", {})};
  for (std::size_t i = 0; i < frames.size(); ++i) frames[i].name = "S" + std::to_string(i);
  const CaptureSet capture = CaptureOf(frames);
  const LensSet shared = AssumeLenses(capture, false);
  EXPECT_EQ(InOrder(shared.of_frame), (std::vector<std::size_t>{0, 1, 0, 2, 3, 4}));
  EXPECT_EQ(shared.lenses.size(), 5u);
  const LensSet own = AssumeLenses(capture, true);
  EXPECT_EQ(InOrder(own.of_frame), (std::vector<std::size_t>{0, 1, 2, 3, 4, 5}));
  // One's own deviation is told from the lens only where another one has that lens, too.
  EXPECT_EQ(shared.lenses[0].own_focal_sigma, 0.001);
  for (const std::size_t single : {1, 2, 3, 4})
    EXPECT_EQ(shared.lenses[single].own_focal_sigma, 0) << single;
  for (const SensorLens& lens : own.lenses) EXPECT_EQ(lens.own_focal_sigma, 0);

  // What the capture gives is kept; what it does not give is what the kind has.
  const std::vector<Intrinsics> assumed = InOrder(shared.assumed);
  EXPECT_EQ(assumed[3].distortion, given);
  EXPECT_TRUE(assumed[1].distortion.empty());
  EXPECT_TRUE(assumed[4].distortion.empty());
  ASSERT_EQ(assumed[0].distortion.size(), 8u);
  const FrameId known{0, 0}, told{0, 3}, unknown{0, 4};
  EXPECT_GT(shared.Of(unknown).prior_sigmas.minCoeff(), 0);
  for (const int k : {1, 2}) {
    EXPECT_GT(shared.Of(unknown).prior_sigmas[k], 10 * shared.Of(known).prior_sigmas[k]);
    EXPECT_GT(shared.Of(known).prior_sigmas[k], shared.Of(told).prior_sigmas[k]);
  }
}

TEST(AssumeLenses, FramesOfOneNameAreOfOneSensor) {
  // Two captures of two sensors.
  std::vector<SensorFrame> frames(2, FrameOf("", {}));
  frames[0].name = "A";
  frames[1].name = "B";
  const CaptureSet capture({{"first", frames}, {"second", {frames[1], frames[0]}}}, {});
  for (const LensSet& lenses :
       {AssumeLenses(capture, false), AssumeLenses(capture, true), GivenLenses(capture)}) {
    EXPECT_EQ(InOrder(lenses.of_frame), (std::vector<std::size_t>{0, 1, 1, 0}));
    EXPECT_EQ(lenses.lenses.size(), 2u);
    EXPECT_EQ(InOrder(lenses.repeats), (std::vector<char>{0, 0, 1, 1}));
  }
}

TEST(AssumeLenses, KindsHaveTheLensesOfTheIntrinsicsPool) {
  for (const IntrinsicsPoolEntry& entry : ReadIntrinsicsPool("configs/intrinsics.yaml")) {
    if (entry.sensor == "kinect_v1") continue;  // nothing is known of it
    for (const Intrinsics& intrinsics : entry.intrinsics) {
      Intrinsics assumed = intrinsics;
      assumed.distortion =
          AssumeLenses(CaptureOf({FrameOf(entry.sensor, {})}), false).assumed[{}].distortion;
      EXPECT_LT(LargestShift(assumed, intrinsics), 1e-6) << entry.sensor;
    }
  }
}

TEST(LargestShift, IsTheFarthestThatAnyPixelMoves) {
  Intrinsics wide = Kinect();
  wide.distortion = {-0.2, 0.02, 0, 0};
  // A factor on the focal length moves the corner that is farthest from the principal point most.
  const double corner = std::hypot(wide.cx, wide.cy);
  for (const Intrinsics& lens : {Kinect(), wide}) {
    EXPECT_NEAR(LargestShift(lens, lens), 0, 1e-9);
    EXPECT_NEAR(LargestShift(lens, WithLensChange(lens, LensChange(0.01, 0, 0))), 0.01005 * corner,
                1e-3 * corner);
  }
}

/// By numerical integration over one parameter at a time, which is all that a measurement of it
/// leaves open.
TEST(LogBayesFactor, IsTheRatioOfTheEvidences) {
  const Eigen::Vector3d prior(0.01, 0.2, 0.1);
  LensEvidence evidence;
  const double measured = 0.12, sigma = 0.05;  // of k1
  evidence.information(1, 1) = 1 / (sigma * sigma);
  evidence.moment[1] = measured / (sigma * sigma);
  double sum = 0;
  constexpr double kStep = 1e-4;
  for (double k1 = -2; k1 < 2; k1 += kStep)
    sum += std::exp(-0.5 * std::pow((k1 - measured) / sigma, 2)) *
           std::exp(-0.5 * std::pow(k1 / prior[1], 2)) / (prior[1] * std::sqrt(2 * M_PI)) * kStep;
  const double expected = std::log(sum / std::exp(-0.5 * std::pow(measured / sigma, 2)));
  EXPECT_NEAR(LogBayesFactor(EstimateLens(evidence, prior), prior), expected, 1e-6);
  EXPECT_LT(LogBayesFactor(EstimateLens(LensEvidence(), prior), prior), 1e-9);
  EXPECT_EQ(LogBayesFactor(LensEstimate(), Eigen::Vector3d::Zero()), 0) << "a known lens";
}

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
}  // namespace volalign::sensor_lens_test
