#include "infer/lens/sensor_lens.h"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>

#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "infer/lens/find_lenses.h"
#include "infer/lens/likelihood.h"
#include "infer/lens/planes.h"
#include "infer/lens/straightness.h"
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
    const auto away = [&](double x) { return 2 + 3 * std::pow(std::log(x / vertex), 2); };
    EXPECT_NEAR(MinimiseOverLog(0.01, 10, away), vertex, 1e-9 * vertex);
  }
}

TEST(MinimiseOverLog, StaysWithinItsBounds) {
  EXPECT_DOUBLE_EQ(MinimiseOverLog(0.1, 10, [](double x) { return x; }), 0.1);
  EXPECT_NEAR(MinimiseOverLog(0.1, 10, [](double x) { return -x; }), 10, 1e-12);
  // An infinite neighbour bends nothing.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto pit = [&](double x) { return std::abs(x - 8) < 0.1 ? 0 : kInfinity; };
  EXPECT_NEAR(MinimiseOverLog(1, 128, pit), 8, 1e-12);
}

using namespace testing_infer;

/// Three sensors in a room, each with its own errors. The frames give the lens's pinhole alone.
std::vector<SensorFrame> FramesThrough(const Intrinsics& lens, std::uint64_t seed = 1) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) rig.Add(RingPose(25.0 + 110 * i, 2, 0.4, 90), {true, 3.2}, lens);
  for (std::size_t i = 0; i < 3; ++i) {
    SensorFrame& frame = rig.frames[i];
    AddNoise(&frame.depth, 0.001, 10 * seed + i);
    AddSmoothError(&frame.depth, 0.003, 40, 10 * seed + i);
    frame.intrinsics.distortion.clear();
  }
  return rig.frames;
}

/// Checks that the views are through the lenses that are found.
LensSet Find(std::vector<SensorFrame> frames, const std::string& kind, bool per_sensor = false) {
  for (SensorFrame& frame : frames) frame.sensor = kind;
  const CaptureSet capture({{"", std::move(frames)}}, {});
  FoundLenses found = FindLenses(capture, AssumeLenses(capture, per_sensor), 2);
  for (const FrameId id : found.views.Ids()) {
    const SensorView view = MakeSensorView(capture[id], found.lenses.Effective(id));
    EXPECT_EQ(found.views[id].rays.rays, view.rays.rays);
  }
  return std::move(found.lenses);
}

/// Radius, on the plane z = 1, that a lens shows where the true one shows `radius`.
double RadiusShown(const Intrinsics& found, const Intrinsics& truth, double radius) {
  const double bent = BendRay(truth, {radius, 0}).bent.x();
  return RayThroughLens(found, found.cx + truth.fx * bent, found.cy).norm();
}

TEST(FindLenses, WallsTellTheLensOfAnUnknownKind) {
  const Intrinsics truth = KinectWithLens();
  const LensSet lenses = Find(FramesThrough(truth), "some_kind");
  ASSERT_EQ(lenses.lenses.size(), 1u);
  for (const double radius : {0.2, 0.4, 0.6}) {
    // The pinhole is off by 1, 5 and 10 %. Planes leave the scale of all rays open.
    const double scale = RadiusShown(lenses.Effective({}), truth, 0.3) / 0.3;
    EXPECT_NEAR(RadiusShown(lenses.Effective({}), truth, radius) / scale, radius, 0.012 * radius);
  }
  EXPECT_EQ(lenses.lenses[0].change[0], 0) << "planes tell nothing about the focal length";
}

TEST(FindLenses, APinholeStaysOne) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const LensSet lenses = Find(FramesThrough(Kinect(), seed), "", true);
    ASSERT_EQ(lenses.lenses.size(), 3u);
    for (const SensorLens& lens : lenses.lenses) EXPECT_TRUE(lens.change.isZero()) << lens.change;
  }
}

TEST(FindLenses, AKnownKindIsAtItsCurve) {
  const Intrinsics truth = KinectWithLens();
  const LensSet lenses = Find(FramesThrough(truth), "azure_kinect_nfov_binned");
  for (const double radius : {0.2, 0.4, 0.6})
    EXPECT_NEAR(RadiusShown(lenses.Effective({}), truth, radius), radius, 0.004 * radius);
}

TEST(FindLenses, KnownLensesStay) {
  const std::vector<SensorFrame> frames = FramesThrough(KinectWithLens());
  const CaptureSet capture({{"", frames}}, {});
  const LensSet lenses = FindLenses(capture, GivenLenses(capture), 1).lenses;
  for (std::size_t i = 0; i < frames.size(); ++i)
    EXPECT_TRUE(lenses.Effective({0, i}) == frames[i].intrinsics);
  // The planes say what they say all the same.
  EXPECT_GT(lenses.lenses[0].evidence.information(1, 1), 0);
}

/// The walls at |x| = |z| = kWall and the floor, of which a point in the structure's frame is on
/// one, or -1.
constexpr double kWall = 3.2;
int SurfaceOf(const Eigen::Vector3d& p, double floor, double tolerance) {
  int found = -1;
  int count = 0;
  const double distances[] = {kWall - p.x(), kWall + p.x(), kWall - p.z(), kWall + p.z(),
                              p.y() - floor};
  for (int i = 0; i < 5; ++i) {
    if (std::abs(distances[i]) < tolerance) {
      found = i;
      ++count;
    }
  }
  return count == 1 ? found : -1;
}

TEST(FindLargePlanes, EachIsOneSurfaceOfTheRoom) {
  const Pose pose = RingPose(30);
  const auto seen = Render(PaperStructure(), Kinect(), pose, {true, kWall});
  const std::vector<LargePlane> planes = FindLargePlanes(MakeSensorView(seen.depth, Kinect()));
  ASSERT_GE(planes.size(), 2u);
  for (const LargePlane& plane : planes) {
    const double floor = PaperStructure().FloorHeight();
    std::map<int, int> patches;
    for (const PlanePatch& patch : plane.patches) {
      EXPECT_LT(patch.variance, 1e-5);
      // Patches that reach round a corner are a little off.
      ++patches[SurfaceOf(pose * patch.p, floor, 0.002)];
    }
    const int off = patches[-1];
    patches.erase(-1);
    EXPECT_EQ(patches.size(), 1u) << "surfaces";
    EXPECT_LE(off, 0.05 * static_cast<double>(plane.patches.size()));
  }
}

TEST(FindLargePlanes, ABentWallIsOneSurfaceStill) {
  const Pose pose = RingPose(30);
  const auto seen = Render(PaperStructure(), KinectWithLens(), pose, {true, kWall});
  Intrinsics pinhole = KinectWithLens();
  pinhole.distortion.clear();
  const auto patches = [&](const Intrinsics& intrinsics) {
    std::size_t count = 0;
    for (const LargePlane& plane : FindLargePlanes(MakeSensorView(seen.depth, intrinsics)))
      count = std::max(count, plane.patches.size());
    return count;
  };
  EXPECT_GE(patches(pinhole), 0.8 * static_cast<double>(patches(KinectWithLens())));
}

TEST(FindLargePlanes, SmallOnesAreLeftOut) {
  const auto seen = Render(PaperStructure(), Kinect(), RingPose(30), {false, 0});
  EXPECT_TRUE(FindLargePlanes(MakeSensorView(seen.depth, Kinect())).empty())
      << "the stack's sides are no walls";
}

// A wall that fills a picture, as much of it through a lens as without one.
TEST(FindLargePlanes, AreMeasuredOnThePlaneAtOneMetre) {
  for (const Intrinsics& intrinsics : {Kinect(), KinectWithLens()}) {
    const SensorView view =
        MakeSensorView(DepthImage(intrinsics.width, intrinsics.height, 2.0f), intrinsics);
    double all = 0;
    for (std::size_t i = 0; i < view.ray_areas.size(); ++i) all += view.ray_areas[i];
    const std::vector<LargePlane> planes = FindLargePlanes(view, 0.7 * all);
    ASSERT_EQ(planes.size(), 1u);
    EXPECT_NEAR(planes[0].picture_area / all, 1, 0.03);
    EXPECT_TRUE(FindLargePlanes(view, 1.1 * all).empty());
  }
}

/// Wide, of all three parameters.
const Eigen::Vector3d kWide(0.01, 0.2, 0.2);

Intrinsics Lens(double k1, double k2) {
  Intrinsics lens = Kinect();
  lens.distortion = {k1, k2, 0, 0};
  return lens;
}

struct Wall {
  Eigen::Vector3d normal;
  double distance;  // m
};

/// Patches of a wall every 20 pixels. The frame is drawn through `truth` and understood as if it
/// were through `assumed`. `bump`: m, a fold along the middle column, which no lens makes flat.
LargePlane See(const Wall& wall, const Intrinsics& truth, const Intrinsics& assumed,
               double sigma = 0, std::uint64_t seed = 1, double bump = 0) {
  RandomStream random(seed, 0, "straightness");
  LargePlane plane;
  for (int v = 10; v < truth.height; v += 20) {
    for (int u = 10; u < truth.width; u += 20) {
      const Eigen::Vector3d ray = RayThroughLens(truth, u, v).homogeneous();
      const double z = wall.distance / wall.normal.dot(ray) + sigma * random.Normal() +
                       bump * ((u / 20) % 2 == 0 ? 1 : -1);
      plane.patches.push_back(
          {z * Eigen::Vector3d(RayThroughLens(assumed, u, v).homogeneous()), sigma * sigma});
    }
  }
  return plane;
}

const std::vector<Wall> kWalls = {{Eigen::Vector3d(0.1, 0.2, 1).normalized(), 2.5},
                                  {Eigen::Vector3d(-0.5, 0.1, 1).normalized(), 2},
                                  {Eigen::Vector3d(0.2, -0.6, 1).normalized(), 1.8}};

SensorPlanes PlanesThrough(const Intrinsics& truth, const Intrinsics& assumed, double sigma = 0) {
  SensorPlanes sensor{assumed, {}};
  for (std::size_t k = 0; k < kWalls.size(); ++k)
    sensor.planes.push_back(See(kWalls[k], truth, assumed, sigma, k));
  return sensor;
}

TEST(Straighten, FindsTheLensThatMakesWallsFlat) {
  for (const auto& [k1, k2] :
       {std::pair(0.08, -0.05), std::pair(-0.06, 0.03), std::pair(0.0, 0.0)}) {
    const Intrinsics truth = Lens(k1, k2), assumed = Lens(0.01, 0.01);
    const Straightness straightness({PlanesThrough(truth, assumed)});
    const LensEstimate estimate = straightness.Straighten({assumed}, kWide, LensChange::Zero());
    EXPECT_NEAR(estimate.change[1], k1 - 0.01, 2e-3);
    EXPECT_NEAR(estimate.change[2], k2 - 0.01, 4e-3);
    EXPECT_EQ(estimate.change[0], 0) << "they tell nothing about the focal length";
    EXPECT_NEAR(std::sqrt(estimate.covariance(0, 0)), kWide[0], 1e-9) << "but the prior";
  }
}

TEST(Straighten, APlaneOfThreePatchesTellsNothing) {
  const Intrinsics lens = Lens(0, 0);
  SensorPlanes sensor{lens, {See(kWalls[0], lens, lens)}};
  for (const std::size_t patches : {3, 2, 1, 0}) {
    sensor.planes[0].patches.resize(patches);
    const LensEstimate estimate =
        Straightness({sensor}).Straighten({lens}, kWide, LensChange::Zero());
    EXPECT_EQ(estimate.change.norm(), 0);
    EXPECT_EQ(LargestBend(sensor, LensChange(0, 0.1, 0)), 0);
    EXPECT_NEAR(std::sqrt(estimate.covariance(1, 1)), kWide[1], 1e-9);
  }
}

TEST(Straighten, ANarrowPriorHolds) {
  const Intrinsics assumed = Lens(0, 0);
  const Straightness straightness({PlanesThrough(Lens(0.08, -0.05), assumed)});
  const Eigen::Vector3d narrow(1e-6, 1e-6, 1e-6);
  const LensEstimate held = straightness.Straighten({assumed}, narrow, LensChange::Zero());
  EXPECT_LT(held.change.norm(), 1e-5);
  // What a wide prior allows is the more probable.
  EXPECT_GT(straightness.Straighten({assumed}, kWide, LensChange::Zero()).log_evidence,
            held.log_evidence + 3);
}

// The estimate's errors over draws of noise are as its covariance says. Their squared length in
// standard deviations is a chi-square number with two degrees of freedom, whose mean is 2.
TEST(Straighten, ItsCovarianceIsNoSmallerThanItsErrors) {
  constexpr int kDraws = 40;
  const Intrinsics truth = Lens(0.03, 0.02);
  double squares = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    SensorPlanes sensor{truth, {}};
    for (std::size_t k = 0; k < kWalls.size(); ++k)
      sensor.planes.push_back(
          See(kWalls[k], truth, truth, 0.002, static_cast<std::uint64_t>(draw) * 10 + k));
    const LensEstimate estimate =
        Straightness({sensor}).Straighten({truth}, kWide, LensChange::Zero());
    const Eigen::Vector2d error = estimate.change.tail<2>();
    squares += error.dot(estimate.covariance.bottomRightCorner<2, 2>().inverse() * error);
  }
  // The smooth error, which is not there, is thought possible: stated errors may be larger.
  EXPECT_LT(squares / kDraws, 2 * (1 + 3 * std::sqrt(2.0 / 2 / kDraws)));
  EXPECT_GT(squares / kDraws, 0.1);
}

TEST(EvidenceAt, IsOfOneQuadraticFunction) {
  const Intrinsics assumed = Lens(0, 0);
  const LensChange truth(0, 0.04, -0.03);
  const Straightness straightness({PlanesThrough(WithLensChange(assumed, truth), assumed)});
  // At the true lens all walls are flat: nothing pulls away from there.
  const LensEvidence there = straightness.EvidenceAt({assumed}, truth);
  const Eigen::Vector3d pull = there.moment - there.information * truth;
  EXPECT_LT(pull.norm(), 1e-3 * there.moment.norm());
  // A little beside it, the pull is back to it.
  for (const LensChange& by : {LensChange(0, 1e-3, 0), LensChange(0, 0, 1e-3)}) {
    const LensChange at = truth + by;
    const LensEvidence beside = straightness.EvidenceAt({assumed}, at);
    const Eigen::Vector3d back = beside.moment - beside.information * at;
    EXPECT_LT((back + beside.information * by).norm(), 0.03 * back.norm());
  }
}

TEST(EvidenceAt, IsTheSumOverSensors) {
  const Intrinsics a = Lens(0.02, 0), b = Lens(-0.01, 0.02);
  const SensorPlanes of_a = PlanesThrough(Lens(0.05, 0), a, 0.001);
  const SensorPlanes of_b = PlanesThrough(Lens(0.02, 0.01), b, 0.002);
  const LensChange change(0, 0.01, 0.005);
  LensEvidence sum = Straightness({of_a}).EvidenceAt({a}, change);
  sum += Straightness({of_b}).EvidenceAt({b}, change);
  const LensEvidence both = Straightness({of_a, of_b}).EvidenceAt({a, b}, change);
  EXPECT_TRUE(both.information.isApprox(sum.information, 1e-9));
  EXPECT_TRUE(both.moment.isApprox(sum.moment, 1e-9));
  EXPECT_TRUE(Straightness({}).EvidenceAt({}, change).information.isZero());
}

// A curtain: its folds of 15 cm are five times what a smooth error may be, and would pull the lens
// anywhere.
TEST(Straightness, LeavesOutWhatNoLensMakesFlat) {
  const Intrinsics truth = Lens(0.03, 0.01);
  const SensorPlanes walls = PlanesThrough(truth, truth, 0.001);
  SensorPlanes with_curtain = walls;
  with_curtain.planes.push_back(See(kWalls[0], truth, truth, 0.001, 9, 0.15));
  const LensEvidence a = Straightness({walls}).EvidenceAt({truth}, LensChange::Zero());
  const LensEvidence b = Straightness({with_curtain}).EvidenceAt({truth}, LensChange::Zero());
  EXPECT_TRUE(a.information.isApprox(b.information, 1e-9));
  SensorPlanes curtain{truth, {with_curtain.planes.back()}};
  EXPECT_TRUE(Straightness({curtain}).EvidenceAt({truth}, LensChange::Zero()).information.isZero());
}

/// The farthest of points from the plane that fits them best.
double FarthestFromPlane(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) scatter += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  double farthest = 0;
  for (const Eigen::Vector3d& p : points)
    farthest = std::max(farthest, std::abs(solver.eigenvectors().col(0).dot(p - mean)));
  return farthest;
}

// By seeing each wall, exact and with 80 patches at most, through the changed lens.
TEST(LargestBend, IsThatOfTheWallsSeenOtherwise) {
  const Intrinsics lens = Lens(0.02, 0.01);
  const SensorPlanes sensor = PlanesThrough(lens, lens);
  const LensChange change(0, 0.02, -0.015);
  const Intrinsics changed = WithLensChange(lens, change);
  double expected = 0;
  for (const LargePlane& plane : sensor.planes) {
    std::vector<Eigen::Vector3d> points;
    const std::size_t n = plane.patches.size(), count = std::min<std::size_t>(n, 80);
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d& p = plane.patches[i * n / count].p;
      const Eigen::Vector2d pixel = ProjectRay(lens, p.head<2>() / p.z());
      points.emplace_back(p.z() * RayThroughLens(changed, pixel.x(), pixel.y()).homogeneous());
    }
    expected = std::max(expected, FarthestFromPlane(points));
  }
  ASSERT_GT(expected, 5e-4);
  EXPECT_NEAR(LargestBend(sensor, change), expected, 0.05 * expected);
  EXPECT_EQ(LargestBend(sensor, LensChange::Zero()), 0);
  EXPECT_EQ(LargestBend(sensor, LensChange(0.01, 0, 0)), 0) << "a longer lens keeps planes plane";
}

}  // namespace
}  // namespace volalign::sensor_lens_test
