#include "infer/initial/side_patch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/random.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::side_patch_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

const SidePatch* Largest(const std::vector<SidePatch>& evidence, int label) {
  for (const SidePatch& patch : evidence) {
    if (patch.label == label) return &patch;
  }
  return nullptr;
}

/// A single box seen at 45 deg: both faces are whole, so that centre, normal and area are known in
/// closed form.
class OneBox : public ::testing::Test {
 protected:
  OneBox()
      : structure(
            Structure::FromBoxes("one", {Box::FromMinMax("box", Eigen::Vector3d(-0.25, -0.3, -0.2),
                                                         Eigen::Vector3d(0.25, 0.3, 0.2))})),
        pose(RingPose(45, 2.0, 0.1, 90, Eigen::Vector3d::Zero())),
        rendered(Render(structure, Kinect(), pose)),
        view(MakeSensorView(rendered.depth, Kinect())) {}

  void ExpectExact(const std::vector<SidePatch>& evidence, double tolerance) {
    for (const std::string name : {"box/front", "box/right"}) {
      const int label = LabelOf(structure, name);
      const SidePatch* patch = Largest(evidence, label);
      ASSERT_NE(patch, nullptr) << name;
      const Side& side = structure.SideOfLabel(label);
      EXPECT_LT((pose * patch->centroid - side.centre).norm(), tolerance) << name;
      EXPECT_LT((pose.linear() * patch->normal - side.normal).norm(), tolerance) << name;
      const double area = 4 * side.half_u * side.half_v;
      EXPECT_NEAR(patch->area, area, 0.03 * area) << name;
    }
  }

  Structure structure;
  Pose pose;
  testing_infer::SyntheticView rendered;
  SensorView view;
};

TEST_F(OneBox, GivesCentreNormalAndAreaOfWholeFaces) {
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.003);
}

// Beside the axis a pixel covers more than on it.
TEST_F(OneBox, ThroughALensToo) {
  const Intrinsics lens = testing_infer::KinectWithLens();
  pose = RingPose(45, 2.4, 0.1, 90, Eigen::Vector3d(-0.75, 0, 0.75));
  rendered = Render(structure, lens, pose);
  view = MakeSensorView(rendered.depth, lens);
  const Eigen::Vector3d centre = pose.inverse() * Eigen::Vector3d::Zero();
  EXPECT_GT(centre.head<2>().norm() / centre.z(), 0.4);
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.005);
}

TEST_F(OneBox, AHandfulOfFarPixelsHasNoSay) {
  // Isolated and clustered background pixels with a side's label, metres behind it.
  LabelImage labels = rendered.labels;
  const auto front = static_cast<std::uint8_t>(LabelOf(structure, "box/front"));
  RandomStream random(3, 0, "far");
  int spoilt = 0;
  for (int i = 0; i < 400; ++i) {
    const int u = random.Below(320), v = random.Below(288);
    if (labels(u, v) == 0 && view.depth(u, v) > 3) {
      labels(u, v) = front;
      ++spoilt;
    }
  }
  for (int v = 5; v < 15; ++v) {
    for (int u = 290; u < 310; ++u) {
      labels(u, v) = front;
      if (view.depth(u, v) > 0) ++spoilt;
    }
  }
  ASSERT_GT(spoilt, 100);
  ExpectExact(CollectPatches(view, Certain(labels), structure), 0.005);
}

TEST_F(OneBox, UnsurePixelsAreNotEvidence) {
  SegmentationResult segmentation = Certain(rendered.labels);
  for (float& c : segmentation.confidence) c = 0.49f;
  EXPECT_TRUE(CollectPatches(view, segmentation, structure).empty());
}

TEST(SidePatch, ALabelOnTwoSurfacesGivesBoth) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(20);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  LabelImage labels = rendered.labels;
  const int from = LabelOf(structure, "top/front"), to = LabelOf(structure, "bottom/front");
  for (std::uint8_t& label : labels) {
    if (label == from) label = static_cast<std::uint8_t>(to);
  }
  int patches = 0;
  bool near_top = false, near_bottom = false;
  for (const SidePatch& patch : CollectPatches(view, Certain(labels), structure)) {
    if (patch.label != to) continue;
    ++patches;
    const double height = (pose * patch.centroid).y();
    near_top = near_top || std::abs(height - structure.SideOfLabel(from).centre.y()) < 0.1;
    near_bottom = near_bottom || std::abs(height - structure.SideOfLabel(to).centre.y()) < 0.1;
  }
  EXPECT_EQ(patches, 2);
  EXPECT_TRUE(near_top);
  EXPECT_TRUE(near_bottom);
}

}  // namespace
}  // namespace volalign::side_patch_test
