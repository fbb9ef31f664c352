// What Calibrate makes of one capture must not depend on how it is put: on the number of threads,
// the order of the sensors, the way a picture is turned, the unit of length, the place of the
// structure's frame or the labels to begin with. These checks need no ground truth.

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_invariance_test {
namespace {

using namespace testing_infer;

/// Four sensors in a room, none at the same height, with errors of some millimetres.
Rig NoisyRing() {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) {
    rig.Add(RingPose(25 + 85.0 * i, 1.9 + 0.1 * i, 0.2 + 0.1 * i), {true, 3.5});
    DepthImage& depth = rig.frames.back().depth;
    AddNoise(&depth, 0.001, static_cast<std::uint64_t>(i));
    AddSmoothError(&depth, 0.003, 20, static_cast<std::uint64_t>(i));
  }
  return rig;
}

Rig NoiseFreeRing() {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) rig.Add(RingPose(25 + 85.0 * i, 1.9, 0.3), {true, 3.5});
  return rig;
}

/// The largest difference between the sensors' poses, each of `a` moved by what `expected` does to
/// it.
template <class Expected>
PoseError Farthest(const CalibrationResult& a, const CalibrationResult& b, Expected expected) {
  PoseError worst;
  EXPECT_EQ(a.placed(), static_cast<int>(a.sensors.size()));
  EXPECT_EQ(b.placed(), static_cast<int>(a.sensors.size()));
  for (std::size_t i = 0; i < a.sensors.size(); ++i) {
    if (!a.sensors[i].structure_from_sensor || !b.sensors[i].structure_from_sensor) continue;
    const PoseError error = ComparePoses(expected(*a.sensors[i].structure_from_sensor),
                                         *b.sensors[i].structure_from_sensor);
    worst.translation_m = std::max(worst.translation_m, error.translation_m);
    worst.rotation_deg = std::max(worst.rotation_deg, error.rotation_deg);
  }
  return worst;
}

void ExpectSameSensor(const FrameResult& a, const FrameResult& b, double tolerance) {
  EXPECT_EQ(a.name, b.name);
  EXPECT_EQ(a.status, b.status) << a.name;
  EXPECT_EQ(a.code, b.code) << a.name;
  EXPECT_EQ(a.reason, b.reason) << a.name;
  EXPECT_EQ(a.sides, b.sides) << a.name;
  EXPECT_EQ(a.points, b.points) << a.name;
  EXPECT_EQ(a.quarter_turns, b.quarter_turns) << a.name;
  ASSERT_EQ(a.structure_from_sensor.has_value(), b.structure_from_sensor.has_value()) << a.name;
  if (!a.structure_from_sensor) return;
  const auto difference = [](const auto& x, const auto& y) {
    return (x - y).cwiseAbs().maxCoeff();
  };
  EXPECT_LE(difference(a.structure_from_sensor->matrix(), b.structure_from_sensor->matrix()),
            tolerance)
      << a.name;
  EXPECT_LE(difference(a.initial.matrix(), b.initial.matrix()), tolerance) << a.name;
  EXPECT_LE(difference(a.covariance, b.covariance), tolerance) << a.name;
  EXPECT_NEAR(a.depth_offset_m, b.depth_offset_m, tolerance) << a.name;
  EXPECT_NEAR(a.depth_gain, b.depth_gain, tolerance) << a.name;
  EXPECT_NEAR(a.rms_to_structure_m, b.rms_to_structure_m, tolerance) << a.name;
  EXPECT_NEAR(a.label_iou, b.label_iou, 100 * tolerance) << a.name;
  EXPECT_NEAR(a.explained_share, b.explained_share, 100 * tolerance) << a.name;
}

TEST(Invariance, AnyNumberOfThreads) {
  const Rig rig = NoisyRing();
  CalibrateOptions options;
  options.threads = 1;
  const CalibrationResult one = CalibrateRig(rig, options);
  ASSERT_EQ(one.placed(), 4);
  for (const int threads : {2, 5}) {
    options.threads = threads;
    const CalibrationResult many = CalibrateRig(rig, options);
    for (std::size_t i = 0; i < rig.frames.size(); ++i)
      ExpectSameSensor(one.sensors[i], many.sensors[i], 1e-12);
    ASSERT_EQ(one.pairs.size(), many.pairs.size());
    for (std::size_t i = 0; i < one.pairs.size(); ++i) {
      EXPECT_EQ(one.pairs[i].a + one.pairs[i].b, many.pairs[i].a + many.pairs[i].b);
      EXPECT_NEAR(one.pairs[i].rms_m, many.pairs[i].rms_m, 1e-12);
    }
    EXPECT_NEAR(one.size_scale, many.size_scale, 1e-12);
    EXPECT_NEAR(one.metrics->d1, many.metrics->d1, 1e-12);
  }
}

TEST(Invariance, AnyOrderOfTheSensors) {
  Rig rig = NoisyRing();
  // One fails and one is weak: outcomes must stay with their sensors, too.
  std::fill(rig.frames[1].depth.begin(), rig.frames[1].depth.end(), 0.0f);
  Restrict(rig.structure, &rig.labels[2], [](const Side& side) { return side.box < 2; });
  const CalibrationResult before = CalibrateRig(rig);
  EXPECT_EQ(before.sensors[1].status, SensorStatus::kFailed);
  EXPECT_EQ(before.sensors[2].status, SensorStatus::kWeak);
  const std::vector<std::size_t> order = {2, 0, 3, 1};
  Rig other{rig.structure, {}, {}};
  for (const std::size_t i : order) {
    other.frames.push_back(rig.frames[i]);
    other.labels.push_back(rig.labels[i]);
  }
  const CalibrationResult after = CalibrateRig(other);
  // Sums run in another order, and iterations stop a little earlier or later.
  for (std::size_t i = 0; i < order.size(); ++i)
    ExpectSameSensor(before.sensors[order[i]], after.sensors[i], 1e-6);
  EXPECT_EQ(before.pairs.size(), after.pairs.size());
}

TEST(Invariance, AnyTurnOfThePictures) {
  // Points are gathered in blocks and thinned by their place in the picture: a turned frame
  // with errors gives another sample of them.
  const Rig rig = NoiseFreeRing();
  const CalibrationResult upright = CalibrateRig(rig);
  for (const int turns : {1, 2, 3}) {
    Rig turned = rig;
    for (std::size_t i = 0; i < rig.frames.size(); ++i) {
      turned.frames[i].depth = Turn(rig.frames[i].depth, turns);
      turned.frames[i].intrinsics = rig.frames[i].intrinsics.Turned(turns);
      turned.frames[i].quarter_turns = (rig.frames[i].quarter_turns + 4 - turns) % 4;
      turned.labels[i] = Turn(rig.labels[i], turns);
    }
    const PoseError worst = Farthest(upright, CalibrateRig(turned), [&](const Pose& pose) -> Pose {
      // By hand: a clockwise turn sends the image's x axis to y, and its y axis to -x.
      Eigen::Matrix3d sensor_from_turned = Eigen::Matrix3d::Identity();
      for (int k = 0; k < turns; ++k) {
        Eigen::Matrix3d once;
        once << 0, 1, 0, -1, 0, 0, 0, 0, 1;
        sensor_from_turned *= once;
      }
      Pose moved = pose;
      moved.linear() = pose.linear() * sensor_from_turned;
      return moved;
    });
    EXPECT_TRUE(Within(worst, 1e-3, 0.01)) << turns;
  }
}

/// The boxes moved as one body and scaled about the origin.
Structure Moved(const Structure& structure, const Pose& motion, double scale) {
  std::vector<Box> boxes = structure.boxes();
  for (Box& box : boxes) {
    box.size *= scale;
    box.structure_from_box.translation() *= scale;
    box.structure_from_box = motion * box.structure_from_box;
  }
  return Structure::FromBoxes(structure.name(), boxes, structure.SideNames());
}

// By quarter turns: what lies round the structure is looked for in a box along its frame's axes.
TEST(Invariance, AnyPlaceOfTheStructuresFrame) {
  const Rig rig = NoisyRing();
  const CalibrationResult result = CalibrateRig(rig);
  for (const int turns : {1, 2}) {
    const Pose motion = MakePose({0, turns * M_PI / 2, 0}, {1.5, 0.4, -0.8});
    Rig moved = rig;
    moved.structure = Moved(rig.structure, motion, 1);
    const PoseError worst = Farthest(result, CalibrateRig(moved),
                                     [&](const Pose& pose) -> Pose { return motion * pose; });
    // What is estimated, and how loosely, is chosen among few alternatives: two that are about
    // equally probable differ by this much.
    EXPECT_TRUE(Within(worst, 1.5e-3, 0.03)) << turns;
  }
}

// A depth file in another unit, with boxes that were measured in it. The gates in metres bind the
// two captures differently, so only frames without noise come out alike.
TEST(Invariance, AnyUnitOfLength) {
  const Rig rig = NoiseFreeRing();
  const CalibrationResult metres = CalibrateRig(rig);
  for (const double scale : {0.9144, 1.1}) {
    Rig scaled = rig;
    scaled.structure = Moved(rig.structure, Pose::Identity(), scale);
    for (SensorFrame& frame : scaled.frames) {
      for (float& z : frame.depth) z *= static_cast<float>(scale);
    }
    const CalibrationResult result = CalibrateRig(scaled);
    const PoseError worst = Farthest(metres, result, [&](const Pose& pose) -> Pose {
      Pose longer = pose;
      longer.translation() *= scale;
      return longer;
    });
    EXPECT_TRUE(Within(worst, 5e-4, 0.01)) << scale;
    for (const FrameResult& sensor : result.sensors)
      EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.reason;
  }
}

/// Half of the labels, those of every second stripe of the picture, and none near a side's end.
LabelImage InStripes(const LabelImage& labels) {
  LabelImage some = labels;
  for (const auto [u, v] : Pixels(labels)) {
    bool inside = u / 12 % 2 == 0;
    for (const int d : {-4, 4})
      inside = inside && labels.Contains(u + d, v) && labels(u + d, v) == labels(u, v) &&
               labels.Contains(u, v + d) && labels(u, v + d) == labels(u, v);
    if (!inside) some(u, v) = 0;
  }
  return some;
}

// The points are labelled by the solution itself until it stays, whatever it began with.
TEST(Invariance, AnyLabelsToBeginWith) {
  Rig rig = NoisyRing();
  const CalibrationResult all = CalibrateRig(rig);
  for (LabelImage& labels : rig.labels) labels = InStripes(labels);
  const CalibrationResult some = CalibrateRig(rig);
  EXPECT_TRUE(Within(Farthest(all, some, [](const Pose& pose) { return pose; }), 1e-3, 0.1));
  double apart_at_first = 0;
  for (std::size_t i = 0; i < rig.frames.size(); ++i)
    apart_at_first =
        std::max(apart_at_first,
                 ComparePoses(all.sensors[i].initial, some.sensors[i].initial).translation_m);
  EXPECT_GT(apart_at_first, 0.005) << "nothing to settle";
}

}  // namespace
}  // namespace volalign::calibrate_invariance_test
