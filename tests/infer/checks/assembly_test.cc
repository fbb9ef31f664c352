// Stacks whose boxes were moved by hand here, ray-cast from several sides. Labels are those of a
// network that knows the described stack: a side is named by the direction that it faces.

#include "infer/checks/assembly.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "infer/initial/agreement.h"
#include "infer/initial/aliases.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::assembly_test {
namespace {

using testing_infer::Certain;
using testing_infer::FlipFrame;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::Rig;
using testing_infer::RingPose;

/// Footprint of a box, mm, in its place from the floor.
struct Footprint {
  double x0, x1, z0, z1;
};
constexpr Footprint kBottom{-280, 275, -165, 165}, kMidBottom{-280, 50, -390, 165},
    kMidTop{-505, 50, -165, 165}, kTop{-280, 50, -165, 390};

/// The paper's boxes on other footprints, 405 mm each; a box without area is missing.
Structure Stack(const std::vector<Footprint>& footprints) {
  const Structure described = PaperStructure();
  std::vector<Box> boxes;
  double y = -0.81;
  for (std::size_t i = 0; i < footprints.size(); ++i) {
    const Footprint& f = footprints[i];
    const bool missing = f.x0 == f.x1;
    const Eigen::Vector3d min(f.x0 / 1000, y, f.z0 / 1000);
    const Eigen::Vector3d max(f.x1 / 1000, y + 0.405, f.z1 / 1000);
    if (!missing) y += 0.405;
    // Out of every view, so that labels keep their numbers.
    const Eigen::Vector3d far(0, 50, 0), speck(0.02, 0.02, 0.02);
    boxes.push_back(missing ? Box::FromMinMax(described.boxes()[i].name, far, far + speck)
                            : Box::FromMinMax(described.boxes()[i].name, min, max));
  }
  return Structure::FromBoxes("built", boxes, described.SideNames());
}

AssemblyReport Inspect(const Structure& built, const std::vector<double>& angles) {
  const Structure described = PaperStructure();
  std::vector<SensorView> views;
  std::vector<SegmentationResult> segmentations;
  std::vector<InitialPose> initial;
  for (const double phi : angles) {
    const auto rendered = Render(built, Kinect(), RingPose(phi, 2.1), {true, 3.5});
    views.push_back(MakeSensorView(rendered.depth, Kinect()));
    segmentations.push_back(Certain(rendered.labels));
    initial.push_back(
        EstimateInitialPose(views.back(), segmentations.back(), described, InitialPoseOptions()));
  }
  std::vector<AssemblySensor> sensors;
  for (std::size_t i = 0; i < views.size(); ++i)
    sensors.push_back({&views[i], &segmentations[i], &initial[i]});
  return InspectAssembly(sensors, described, {}, {}, 2);
}

struct Case {
  Structure built;
  SensorCode code;
  std::string sentence;
};

TEST(Assembly, NamesWhatIsBuiltWrongly) {
  const Footprint none{0, 0, 0, 0};
  const std::vector<Case> cases = {
      {Stack({kBottom, kMidBottom, kMidTop, kTop}), SensorCode::kNone,
       "the boxes stand as described"},
      // The overhang of mid_bottom on the other side, that of mid_top over +z, of bottom over -z.
      {Stack({kBottom, {-280, 50, -165, 390}, kMidTop, kTop}), SensorCode::kAssemblyTurned,
       "box mid_bottom is turned by 180 deg"},
      {Stack({kBottom, kMidBottom, {-280, 50, -390, 165}, kTop}), SensorCode::kAssemblyTurned,
       "box mid_top is turned by 90 deg"},
      {Stack({{-280, 50, -390, 165}, kMidBottom, kMidTop, kTop}), SensorCode::kAssemblyTurned,
       "box bottom is turned by 270 deg"},
      {Stack({kBottom, kMidBottom, kTop, kMidTop}), SensorCode::kAssemblySwapped,
       "boxes mid_top and top are swapped"},
      {Stack({kBottom, {-280, 50, -165, 390}, kMidTop, {-280, 50, -390, 165}}),
       SensorCode::kAssemblyMirrored, "the stack or the frames are mirrored"},
      {Stack({kBottom, kMidBottom, none, kTop}), SensorCode::kAssemblyMissing,
       "box mid_top is missing"},
      // The spiral without its highest box is the one without its lowest, a quarter turn further.
      {Stack({kBottom, kMidBottom, kMidTop, none}), SensorCode::kAssemblyMissing,
       "box top is missing or box bottom is missing"},
  };
  for (const Case& c : cases) {
    const AssemblyReport report = Inspect(c.built, {20, 140, 260});
    EXPECT_EQ(report.arrangement.code, c.code) << c.sentence;
    EXPECT_EQ(report.arrangement.sentence, c.sentence)
        << report.described_shape_iou << " " << report.shape_iou;
    EXPECT_EQ(report.altered(), c.code != SensorCode::kNone);
    EXPECT_GT(report.shape_iou, 0.95) << c.sentence;
    if (report.altered()) {
      EXPECT_LT(report.described_shape_iou, 0.9) << c.sentence;
    }
  }
}

TEST(InspectAssembly, AStackThatHangsUpsideDownIsNotSeen) {
  // Half a turn about its horizontal diagonal brings every box onto a box; the floor tells.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(30, 2.1);
  const auto rendered = Render(structure, Kinect(), pose, {true, 3.5});
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const SegmentationResult labels = Certain(rendered.labels);
  const std::vector<StructureAlias> aliases = FindAliases(structure);
  const auto over = std::find_if(aliases.begin(), aliases.end(),
                                 [](const StructureAlias& alias) { return !alias.keeps_up(); });
  ASSERT_NE(over, aliases.end());
  AssemblyOptions options;
  options.suspicious_shape_iou = options.suspicious_frame_shape_iou = 0;  // nothing else is tried
  const auto iou = [&](const Pose& at) {
    InitialPose initial;
    initial.found = true;
    initial.structure_from_sensor = at;
    return InspectAssembly({{&view, &labels, &initial}}, structure, InitialPoseOptions(), options,
                           1)
        .described_shape_iou;
  };
  EXPECT_GT(iou(pose), 0.98);
  ASSERT_GT(MeasureShapeIou(view, labels, structure, over->motion * pose, 0.5).ratio(), 0.9);
  EXPECT_EQ(iou(over->motion * pose), 0);
}

TEST(InspectAssembly, AFrameIsMirroredOnlyBesideOneThatShowsTheStackAsDescribed) {
  // The first frame is mirrored. Beside a frame of a stack of which a box was pushed aside by 15
  // cm, nothing says that the stack is as described, though no single arrangement explains both
  // frames.
  const Structure described = PaperStructure();
  const Structure pushed = Stack({kBottom, {-430, -100, -390, 165}, kMidTop, kTop});
  for (const bool as_described : {true, false}) {
    Rig rig{described, {}, {}};
    rig.Add("mirrored", RingPose(20, 2.1), {true, 3.5});
    FlipFrame(described, &rig.frames[0], &rig.labels[0]);
    rig.structure = as_described ? described : pushed;
    rig.Add("other", RingPose(140, 2.1), {true, 3.5});
    std::vector<SensorView> views;
    for (const SensorFrame& frame : rig.frames)
      views.push_back(MakeSensorView(frame, frame.intrinsics));
    std::vector<SegmentationResult> segmentations;
    std::vector<InitialPose> initial;
    for (std::size_t i = 0; i < views.size(); ++i) {
      segmentations.push_back(Certain(rig.labels[i]));
      initial.push_back(
          EstimateInitialPose(views[i], segmentations[i], described, InitialPoseOptions()));
    }
    const AssemblyReport report = InspectAssembly(
        {{&views[0], &segmentations[0], &initial[0]}, {&views[1], &segmentations[1], &initial[1]}},
        described, {}, {}, 2);
    const std::vector<std::size_t> first{0}, none;
    EXPECT_EQ(report.mirrored_frames, as_described ? first : none) << report.arrangement.sentence;
  }
}

}  // namespace
}  // namespace volalign::assembly_test
