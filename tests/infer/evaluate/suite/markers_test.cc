#include "infer/evaluate/suite/markers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::markers_test {
namespace {

using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// A RealSense D415's depth map at a quarter of its infrared picture.
Intrinsics Infrared() {
  Intrinsics intrinsics;
  intrinsics.width = 1280;
  intrinsics.height = 720;
  intrinsics.fx = intrinsics.fy = 943.57;
  intrinsics.cx = 636.6;
  intrinsics.cy = 352.95;
  return intrinsics;
}

class Markers : public testing::Test {
 protected:
  Markers() {
    mesh_.BeginObject({0.6F, 1.0F, true});
    mesh_.AppendStructure(structure_);
  }
  GreyImage Picture(const Pose& pose, const InfraredConfig& config) {
    return RenderInfrared(mesh_, structure_, prints_, infrared_, pose, config, renderer_, 1, 0);
  }
  static InfraredConfig NoiseFree() {
    InfraredConfig config;
    config.full_well_electrons = 0;
    config.blur_px = 0;
    config.supersampling = 3;
    return config;
  }
  SensorView View(const Pose& pose) const {
    const Intrinsics depth = infrared_.Resized(320, 180);
    return MakeSensorView(testing_infer::Render(structure_, depth, pose).depth, depth);
  }
  /// Pixel of a point of the structure.
  Eigen::Vector2d Project(const Pose& pose, const Eigen::Vector3d& p) const {
    const Eigen::Vector3d q = pose.inverse() * p;
    return {infrared_.fx * q.x() / q.z() + infrared_.cx,
            infrared_.fy * q.y() / q.z() + infrared_.cy};
  }

  Structure structure_ = PaperStructure();
  Intrinsics infrared_ = Infrared();
  EglContext egl_;
  GlDepthRenderer renderer_;
  SceneMesh mesh_;
  std::vector<MarkerPrint> prints_ = StructureMarkers(structure_);
};

// Which centres another box covers, read off configs/structure.yaml: the top of each box but the
// highest stands under the next one's bottom, wherever that reaches over its middle.
TEST_F(Markers, SidesWhoseCentreAnotherBoxCoversCarryNone) {
  std::set<int> labels;
  for (const MarkerPrint& print : prints_) {
    labels.insert(print.label);
    EXPECT_EQ(print.cells.width(), 6);
    EXPECT_EQ(print.cells(0, 0), 0);  // black border
  }
  for (const char* covered : {"mid_bottom/up", "mid_top/up", "bottom/up"}) {
    const Side& side = structure_.SideOfLabel(LabelOf(structure_, covered));
    bool under = false;
    for (const Box& box : structure_.boxes()) {
      const Eigen::Vector3d middle = box.structure_from_box.translation();
      under = under || (middle.y() > side.centre.y() && middle.y() < side.centre.y() + 0.3 &&
                        std::abs(middle.x() - side.centre.x()) < 0.5 * box.size.x() &&
                        std::abs(middle.z() - side.centre.z()) < 0.5 * box.size.z());
    }
    EXPECT_EQ(labels.count(LabelOf(structure_, covered)), under ? 0u : 1u) << covered;
  }
  EXPECT_LT(prints_.size(), 20u);
  EXPECT_GE(prints_.size(), 17u);
}

TEST_F(Markers, CornersAndPosesOfANoiseFreeFrame) {
  for (const double phi : {10.0, 100.0, 190.0, 280.0}) {
    SCOPED_TRACE(phi);
    const Pose pose = RingPose(phi);
    const std::vector<FoundMarker> found = FindMarkers(Picture(pose, NoiseFree()), structure_);
    ASSERT_GE(found.size(), 4u);
    for (const FoundMarker& marker : found) {
      const Side& side = structure_.SideOfLabel(marker.label);
      const double half = 0.5 * InfraredConfig().marker_m;
      const Eigen::Vector3d u = half * side.axis_u, v = half * side.axis_v;
      const std::array<Eigen::Vector3d, 4> corners{side.centre - u + v, side.centre + u + v,
                                                   side.centre + u - v, side.centre - u - v};
      for (std::size_t k = 0; k < 4; ++k) {
        EXPECT_LT((Project(pose, corners[k]) - marker.corners[k]).norm(), 0.5) << side.name << k;
      }
      EXPECT_LT((Project(pose, side.centre) - marker.centre).norm(), 0.5) << side.name;
    }
    const std::optional<Pose> estimated =
        EstimateMarkerPose(View(pose), infrared_, found, structure_);
    ASSERT_TRUE(estimated);
    EXPECT_LT(ComparePoses(*estimated, pose).translation_m, 0.005);
    EXPECT_LT(ComparePoses(*estimated, pose).rotation_deg, 0.2);
  }
}

// A depth map of a quarter of the picture's size; half a pixel of the picture is 1 mm here.
TEST_F(Markers, PosesOfExactCentres) {
  for (const double phi : {30.0, 120.0, 210.0, 300.0}) {
    SCOPED_TRACE(phi);
    const Pose pose = RingPose(phi);
    std::vector<FoundMarker> found;
    for (int label = 1; label < structure_.num_classes(); ++label) {
      const Side& side = structure_.SideOfLabel(label);
      const Eigen::Vector3d eye = pose.translation();
      if (CastRay(structure_, eye, side.centre - eye).t < 1 - 1e-6) continue;  // hidden
      FoundMarker marker;
      marker.label = label;
      marker.centre = Project(pose, side.centre);
      found.push_back(marker);
    }
    const std::optional<Pose> estimated =
        EstimateMarkerPose(View(pose), infrared_, found, structure_);
    ASSERT_TRUE(estimated);
    EXPECT_LT(ComparePoses(*estimated, pose).translation_m, 1e-6);
  }
}

TEST_F(Markers, NoiseAndBlurAreThere) {
  const Pose pose = RingPose(10);
  InfraredConfig noisy = NoiseFree();
  noisy.full_well_electrons = 5000;
  const GreyImage clean = Picture(pose, NoiseFree()), grainy = Picture(pose, noisy);
  double squares = 0, expected = 0;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    if (clean[i] < 30 || clean[i] > 200) continue;
    const double electrons = clean[i] / 255.0 * 5000;
    squares += std::pow(static_cast<double>(grainy[i]) - clean[i], 2);
    expected += std::pow(255.0 / 5000, 2) * (electrons + 100);
  }
  EXPECT_NEAR(squares / expected, 1, 0.1);  // quantisation adds a little
  EXPECT_EQ(Picture(pose, noisy), grainy);  // the same seed
  InfraredConfig blurred = NoiseFree();
  blurred.blur_px = 2;
  const auto steepest = [](const GreyImage& image) {
    int step = 0;
    for (std::size_t i = 1; i < image.size(); ++i)
      step = std::max(step, std::abs(image[i] - image[i - 1]));
    return step;
  };
  EXPECT_LT(steepest(Picture(pose, blurred)), steepest(clean) / 2);
}

TEST_F(Markers, TooFewMarkersFixNoPose) {
  const Pose pose = RingPose(10);
  std::vector<FoundMarker> found = FindMarkers(Picture(pose, NoiseFree()), structure_);
  found.resize(2);
  EXPECT_FALSE(EstimateMarkerPose(View(pose), infrared_, found, structure_));
  EXPECT_TRUE(FindMarkers(GreyImage(640, 480, 90), structure_).empty());
}

}  // namespace
}  // namespace volalign::markers_test
