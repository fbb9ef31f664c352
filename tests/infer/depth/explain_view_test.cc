#include "infer/depth/explain_view.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/infer/view/synthetic.h"

namespace volalign::explain_view_test {
namespace {

using testing_infer::Certain;
using testing_infer::Coarse;

/// A box whose face at 1 m covers the left half of Coarse's view.
Structure LeftBox() {
  return Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 1, 2))});
}

/// Columns of Coarse's view, each of 10 pixels, in cells: the solid angle of a pixel is the
/// integral of cos^3 over the square that it covers of the plane z = 1.
double CellsOfColumn(int u) {
  const double rad = ErrorsOf("").smooth_rad;
  double cells = 0;
  for (int v = 0; v < 10; ++v) {
    const double x = (u - 9.5) / 40, y = (v - 4.5) / 40;
    cells += 1 / (40.0 * 40 * rad * rad) / std::pow(std::sqrt(1 + x * x + y * y), 3);
  }
  return cells;
}

double CellsOfColumns(int from, int to) {
  double cells = 0;
  for (int u = from; u <= to; ++u) cells += CellsOfColumn(u);
  return cells;
}

struct Seen {
  DepthImage depth = DepthImage(20, 10, 3.0f);
  SegmentationResult segmentation = Certain(LabelImage(20, 10, 0));

  Seen() {
    const Structure box = LeftBox();
    const auto front = static_cast<std::uint8_t>(testing_infer::LabelOf(box, "b/left"));
    const auto hidden = static_cast<std::uint8_t>(testing_infer::LabelOf(box, "b/right"));
    for (int v = 0; v < 10; ++v) {
      for (int u = 3; u < 9; ++u) depth(u, v) = 1.005f;
      depth(0, v) = 0;
      depth(1, v) = 0.5f;  // before it
      depth(2, v) = 1.5f;  // behind it, far from every side
      depth(9, v) = 1.2f;  // behind the face, but 1.5 cm from the side x = 0
      for (const int u : {0, 1, 3, 4, 6, 8, 15}) segmentation.labels(u, v) = front;
      segmentation.labels(5, v) = hidden;
      segmentation.confidence(6, v) = 0.3f;
    }
  }
};

TEST(ExplainView, CountsCells) {
  const Seen seen;
  const ViewExplanation view = ExplainView(MakeSensorView(seen.depth, Coarse()), &seen.segmentation,
                                           LeftBox(), Pose::Identity(), 0.004, 0.5);
  // Within 1 %, as each point may be something else to that extent.
  EXPECT_NEAR(view.of(Cause::kMissing), CellsOfColumn(0), 1e-6);
  EXPECT_NEAR(view.of(Cause::kBefore), CellsOfColumn(1), 0.01);
  EXPECT_NEAR(view.of(Cause::kBehind), CellsOfColumn(2), 0.01);
  EXPECT_NEAR(view.of(Cause::kSurface), CellsOfColumns(3, 9), 0.01);
  EXPECT_NEAR(view.behind_share(), CellsOfColumn(2) / CellsOfColumns(2, 9), 0.01);
  // Labelled and with depth: 1, 3, 4, 5, 8, 15; on the side that the label names: 3, 4, 8.
  const double so = CellsOfColumns(3, 4) + CellsOfColumn(8);
  EXPECT_NEAR(view.named_so, so, 0.01);
  EXPECT_NEAR(view.labelled_on, so + CellsOfColumn(5), 0.01);
  EXPECT_NEAR(view.named_so + view.named_otherwise,
              so + CellsOfColumn(1) + CellsOfColumn(5) + CellsOfColumn(15), 0.01);
}

TEST(ExplainView, ManyRaysSayNoMoreThanFew) {
  const Seen seen;
  const SensorView view = MakeSensorView(seen.depth, Coarse());
  const auto explain = [&](const SensorView& of) {
    return ExplainView(of, nullptr, LeftBox(), Pose::Identity(), 0.004, 0.5);
  };
  const ViewExplanation all = explain(view), few = explain(Decimate(view, 2));
  double cells = 0, of_few = 0;
  for (std::size_t k = 0; k < kCauses; ++k) {
    cells += all.causes[k];
    of_few += few.causes[k];
  }
  EXPECT_NEAR(of_few, cells, 0.02 * cells);
  EXPECT_EQ(all.named_so + all.named_otherwise, 0);
  EXPECT_EQ(all.LogOddsByLabels(), 0);
}

// The paper's stack from 2 m: its pose explains the view, one that is a quarter turn and a box off
// does not, and what hides half of it or is missing changes nothing.
TEST(ExplainView, TellsRightFromWrongWhateverIsHidden) {
  const Structure structure = testing_infer::PaperStructure();
  const Pose pose = testing_infer::RingPose(30);
  const testing_infer::SyntheticView rendered =
      testing_infer::Render(structure, testing_infer::Kinect(), pose, {true, 3});
  SensorView view = MakeSensorView(rendered.depth, testing_infer::Kinect());
  const auto log_odds = [&](const Pose& at) {
    return ExplainView(view, nullptr, structure, at, 0.004, 0.5).LogOddsByDepth();
  };
  const Pose turned = Pose(Eigen::Translation3d(0, 0.4, 0) *
                           Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY())) *
                      pose;
  EXPECT_GT(log_odds(pose), 1);
  EXPECT_LT(log_odds(turned), -std::log(100.0));
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (v % 2 == 0) view.depth(u, v) = 0;
      if (v > view.height() / 2 && view.depth(u, v) > 0) view.depth(u, v) = 0.8f;
    }
  }
  EXPECT_GT(log_odds(pose), 0);
}

}  // namespace
}  // namespace volalign::explain_view_test
