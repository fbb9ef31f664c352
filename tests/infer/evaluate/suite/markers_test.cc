#include "infer/evaluate/suite/markers.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/metrics.h"
#include "core/geometry/visibility.h"
#include "infer/evaluate/suite/graph_icp.h"
#include "infer/evaluate/suite/paper_pose.h"
#include "infer/evaluate/suite/scores.h"
#include "infer/view/sensor_view.h"
#include "render/egl/renderers.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::markers_test {
namespace {

using namespace testing_infer;
using testing_infer::Rig;

/// A RealSense D415's depth map at a quarter of its infrared picture.
Intrinsics Infrared() { return {1280, 720, 943.57, 943.57, 636.6, 352.95, {}}; }

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
    return MakeSensorView(Render(structure_, depth, pose).depth, depth);
  }
  /// Pixel of a point of the structure.
  Eigen::Vector2d Project(const Pose& pose, const Eigen::Vector3d& p) const {
    const Eigen::Vector3d q = pose.inverse() * p;
    return {infrared_.fx * q.x() / q.z() + infrared_.cx,
            infrared_.fy * q.y() / q.z() + infrared_.cy};
  }

  Structure structure_ = PaperStructure();
  Intrinsics infrared_ = Infrared();
  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& renderer_ = *owned_;
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
  for (const char* covered : {"mid_bottom/up", "mid_top/up", "bottom/up"})
    EXPECT_EQ(labels.count(LabelOf(structure_, covered)), 0u) << covered;
  EXPECT_EQ(prints_.size(), 17u);
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
      for (std::size_t k = 0; k < 4; ++k)
        EXPECT_LT((Project(pose, corners[k]) - marker.corners[k]).norm(), 0.5) << side.name << k;
      EXPECT_LT((Project(pose, side.centre) - marker.centre).norm(), 0.5) << side.name;
    }
    const std::optional<Pose> estimated =
        EstimateMarkerPose(View(pose), infrared_, found, structure_);
    ASSERT_TRUE(estimated);
    EXPECT_TRUE(Within(ComparePoses(*estimated, pose), 0.005, 0.2));
    // Of exact centres: half a pixel of the picture, which is four times the depth map's, is 1 mm.
    std::vector<FoundMarker> exact = found;
    for (FoundMarker& marker : exact)
      marker.centre = Project(pose, structure_.SideOfLabel(marker.label).centre);
    const std::optional<Pose> of_exact =
        EstimateMarkerPose(View(pose), infrared_, exact, structure_);
    ASSERT_TRUE(of_exact);
    EXPECT_LT(ComparePoses(*of_exact, pose).translation_m, 1e-6);
  }
}

TEST_F(Markers, TooFewMarkersFixNoPose) {
  const Pose pose = RingPose(10);
  std::vector<FoundMarker> found = FindMarkers(Picture(pose, NoiseFree()), structure_);
  found.resize(2);
  EXPECT_FALSE(EstimateMarkerPose(View(pose), infrared_, found, structure_));
  EXPECT_TRUE(FindMarkers(GreyImage(640, 480, 90), structure_).empty());
}

/// A frame of a few hundred pixels with gaps and wrong labels, and a pose that is a little off.
struct SmallCase {
  Structure structure = PaperStructure();
  Intrinsics intrinsics;
  Pose pose;
  SensorView view;
  LabelImage labels;

  SmallCase() {
    intrinsics = Kinect().Resized(32, 28);
    const Pose truth = RingPose(35, 2.0, 0.5, 0);
    SyntheticView seen = Render(structure, intrinsics, truth);
    RandomStream random(3, 0, "small case");
    for (std::size_t i = 0; i < seen.depth.size(); ++i) {
      if (random.Chance(0.1)) seen.depth[i] = 0;
      if (seen.depth[i] == 0) seen.labels[i] = 0;
      if (random.Chance(0.05)) seen.labels[i] = static_cast<std::uint8_t>(random.Below(21));
    }
    Vector6d delta;
    delta << 0.05, -0.03, 0.04, 0.02, -0.03, 0.01;
    pose = PerturbLeft(delta, truth);
    view = MakeSensorView(seen.depth, intrinsics);
    labels = std::move(seen.labels);
  }
};

TEST(PaperMetrics, MiouCountsClassesThatAreAbsentAsTheAuthorsDo) {
  const SmallCase c;
  const LabelImage shown = CastView(c.structure, c.view.rays, c.pose).labels;
  const PoseScore score = ScorePose(c.view, c.labels, c.structure, c.pose, 5);
  EXPECT_NEAR(score.miou_authors, MeanIou(c.labels, shown, c.view.depth, {21, true}), 1e-12);
}

TEST(PaperMetrics, RmseIsThatOfBruteForce) {
  const SmallCase c;
  constexpr int kMinPixels = 5;
  double to_centre = 0;
  int sides = 0;
  for (const Side& side : c.structure.sides()) {
    if (side.label == 0) continue;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int seen = 0;
    for (const auto [u, v] : Pixels(32, 28)) {
      if (!(c.view.depth(u, v) > 0) || c.labels(u, v) != side.label) continue;
      sum += c.pose * c.view.Point(u, v);
      ++seen;
    }
    if (seen < kMinPixels) continue;
    ++sides;
    to_centre += (sum / seen - side.centre).squaredNorm();
  }
  ASSERT_GT(sides, 4);
  const PoseScore score = ScorePose(c.view, c.labels, c.structure, c.pose, kMinPixels);
  EXPECT_EQ(score.sides, sides);
  EXPECT_NEAR(score.rmse_m.value(), std::sqrt(to_centre / sides), 1e-6);  // depth is in float
  EXPECT_FALSE(ScorePose(c.view, c.labels, c.structure, c.pose, 10000).rmse_m);
}

TEST(PaperMetrics, ColumnsHaveTheirDefinition) {
  // Two set-ups: 1 and 3, and 10 and 30.
  const ColumnStatistics column = Column({1, 10, 3, 30}, {0, 7, 0, 7});
  EXPECT_EQ(column.count, 4);
  EXPECT_DOUBLE_EQ(column.mean, 11);
  EXPECT_DOUBLE_EQ(column.std, std::sqrt((100 + 1 + 64 + 361) / 4.0));
  EXPECT_DOUBLE_EQ(column.rsd, column.std / 11);
  EXPECT_DOUBLE_EQ(column.rsd_within.value(), 0.5);
  // One value has no spread: it does not count as 0.
  EXPECT_DOUBLE_EQ(Column({1, 3, 7}, {0, 0, 1}).rsd_within.value(), 0.5);
  EXPECT_FALSE(Column({1, 3}, {0, 1}).rsd_within.has_value());
  EXPECT_EQ(Column({}, {}).count, 0);
}

struct Perturbed {
  std::vector<SensorView> views;
  std::vector<GraphFrame> graph;
};

Perturbed Perturb(const Rig& rig, double metres, double radians, std::uint64_t seed) {
  Perturbed out;
  for (const SensorFrame& frame : rig.frames)
    out.views.push_back(MakeSensorView(frame.depth, frame.intrinsics));
  RandomStream random(seed, 0, "perturbed");
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    Vector6d delta;
    for (int k = 0; k < 6; ++k) delta[k] = (k < 3 ? metres : radians) * random.Uniform(-1, 1);
    // Turned about the sensor, not about the structure's origin.
    const Pose& truth = *rig.frames[i].ground_truth;
    out.graph.push_back({&out.views[i], truth * PerturbLeft(delta, Pose::Identity())});
  }
  return out;
}

TEST(GraphIcp, FindsTheTruePosesOfExactDepth) {
  // Each sees sides in three directions: what planes leave open, they do not tell.
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) rig.Add(RingPose(90.0 * i + 45, 2.0, 1.0));
  const Perturbed start = Perturb(rig, 0.04, 0.02, 1);
  const std::vector<Pose> poses = RefineGraph(rig.structure, start.graph);
  ASSERT_EQ(poses.size(), 4u);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const PoseError before =
        ComparePoses(start.graph[i].structure_from_sensor, *rig.frames[i].ground_truth);
    const PoseError after = ComparePoses(poses[i], *rig.frames[i].ground_truth);
    EXPECT_GT(before.translation_m, 0.01);
    EXPECT_TRUE(Within(after, 0.003, 0.1)) << i;
  }
}

// What two views see of the same places tells how they stand to one another, beside what each sees
// of the structure.
TEST(GraphIcp, JoinsViewsThatOverlap) {
  double apart_m = 0, joined_m = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Rig rig{PaperStructure(), {}, {}};
    rig.Add("A", RingPose(90 * static_cast<double>(seed) + 25, 2.0, 1.0));
    rig.Add("B", RingPose(90 * static_cast<double>(seed) + 65, 2.0, 1.0));
    for (std::size_t i = 0; i < 2; ++i)
      AddSmoothError(&rig.frames[i].depth, 0.004, 20, 2 * seed + i);
    const Perturbed start = Perturb(rig, 0.03, 0.02, seed);
    const auto between = [&](const std::vector<Pose>& poses) {
      const Pose& a = *rig.frames[0].ground_truth;
      const Pose& b = *rig.frames[1].ground_truth;
      return ComparePoses(poses[0].inverse() * poses[1], a.inverse() * b).translation_m;
    };
    const std::vector<Pose> joined = RefineGraph(rig.structure, start.graph);
    apart_m += between(RefineGraph(rig.structure, start.graph, /*min_overlap=*/1)) / 8;
    joined_m += between(joined) / 8;
    for (std::size_t i = 0; i < 2; ++i)
      EXPECT_LT(ComparePoses(joined[i], *rig.frames[i].ground_truth).translation_m, 0.025);
  }
  EXPECT_LT(joined_m, apart_m);  // 11.7 and 13.3 mm
}

TEST(GraphIcp, AViewWithoutPointsStaysWhereItIs) {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("A", RingPose(0));
  Perturbed start = Perturb(rig, 0.03, 0.02, 5);
  std::fill(start.views[0].depth.begin(), start.views[0].depth.end(), 0.0f);
  const std::vector<Pose> poses = RefineGraph(rig.structure, start.graph);
  EXPECT_LT(ComparePoses(poses[0], start.graph[0].structure_from_sensor).translation_m, 1e-9);
  EXPECT_TRUE(RefineGraph(rig.structure, {}).empty());
}

using namespace testing_infer;

/// The paper's estimate is the least-squares pose between the medians of the sides' pixels, found
/// here by sorting, and the centroids of what is exposed of them.
TEST(PaperPose, IsLeastSquaresOverMediansOfLargeSides) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  SegmentationResult segmentation = Certain(rendered.labels);
  // Unsure pixels count, a side of 1 pixel in 288 and less does not.
  for (std::size_t i = 0; i < segmentation.labels.size(); i += 5) segmentation.confidence[i] = 0.1f;
  const std::size_t most = segmentation.labels.size() / 288;
  const int small = LabelOf(structure, "mid_top/front");
  std::size_t kept = 0;
  for (std::uint8_t& label : segmentation.labels) {
    if (label == small && kept++ >= most) label = 0;
  }
  ASSERT_GT(kept, most);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const std::optional<Pose> estimate = EstimatePaperPose(view, segmentation, structure);
  ASSERT_TRUE(estimate.has_value());
  Eigen::Matrix3Xd medians(3, 0), keypoints(3, 0);
  for (int label = 1; label < structure.num_classes(); ++label) {
    std::array<std::vector<double>, 3> coordinates;
    for (const auto [u, v] : Pixels(view)) {
      if (segmentation.labels(u, v) != label || !(view.depth(u, v) > 0)) continue;
      for (std::size_t i = 0; i < 3; ++i)
        coordinates[i].push_back(view.Point(u, v)[static_cast<Eigen::Index>(i)]);
    }
    if (coordinates[0].size() <= most) continue;
    for (Eigen::Matrix3Xd* points : {&medians, &keypoints})
      points->conservativeResize(3, points->cols() + 1);
    keypoints.rightCols<1>() = structure.SideOfLabel(label).exposed_centroid;
    for (std::size_t i = 0; i < 3; ++i) {
      std::sort(coordinates[i].begin(), coordinates[i].end());
      medians.rightCols<1>()[static_cast<Eigen::Index>(i)] =
          coordinates[i][coordinates[i].size() / 2];
    }
  }
  ASSERT_GE(medians.cols(), 3);
  EXPECT_LT((estimate->matrix() - Eigen::umeyama(medians, keypoints, false)).cwiseAbs().maxCoeff(),
            1e-6);
}

TEST(PaperPose, FindsNothingInCollinearCentres) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  const std::vector<int> kept =
      LabelsOf(structure, {"mid_bottom/front", "mid_top/front", "top/front"});
  LabelImage labels = rendered.labels;
  for (std::uint8_t& label : labels) {
    if (std::find(kept.begin(), kept.end(), label) == kept.end()) label = 0;
  }
  EXPECT_FALSE(
      EstimatePaperPose(MakeSensorView(rendered.depth, Kinect()), Certain(labels), structure)
          .has_value());
}

}  // namespace
}  // namespace volalign::markers_test
