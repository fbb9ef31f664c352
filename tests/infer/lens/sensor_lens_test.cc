#include "infer/lens/sensor_lens.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::sensor_lens_test {
namespace {

using testing_infer::Kinect;
using testing_infer::KinectWithLens;
using testing_infer::RayThroughLens;

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

/// Of frames in the order of their stills.
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
  // Two stills of two sensors.
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

/// Radial factors of the Azure Kinect's lens at a tenth of the tangent each: two factory
/// calibrations (Azure-Kinect-Sensor-SDK, issues 1518 and 1488) agree on them to 0.1 %.
TEST(AssumeLenses, AnAzureKinectHasTheCurveOfItsFactoryCalibrations) {
  const Intrinsics lens =
      AssumeLenses(CaptureOf({FrameOf("azure_kinect_nfov_binned", {})}), false).assumed[{}];
  for (const auto& [radius, factor] :
       std::vector<std::pair<double, double>>{{0.2, 0.987}, {0.4, 0.950}, {0.6, 0.898}}) {
    // The pixel at that radius times the factor sees the direction at that radius.
    const double u = lens.cx + lens.fx * radius * factor;
    EXPECT_NEAR(RayThroughLens(lens, u, lens.cy).x(), radius, 1e-3 * radius);
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

TEST(GivenLenses, AreAsTheyAreGiven) {
  const std::vector<SensorFrame> frames = {FrameOf("azure_kinect_nfov_binned", {}),
                                           FrameOf("", {0.1, 0, 0, 0})};
  const LensSet lenses = GivenLenses(CaptureOf(frames));
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(lenses.Effective({0, i}) == frames[i].intrinsics);
    EXPECT_TRUE(lenses.Of({0, i}).prior_sigmas.isZero());
  }
}

TEST(LargestShift, IsTheFarthestThatAnyPixelMoves) {
  const Intrinsics lens = Kinect();
  EXPECT_EQ(LargestShift(lens, lens), 0);
  // A factor on the focal length moves the corner that is farthest from the principal point most.
  const double corner = std::hypot(lens.cx, lens.cy);
  EXPECT_NEAR(LargestShift(lens, WithLensChange(lens, LensChange(0.01, 0, 0))), 0.01005 * corner,
              1e-3 * corner);
}

TEST(LargestShift, OfAWideLensIsThatOfItsPixels) {
  Intrinsics lens = Kinect();
  lens.distortion = {-0.2, 0.02, 0, 0};
  const double corner = std::hypot(lens.cx, lens.cy);
  EXPECT_NEAR(LargestShift(lens, WithLensChange(lens, LensChange(0.01, 0, 0))), 0.01005 * corner,
              1e-3 * corner);
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
  for (double k1 = -2; k1 < 2; k1 += kStep) {
    sum += std::exp(-0.5 * std::pow((k1 - measured) / sigma, 2)) *
           std::exp(-0.5 * std::pow(k1 / prior[1], 2)) / (prior[1] * std::sqrt(2 * M_PI)) * kStep;
  }
  const double expected = std::log(sum / std::exp(-0.5 * std::pow(measured / sigma, 2)));
  EXPECT_NEAR(LogBayesFactor(EstimateLens(evidence, prior), prior), expected, 1e-6);
  EXPECT_LT(LogBayesFactor(EstimateLens(LensEvidence(), prior), prior), 1e-9);
  EXPECT_EQ(LogBayesFactor(LensEstimate(), Eigen::Vector3d::Zero()), 0) << "a known lens";
}

}  // namespace
}  // namespace volalign::sensor_lens_test
