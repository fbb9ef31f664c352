#include "infer/initial/agreement.h"

#include <gtest/gtest.h>

#include "tests/infer/view/synthetic.h"

namespace volalign::agreement_test {
namespace {

using testing_infer::Certain;
using testing_infer::Coarse;

const SurfaceTolerance kTolerance = SurfaceTolerance::AtRoughPose(ErrorsOf(""));  // 4.3 cm at 1 m

/// A box whose face at 1 m covers the left half of Coarse's view; from x = 0 on it is out of view.
Structure LeftBox() {
  return Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 1, 2))});
}

TEST(CompareWithView, CountsPixels) {
  const Structure box = LeftBox();
  const auto seen = static_cast<std::uint8_t>(testing_infer::LabelOf(box, "b/left"));
  const auto hidden = static_cast<std::uint8_t>(testing_infer::LabelOf(box, "b/right"));
  DepthImage depth(20, 10, 3.0f);
  SegmentationResult segmentation = Certain(LabelImage(20, 10, 0));
  for (int v = 0; v < 10; ++v) {
    for (int u = 3; u < 9; ++u) depth(u, v) = 1.01f;
    depth(0, v) = 0;
    depth(1, v) = 0.5f;   // in front
    depth(2, v) = 1.5f;   // 28 cm behind the face, as far from every other
    depth(3, v) = 1.04f;  // within the tolerance
    depth(9, v) = 1.2f;   // far behind the face, but 1.5 cm from the side x = 0
    for (const int u : {0, 1, 3, 4, 6, 8, 9, 15}) segmentation.labels(u, v) = seen;
    segmentation.labels(5, v) = hidden;
    segmentation.confidence(6, v) = 0.3f;
  }
  const Agreement agreement = CompareWithView(MakeSensorView(depth, Coarse()), segmentation, box,
                                              Pose::Identity(), 0.5, kTolerance);
  EXPECT_EQ(agreement.visible, 90);     // columns 1 to 9
  EXPECT_EQ(agreement.explained, 70);   // 3 to 9
  EXPECT_EQ(agreement.same_label, 40);  // 3, 4, 8, 9
  EXPECT_EQ(agreement.either, 100);     // 1 to 9, 15
  EXPECT_DOUBLE_EQ(agreement.explained_share(), 7.0 / 9);
  EXPECT_DOUBLE_EQ(agreement.score(), 0.4);
  // Of the pixels with depth, whatever the confidence. The face: 6 columns of 10; the hidden side:
  // 0 of 1; background: 9 of 12.
  EXPECT_NEAR(agreement.miou, (0.6 + 0 + 0.75) / 3, 1e-9);
}

TEST(CompareWithView, NothingMeasuredIsNoAgreement) {
  const Agreement agreement =
      CompareWithView(MakeSensorView(DepthImage(20, 10, 0.0f), Coarse()),
                      Certain(LabelImage(20, 10, 1)), LeftBox(), Pose::Identity(), 0.5, kTolerance);
  EXPECT_EQ(agreement.visible, 0);
  EXPECT_EQ(agreement.either, 0);
  EXPECT_EQ(agreement.score(), 0);
}

TEST(LabelsFromPose, NamesTheSideThatWasMeasured) {
  const Structure box = LeftBox();
  const int seen = testing_infer::LabelOf(box, "b/left");
  DepthImage depth(20, 10, 3.0f);
  for (int v = 0; v < 10; ++v) {
    for (int u = 2; u < 10; ++u) depth(u, v) = 1.01f;
    depth(0, v) = 0;
    depth(1, v) = 1.06f;
  }
  const SegmentationResult labels =
      LabelsFromPose(MakeSensorView(depth, Coarse()), box, Pose::Identity(), kTolerance);
  for (int v = 0; v < 10; ++v) {
    for (int u = 0; u < 20; ++u) {
      const bool on_side = u >= 2 && u < 10;
      EXPECT_EQ(labels.labels(u, v), on_side ? seen : 0) << u << " " << v;
      EXPECT_EQ(labels.confidence(u, v), on_side ? 1.0f : 0.0f) << u << " " << v;
    }
  }
}

TEST(MeasureShapeIou, CountsPixels) {
  // What is measured on the left: the face, a hole, something in front and something behind. On the
  // right, a label without a structure.
  DepthImage depth(20, 10, 3.0f);
  LabelImage labels(20, 10, 0);
  for (int v = 0; v < 10; ++v) {
    for (int u = 0; u < 10; ++u) depth(u, v) = 1.01f;
    depth(0, v) = 0;
    depth(1, v) = 0.5f;
    depth(2, v) = 1.5f;
    labels(15, v) = 1;
  }
  const ShapeIou iou = MeasureShapeIou(MakeSensorView(depth, Coarse()), Certain(labels), LeftBox(),
                                       Pose::Identity(), 0.5);
  EXPECT_EQ(iou.both, 70);
  EXPECT_EQ(iou.either, 90);
}

}  // namespace
}  // namespace volalign::agreement_test
