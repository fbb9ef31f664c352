// Silhouettes with nothing behind them: they lie on the edges of sides, and what only looks like
// one is none.

#include "infer/refine/silhouettes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infer/refine/association.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::silhouettes_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// The structure before nothing.
struct Frame {
  Structure structure = PaperStructure();
  Pose pose;
  testing_infer::SyntheticView rendered;

  explicit Frame(const Pose& from)
      : pose(from), rendered(testing_infer::Render(structure, Kinect(), from, {false, 0})) {}

  /// Takes depth and labels away where `gone(u, v)`.
  template <class Gone>
  void Erase(const Gone& gone) {
    for (int v = 0; v < rendered.depth.height(); ++v) {
      for (int u = 0; u < rendered.depth.width(); ++u) {
        if (!gone(u, v)) continue;
        rendered.depth(u, v) = 0;
        rendered.labels(u, v) = 0;
      }
    }
  }
  Silhouettes Find() const {
    const SensorView view = MakeSensorView(rendered.depth, Kinect());
    const SegmentationResult labels = Certain(rendered.labels);
    return FindSilhouettes({view, labels, static_cast<std::size_t>(structure.num_classes()), 0.5});
  }
  /// Distance, m, of the point from the nearest edge of its side, positive outside of it.
  double Outside(const EdgePoint& edge) const {
    const Side& side = structure.SideOfLabel(edge.label);
    const Eigen::Vector3d p = pose * edge.p - side.centre;
    const double du = std::abs(side.axis_u.dot(p)) - side.half_u;
    const double dv = std::abs(side.axis_v.dot(p)) - side.half_v;
    return std::abs(du) < std::abs(dv) ? du : dv;
  }
  static Eigen::Vector2d Pixel(const EdgePoint& edge) {
    return {Kinect().fx * edge.p.x() / edge.p.z() + Kinect().cx,
            Kinect().fy * edge.p.y() / edge.p.z() + Kinect().cy};
  }
};

// A plane that faces the sensor at 2 m ends behind column 180; after a gap, a wall at 3 m follows.
TEST(TwoSided, LieAQuarterOfTheGapBeyondHalfAPixel) {
  for (int gap = 0; gap <= 3; ++gap) {
    DepthImage depth(320, 288, 3.0f);
    LabelImage labels(320, 288, 0);
    for (int v = 100; v < 180; ++v) {
      for (int u = 120; u <= 180 + gap; ++u) {
        depth(u, v) = u <= 180 ? 2.0f : 0.0f;
        labels(u, v) = u <= 180 ? 1 : 0;
      }
    }
    const SensorView view = MakeSensorView(depth, Kinect());
    const SegmentationResult certain = Certain(labels);
    std::size_t count = 0;
    for (const EdgePoint& edge : FindSilhouettes({view, certain, 2, 0.5}).two_sided) {
      if (edge.axis != 0 || edge.outward.x() < 0) continue;
      ++count;
      EXPECT_NEAR(Frame::Pixel(edge).x(), 180.5 + 0.25 * gap, 1e-3) << gap;
      EXPECT_NEAR(edge.p.z(), 2, 1e-5);
      EXPECT_NEAR(edge.pixel, 2 / Kinect().fx, 1e-6);
      // Anywhere in the pixels of the gap and one more.
      EXPECT_NEAR(edge.sigma, (gap + 1) * edge.pixel / std::sqrt(12.0), 1e-6);
    }
    EXPECT_GT(count, 60u) << gap;
  }
}

// Gaps of 1 to 4 pixels, all of them at the side's cost.
TEST(OneSided, LieOnTheEdgesOfTheirSides) {
  for (const double phi : {20.0, 90.0, 215.0}) {
    Frame frame(RingPose(phi));
    testing_infer::LeaveGaps(&frame.rendered.depth, &frame.rendered.labels, 1, 4, 7);
    const Silhouettes found = frame.Find();
    ASSERT_GT(found.one_sided.size(), 60u) << phi;
    double sum = 0;
    std::size_t near = 0;
    for (const EdgePoint& edge : found.one_sided) {
      EXPECT_TRUE(edge.one_sided);
      const double outside = frame.Outside(edge);
      sum += outside / edge.pixel;
      near += std::abs(outside) < 4 * edge.pixel ? 1 : 0;
    }
    const auto count = static_cast<double>(found.one_sided.size());
    EXPECT_GT(static_cast<double>(near) / count, 0.95) << phi;
    // 2.5 px are missing in the mean, of which 1.25 are expected.
    EXPECT_LT(std::abs(sum / count), 2) << phi;
  }
}

TEST(OneSided, TheirDirectionIsMeasured) {
  const Frame frame(RingPose(70, 2.0, 0.4, 70));  // 20 deg askew in the picture
  std::size_t square = 0;
  const Silhouettes found = frame.Find();
  for (const EdgePoint& edge : found.one_sided) {
    const Side& side = frame.structure.SideOfLabel(edge.label);
    const Eigen::Vector3d outward = frame.pose.linear() * edge.outward;
    square += std::max(std::abs(outward.dot(side.axis_u)), std::abs(outward.dot(side.axis_v))) >
                      std::cos(10 * M_PI / 180)
                  ? 1
                  : 0;
  }
  ASSERT_GT(found.one_sided.size(), 40u);
  EXPECT_GT(static_cast<double>(square), 0.9 * static_cast<double>(found.one_sided.size()));
}

TEST(OneSided, AHoleInASideIsNone) {
  Frame frame(RingPose(90));
  // 14 px wide, where 24 px round about show one side.
  const LabelImage& labels = frame.rendered.labels;
  int at_u = 0, at_v = 0;
  for (int v = 12; v < 276; ++v) {
    for (int u = 12; u < 308; ++u) {
      bool whole = labels(u, v) > 0;
      for (int k = -12; k <= 12 && whole; ++k) {
        for (int l = -12; l <= 12; ++l) whole = whole && labels(u + k, v + l) == labels(u, v);
      }
      if (whole) at_u = u, at_v = v;
    }
  }
  ASSERT_GT(at_u, 0);
  frame.Erase([&](int u, int v) { return std::abs(u - at_u) < 7 && std::abs(v - at_v) < 7; });
  for (const EdgePoint& edge : frame.Find().one_sided) {
    const Eigen::Vector2d from = Frame::Pixel(edge) - Eigen::Vector2d(at_u, at_v);
    EXPECT_GT(from.cwiseAbs().maxCoeff(), 10) << from.transpose();
  }
}

// The picture ends, or a sensor leaves a band along its border empty.
TEST(OneSided, TheBorderOfThePictureIsNone) {
  for (const int band : {0, 7}) {
    Frame frame(RingPose(90, 1.0, 0.2));  // so near that the picture cuts the stack off
    frame.Erase([&](int u, int) { return u < band || u >= 320 - band; });
    int labelled = 0;
    for (int v = 0; v < 288; ++v) labelled += frame.rendered.labels(band, v) > 0 ? 1 : 0;
    ASSERT_GT(labelled, 20);
    for (const EdgePoint& edge : frame.Find().one_sided) {
      if (edge.axis != 0) continue;
      const double u = Frame::Pixel(edge).x();
      EXPECT_TRUE(u > band + 3 && u < 316 - band) << u;
    }
  }
}

// Something nearer hides a part of the stack, with a gap of 8 px round it.
TEST(OneSided, WhatIsHiddenHasNone) {
  Frame frame(RingPose(90));
  frame.Erase([](int u, int) { return std::abs(u - 160) < 18; });
  for (int v = 0; v < 288; ++v) {
    for (int u = 151; u < 170; ++u) frame.rendered.depth(u, v) = 1;
  }
  for (const EdgePoint& edge : frame.Find().one_sided) {
    if (std::abs(Frame::Pixel(edge).x() - 160) < 24) {
      EXPECT_LT(std::abs(frame.Outside(edge)), 5 * edge.pixel) << Frame::Pixel(edge).transpose();
    }
  }
}

// An Azure Kinect lights a hexagon, whose sides run at 30 deg to the picture's: nothing is seen
// beyond them, and what ends there is no edge of the structure.
TEST(OneSided, TheBorderOfTheLitFieldIsNoEdge) {
  using refine_internal::EdgeLine;
  Frame frame(RingPose(90));
  const auto lit = [](int u, int v) { return std::abs(u - 164) <= 130 - 0.58 * std::abs(v - 148); };
  frame.Erase([&](int u, int v) { return !lit(u, v); });
  refine_internal::FrameState sensor;
  sensor.structure_from_sensor = frame.pose;
  int on_border = 0, taken = 0;
  for (const EdgePoint& edge : frame.Find().one_sided) {
    const Eigen::Vector2d at = Frame::Pixel(edge);
    const double margin = 130 - 0.58 * std::abs(at.y() - 148) - std::abs(at.x() - 164);
    if (std::abs(margin) > 4 || std::abs(frame.Outside(edge)) < 4 * edge.pixel) continue;
    ++on_border;
    EdgeLine line;
    taken += LiesOnAnEdge(frame.structure, sensor, edge, 0.15, &line) ? 1 : 0;
  }
  ASSERT_GT(on_border, 10);
  EXPECT_LE(taken, on_border / 10);
}

}  // namespace
}  // namespace volalign::silhouettes_test
