#include "infer/initial/initial_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/visibility.h"
#include "infer/initial/pose_candidates.h"
#include "infer/initial/view_fit.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::initial_pose_test {
namespace {

using namespace testing_infer;

struct Outcome {
  bool found = false;
  PoseError error;
};

Outcome Estimate(const Structure& structure, const Pose& truth, const DepthImage& depth,
                 const LabelImage& labels) {
  const SensorView view = MakeSensorView(depth, Kinect());
  const InitialPose pose = EstimateInitialPose(view, Certain(labels), structure);
  return {pose.found, ComparePoses(pose.structure_from_sensor, truth)};
}

TEST(InitialPose, WithstandsWrongLabels) {
  const Structure structure = PaperStructure();
  for (int phi = 0; phi < 360; phi += 40) {
    const Pose truth = RingPose(phi);
    auto rendered = Render(structure, Kinect(), truth, {true, 3.5});
    AddNoise(&rendered.depth, 0.005, static_cast<std::uint64_t>(phi));
    // A tenth of all pixels gets any label, and one true side gets a wrong one.
    RandomStream random(5, static_cast<std::uint64_t>(phi), "labels");
    const int victim = LabelOf(structure, phi < 180 ? "mid_top/right" : "mid_bottom/left");
    const int wrong = LabelOf(structure, "bottom/up");
    for (std::uint8_t& label : rendered.labels) {
      if (label == victim) label = static_cast<std::uint8_t>(wrong);
      if (random.Chance(0.1))
        label = static_cast<std::uint8_t>(random.Below(structure.num_classes()));
    }
    const Outcome outcome = Estimate(structure, truth, rendered.depth, rendered.labels);
    ASSERT_TRUE(outcome.found) << phi;
    EXPECT_TRUE(Within(outcome.error, 0.02, 0.5)) << phi;
  }
}

ViewFit Measure(const SensorView& view, const Structure& structure, const Pose& pose) {
  const ViewFit shape = MeasureShape(LookAround(view, structure).surface, structure, pose);
  EXPECT_LE(shape.found_planes, shape.open_planes);
  return shape;
}

// The paper's stack has 12 planes with labels. From most sides 14 are seen: it overhangs, and an
// edge tells of a bottom too.
TEST(ViewFit, AtTheTruePoseThePlanesAreFoundAndTheOddsAreForIt) {
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i + 10, 2.0 + 0.2 * i, 0.3 + 0.05 * (i % 3));
    const SensorView view = See(PaperStructure(), truth);
    const ViewFit shape = Measure(view, PaperStructure(), truth);
    EXPECT_GE(shape.found_planes, 12);
    EXPECT_EQ(shape.found_planes, shape.open_planes);
    EXPECT_GT(shape.LogOdds(), std::log(100));
    const Pose aside = Eigen::Translation3d(0.15, 0, 0.1) * truth;
    EXPECT_LT(Measure(view, PaperStructure(), aside).LogOdds(), -std::log(100));
  }
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    const Structure structure = RandomStack(seed);
    const Pose truth = RingPose(20, 2.2, 1.2, 90, {0, structure.Height() / 2, 0});
    const SensorView view = See(structure, truth);
    const ViewFit shape = Measure(view, structure, truth);
    EXPECT_GE(shape.found_planes, 0.9 * shape.open_planes);
    EXPECT_GT(shape.LogOdds(), 0);
    EXPECT_LT(Measure(view, RandomStack(seed + 1), truth).LogOdds(), -3) << "another stack";
  }
}

/// A box 40 cm wide, 30 cm high and 20 cm deep, its front square to the axis of a sensor 2 m before
/// it that stands at its middle's height.
constexpr double kWidth = 0.4, kHeight = 0.3;
Structure Crate() {
  return Structure::FromBoxes("crate", {Box::FromMinMax("c", {0, 1, -0.2}, {0.2, 1.3, 0.2})});
}
Pose Before() {
  Pose pose = Pose::Identity();
  pose.linear() << 0, 0, -1, 0, -1, 0, -1, 0, 0;  // looks along -x; image x is -z, y is -y
  pose.translation() = Eigen::Vector3d(2.2, 1.15, 0);
  return pose;
}

/// 5 mm a pixel at 2 m.
Intrinsics Camera() { return {200, 160, 400, 400, 99.5, 79.5, {}}; }

/// Where a ray of this direction meets the plane of the front.
struct Hit {
  double across, up;  // from the front's middle, m
};
Hit HitOf(int u, int v) { return {2 * (u - 99.5) / 400, -2 * (v - 79.5) / 400}; }
bool OnFront(int u, int v) {
  const Hit hit = HitOf(u, v);
  return std::abs(hit.across) < kWidth / 2 && std::abs(hit.up) < kHeight / 2;
}

/// The front alone is seen; `wall`: what is behind, 0 for nothing. Normals as they truly are.
SensorSurface Front(float wall = 0) {
  SensorSurface surface;
  surface.view = MakeSensorView(DepthImage(200, 160, wall), Camera());
  surface.normals = Image<Eigen::Vector3f>(200, 160, Eigen::Vector3f(0, 0, -1));
  surface.room = Image<std::uint8_t>(200, 160, 0);
  for (const auto [u, v] : Pixels(200, 160)) {
    if (OnFront(u, v)) surface.view.depth(u, v) = 2;
  }
  return surface;
}

/// Sets the depth of the part of the front where `part` says so.
template <class Part>
void SetDepth(SensorSurface* surface, float depth, const Part& part) {
  for (const auto [u, v] : Pixels(200, 160)) {
    if (OnFront(u, v) && part(HitOf(u, v))) surface->view.depth(u, v) = depth;
  }
}

constexpr double kFront = kWidth * kHeight;

ViewFit Measure(const SensorSurface& surface) { return MeasureShape(surface, Crate(), Before()); }

TEST(MeasureShape, AreasAreThoseOfTheSurface) {
  for (const float wall : {0.0f, 4.0f}) {
    const ViewFit fit = Measure(Front(wall));
    EXPECT_NEAR(fit.explained, kFront, 0.02 * kFront);
    for (const double none : {fit.turned, fit.larger, fit.behind, fit.goes_on}) EXPECT_EQ(none, 0);
    EXPECT_EQ(fit.contradicted(), 0);
    // A band from 2 to 7 cm beyond the border, its corners included, but for what is nearer to the
    // foot than 3 cm.
    const double band =
        (kWidth + 0.14) * (kHeight + 0.07 - 0.03) - (kWidth + 0.04) * (kHeight + 0.02 - 0.03);
    EXPECT_NEAR(fit.ends, band, 0.03 * band) << wall;
    // The front, and the three faces at whose edges it ends.
    EXPECT_EQ(fit.found_planes, 4);
  }
}

TEST(MeasureShape, LikeAnyOtherSensor) {
  // The same through half as many pixels, and moved together with the structure.
  const Pose elsewhere = RingPose(50);
  Structure moved = Structure::FromBoxes(
      "crate",
      {Box{"c", Crate().boxes()[0].size, elsewhere * Crate().boxes()[0].structure_from_box}});
  const ViewFit a = Measure(Front());
  EXPECT_NEAR(Measure(Decimate(Front(), 2)).explained, a.explained, 0.02 * a.explained);
  EXPECT_NEAR(MeasureShape(Front(), moved, elsewhere * Before()).explained, a.explained, 1e-6);
}

// Three faces of the crate, from its corner and above it, wherever in the picture they are and
// through whatever lens: all of their area.
TEST(MeasureShape, AreasAreThoseOfObliqueFacesThroughAnyLens) {
  const Structure crate = Crate();
  const double faces = 0.4 * 0.3 + 0.2 * 0.3 + 0.2 * 0.4;
  for (const Intrinsics& lens : {Kinect(), KinectWithLens()}) {
    for (const double aside_deg : {0.0, 18.0}) {
      SCOPED_TRACE(testing::Message() << lens.distortion.size() << " " << aside_deg);
      Pose pose = RingPose(45, 2.4, 2.85, 90, {0.1, 1.15, 0});
      pose.linear() *=
          Eigen::AngleAxisd(aside_deg * M_PI / 180, Eigen::Vector3d(1, 1, 0).normalized())
              .toRotationMatrix();
      SensorSurface surface;
      surface.view = MakeSensorView(DepthImage(lens.width, lens.height), lens);
      surface.view.depth = CastView(crate, surface.view.rays, pose).depth;
      surface.normals = Image<Eigen::Vector3f>(lens.width, lens.height, Eigen::Vector3f::Zero());
      surface.room = Image<std::uint8_t>(lens.width, lens.height, 0);
      const ViewFit fit = MeasureShape(surface, crate, pose);
      EXPECT_NEAR(fit.explained, faces, 0.03 * faces);
      EXPECT_EQ(fit.contradicted(), 0);
    }
  }
}

TEST(MeasureShape, SomethingBeforeItHidesIt) {
  SensorSurface surface = Front();
  SetDepth(&surface, 1, [](const Hit& hit) { return hit.across < -0.1; });
  const ViewFit fit = Measure(surface);
  EXPECT_NEAR(fit.explained, kFront * 3 / 4, 0.03 * kFront);
  EXPECT_EQ(fit.contradicted(), 0);
}

TEST(MeasureShape, SomethingBehindItContradicts) {
  SensorSurface surface = Front();
  SetDepth(&surface, 3, [](const Hit& hit) { return hit.across < 0; });
  const ViewFit fit = Measure(surface);
  // Without a border of 3 cm, where a pose that is not quite right sees behind as well.
  const double inner = (kWidth / 2 - 0.03) * (kHeight - 0.06);
  EXPECT_NEAR(fit.behind, inner, 0.03 * inner);
  EXPECT_NEAR(fit.explained, kFront / 2, 0.03 * kFront);
  EXPECT_EQ(fit.contradicted(), fit.behind);
  // A hole says nothing.
  SetDepth(&surface, 0, [](const Hit& hit) { return hit.across < 0; });
  EXPECT_EQ(Measure(surface).behind, 0);
}

// At 2 m what is 4.9 cm before or behind is on the surface: 3 cm, and three times the 13 mm of a
// kind that nothing is known of.
TEST(MeasureShape, HasATolerance) {
  for (const float depth : {1.96f, 2.04f}) {
    SensorSurface surface = Front();
    SetDepth(&surface, depth, [](const Hit&) { return true; });
    EXPECT_NEAR(Measure(surface).explained, kFront, 0.02 * kFront) << depth;
  }
  SensorSurface before = Front(), behind = Front();
  SetDepth(&before, 1.94f, [](const Hit&) { return true; });
  SetDepth(&behind, 2.3f, [](const Hit&) { return true; });
  const ViewFit hidden = Measure(before);
  EXPECT_EQ(hidden.explained + hidden.contradicted(), 0);
  EXPECT_GT(Measure(behind).behind, 0.5 * kFront);
}

TEST(MeasureShape, SurfaceThatFacesElsewhereIsTurned) {
  SensorSurface surface = Front();
  const auto facing = [&](double deg) {
    const double angle = deg * M_PI / 180;
    surface.normals = Image<Eigen::Vector3f>(
        200, 160, Eigen::Vector3d(std::sin(angle), 0, -std::cos(angle)).cast<float>());
    return Measure(surface);
  };
  EXPECT_EQ(facing(40).turned, 0);
  const ViewFit turned = facing(50);
  const double inner = (kWidth - 0.06) * (kHeight - 0.06);
  EXPECT_NEAR(turned.turned, inner, 0.03 * inner);
  EXPECT_EQ(turned.contradicted(), turned.turned / 2);
  // Where no normal is known, none contradicts.
  surface.normals = Image<Eigen::Vector3f>(200, 160, Eigen::Vector3f::Zero());
  EXPECT_EQ(Measure(surface).turned, 0);
}

TEST(MeasureShape, APartOfAWallIsNoSide) {
  // The wall that the front would be a part of.
  const ViewFit part = Measure(Front(2));
  EXPECT_NEAR(part.larger, kFront, 0.02 * kFront);
  EXPECT_EQ(part.explained, 0);
  EXPECT_EQ(part.ends, 0);
  EXPECT_EQ(part.found_planes, 0);
  EXPECT_GT(part.goes_on, 1e-3);
  // The same where MarkRoom has found a plane of the room.
  SensorSurface room = Front();
  room.room = Image<std::uint8_t>(200, 160, 1);
  EXPECT_NEAR(Measure(room).larger, kFront, 0.02 * kFront);
  // It goes on at one end alone: there it has no edge, and it is a side all the same.
  SensorSurface longer = Front();
  for (const auto [u, v] : Pixels({140, 0}, {200, 160})) {
    if (std::abs(HitOf(u, v).up) < kHeight / 2) longer.view.depth(u, v) = 2;
  }
  const ViewFit three = Measure(longer);
  EXPECT_NEAR(three.explained, kFront, 0.02 * kFront);
  EXPECT_NEAR(three.goes_on, 0.05 * (kHeight - 0.03), 0.03 * 0.05 * kHeight);
  EXPECT_EQ(three.found_planes, 3);
}

/// Sets depth and normal, turned by `deg` about the vertical, beside the front, where `part` says
/// so.
template <class Part>
void SetBeside(SensorSurface* surface, float depth, double deg, const Part& part) {
  const double angle = deg * M_PI / 180;
  for (const auto [u, v] : Pixels(200, 160)) {
    if (OnFront(u, v) || !part(HitOf(u, v))) continue;
    surface->view.depth(u, v) = depth;
    surface->normals(u, v) = Eigen::Vector3d(std::sin(angle), 0, -std::cos(angle)).cast<float>();
  }
}

// All but a strip beyond the right border is hidden.
TEST(MeasureShape, AShortStripBeyondABorderSaysNothing) {
  const auto measure = [](double height) {
    SensorSurface surface = Front();
    SetBeside(&surface, 1, 0, [](const Hit&) { return true; });
    SetBeside(&surface, 2, 0,
              [&](const Hit& hit) { return hit.across > 0 && std::abs(hit.up) < height / 2; });
    return Measure(surface);
  };
  const ViewFit strip = measure(0.2 * kHeight);
  EXPECT_NEAR(strip.explained, kFront, 0.02 * kFront);
  EXPECT_GT(strip.goes_on, 0);
  EXPECT_NEAR(measure(0.4 * kHeight).larger, kFront, 0.02 * kFront);
}

// Beyond a border a surface goes on that faces as the side does, to 25 deg.
TEST(MeasureShape, WhatGoesOnFacesAsTheSideDoes) {
  const auto goes_on = [](double deg) {
    SensorSurface surface = Front();
    SetBeside(&surface, 2, deg,
              [](const Hit& hit) { return hit.across > 0 && std::abs(hit.up) < kHeight / 2; });
    return Measure(surface).goes_on;
  };
  const double end = 0.05 * (kHeight - 0.03);
  EXPECT_NEAR(goes_on(20), end, 0.05 * end);
  EXPECT_EQ(goes_on(30), 0);
}

// The band beyond the right border has 0.0148 m^2, 0.05 of it for each metre of height.
TEST(MeasureShape, AnEdgeEndsTwiceAsMuchAsItGoesOn) {
  const auto found_planes = [](double height) {
    SensorSurface surface = Front();
    SetBeside(&surface, 2, 0,
              [&](const Hit& hit) { return hit.across > 0 && std::abs(hit.up) < height / 2; });
    return Measure(surface).found_planes;
  };
  EXPECT_EQ(found_planes(0.08), 4) << "ends 2.7 times as much";
  EXPECT_EQ(found_planes(0.12), 3) << "1.5 times";
}

// A box beside the crate, its front in one plane with the crate's or 20 cm before it.
TEST(MeasureShape, WhereTheStructureItselfIsABorderTellsNothing) {
  for (const double before : {0.0, 0.2}) {
    const Structure two = Structure::FromBoxes(
        "two", {Crate().boxes()[0], Box::FromMinMax("d", {0, 1, 0.2}, {0.2 + before, 1.3, 0.3})});
    SensorSurface surface = Front();
    surface.view.depth = CastView(two, surface.view.rays, Before()).depth;
    const ViewFit fit = MeasureShape(surface, two, Before());
    EXPECT_EQ(fit.goes_on, 0) << before;
    EXPECT_EQ(fit.found_planes, fit.open_planes) << before;
    // Fronts, tops and the outer sides; of the box that stands before, the inner one as well.
    EXPECT_EQ(fit.open_planes, before > 0 ? 6 : 4);
  }
}

TEST(MeasureShape, AnEdgeThatSomethingHidesIsNotOpen) {
  SensorSurface surface = Front();
  SetBeside(&surface, 1, 0, [](const Hit& hit) { return hit.across > kWidth / 2; });
  const ViewFit fit = Measure(surface);
  EXPECT_EQ(fit.open_planes, 3);
  EXPECT_EQ(fit.found_planes, 3);
}

TEST(ViewFit, NothingSeenSaysNothing) { EXPECT_EQ(ViewFit().LogOdds(), 0); }

// By hand: a third of a stack is measured, with all edges that nothing hides.
TEST(ViewFit, WhatIsExplainedSpeaksForAPoseAndWhatContradictsAgainstIt) {
  ViewFit fit;
  fit.surface = 3;
  fit.explained = 1;
  fit.ends = 0.5;
  fit.open_planes = fit.found_planes = 13;
  const double odds = fit.LogOdds();
  EXPECT_GT(odds, std::log(100));
  const auto with = [&](auto part, auto value) {
    ViewFit other = fit;
    other.*part = value;
    return other.LogOdds();
  };
  EXPECT_LT(with(&ViewFit::behind, 0.2), 0);
  EXPECT_EQ(with(&ViewFit::larger, 0.2), with(&ViewFit::behind, 0.2));
  EXPECT_EQ(with(&ViewFit::turned, 0.4), with(&ViewFit::behind, 0.2));
  EXPECT_LT(with(&ViewFit::goes_on, 0.2), 0);
  EXPECT_LT(with(&ViewFit::explained, 0.1), odds - 4) << "as other boxes explain some of it";
  EXPECT_LT(with(&ViewFit::found_planes, 7), 0);
}

TEST(VisibleKeypoints, StayThoseOfTheSideWhereThePoseShowsNothingOfIt) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(20);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const std::vector<SidePatch> patches = CollectPatches(view, Certain(rendered.labels), structure);
  // From the other side of the structure.
  const Pose other = RingPose(200);
  const LabelImage seen = Render(structure, Kinect(), other).labels;
  const std::vector<Eigen::Vector3d> keypoints = VisibleKeypoints(view, patches, structure, other);
  int hidden = 0;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (std::find(seen.begin(), seen.end(), patches[i].label) != seen.end()) continue;
    ++hidden;
    EXPECT_EQ(keypoints[i], structure.SideOfLabel(patches[i].label).exposed_centroid);
  }
  EXPECT_GT(hidden, 0);
}

}  // namespace
}  // namespace volalign::initial_pose_test
