#include "infer/refine.h"

#include <gtest/gtest.h>
#include <Eigen/Cholesky>

#include <cmath>
#include <memory>
#include <vector>

#include "core/random.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::AddNoise;
using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Rig;
using testing_infer::RingOfEight;
using testing_infer::RingPose;

std::vector<RefineView> Views(const Rig& rig) {
  std::vector<RefineView> views;
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    views.emplace_back(MakeSensorView(rig.frames[i].depth, rig.frames[i].intrinsics),
                       Certain(rig.labels[i]), rig.structure, RefineView::Options());
  }
  return views;
}

/// A displacement of exactly this size in a random direction, about the sensor itself.
Pose Displaced(const Pose& pose, double translation, double rotation_deg, std::uint64_t seed) {
  RandomStream random(seed, 0, "displaced");
  const auto direction = [&] {
    return Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
  };
  Pose moved = pose;
  moved.translation() += translation * direction();
  moved.linear() = moved.linear() * RotationExp(rotation_deg * M_PI / 180 * direction());
  return moved;
}

TEST(PixelNormals, AreTheFacesOwn) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const auto rendered = testing_infer::Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  int tested = 0;
  for (int v = 4; v < view.height() - 4; v += 3) {
    for (int u = 4; u < view.width() - 4; u += 3) {
      const int label = rendered.labels(u, v);
      if (label == 0) continue;
      bool whole = true;
      for (int dv = -3; dv <= 3; ++dv) {
        for (int du = -3; du <= 3; ++du) whole = whole && rendered.labels(u + du, v + dv) == label;
      }
      Eigen::Vector3d normal;
      const bool found = PixelNormal(view, u, v, 3, &normal);
      if (!whole) continue;
      ASSERT_TRUE(found) << u << " " << v;
      const Eigen::Vector3d truth = pose.linear().transpose() * structure.SideOfLabel(label).normal;
      EXPECT_LT((normal - truth).norm(), 1e-3) << u << " " << v;
      ++tested;
    }
  }
  EXPECT_GT(tested, 300);
}

TEST(Silhouettes, LieOnTheEdgesOfTheirSides) {
  const Rig rig = RingOfEight();
  const std::vector<RefineView> views = Views(rig);
  for (std::size_t i = 0; i < views.size(); ++i) {
    double sum = 0;
    int count = 0;
    for (const EdgePoint& edge : views[i].edge_points) {
      const Side& side = rig.structure.SideOfLabel(edge.label);
      const Eigen::Vector3d p = *rig.frames[i].ground_truth * edge.p;
      // Closed form: signed distance from the nearest of the rectangle's four edge lines.
      const double du = std::abs(side.axis_u.dot(p - side.centre)) - side.half_u;
      const double dv = std::abs(side.axis_v.dot(p - side.centre)) - side.half_v;
      const double distance = std::abs(du) < std::abs(dv) ? du : dv;
      EXPECT_LT(std::abs(side.normal.dot(p - side.centre)), 5e-3);
      EXPECT_LT(std::abs(distance), 3 * edge.sigma + 2e-3) << side.name;
      sum += distance;
      ++count;
    }
    ASSERT_GT(count, 100) << i;
    EXPECT_LT(std::abs(sum / count), 1e-3) << "silhouettes are biased";
  }
}

TEST(Refine, NoiseFreeRigComesBackExactly) {
  const Rig rig = RingOfEight();
  const std::vector<RefineView> views = Views(rig);
  std::vector<RefineSensor> sensors;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.03, 1.5, i);
    sensors.push_back({&views[i], start, start, true});
  }
  const RefineResult result = Refine(rig.structure, sensors, {});
  for (std::size_t i = 0; i < views.size(); ++i) {
    const PoseError error =
        ComparePoses(result.sensors[i].structure_from_sensor, *rig.frames[i].ground_truth);
    EXPECT_TRUE(result.sensors[i].accepted);
    EXPECT_FALSE(!(error.translation_m < 1e-3)) << i << ": " << error.translation_m;
    EXPECT_FALSE(!(error.rotation_deg < 0.05)) << i << ": " << error.rotation_deg;
  }
  // Neighbours on the ring see the same sides.
  int neighbours = 0;
  for (const RefinedPair& pair : result.pairs) {
    const int step = pair.b - pair.a;
    if (step != 1 && step != 7) continue;
    ++neighbours;
    EXPECT_GT(pair.overlap, 0.3);
    EXPECT_LT(pair.rms, 1e-3);
  }
  EXPECT_EQ(neighbours, 8);
}

TEST(Refine, OverlapAloneBringsASensorBack) {
  const Rig rig = RingOfEight();
  const std::vector<RefineView> views = Views(rig);
  for (const std::size_t lost : {0, 3, 6}) {
    std::vector<RefineSensor> sensors;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Pose& truth = *rig.frames[i].ground_truth;
      const Pose start = i == lost ? Displaced(truth, 0.03, 2, 100 + lost) : truth;
      sensors.push_back({&views[i], start, start, i != lost});
    }
    const RefineResult result = Refine(rig.structure, sensors, {});
    const PoseError error =
        ComparePoses(result.sensors[lost].structure_from_sensor, *rig.frames[lost].ground_truth);
    EXPECT_TRUE(result.sensors[lost].accepted) << lost;
    EXPECT_FALSE(!(error.translation_m < 5e-3)) << lost << ": " << error.translation_m;
    EXPECT_FALSE(!(error.rotation_deg < 0.2)) << lost << ": " << error.rotation_deg;
  }
}

TEST(Refine, FiniteSidesKeepParallelSidesFromSliding) {
  // Head on, every labelled side has one direction: infinite planes would leave the in-plane shift
  // of 3 cm where it is.
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("A", RingPose(90, 2.0, 0.35));
  for (std::uint8_t& label : rig.labels[0]) {
    if (label && rig.structure.SideOfLabel(label).face != Face::kRight) label = 0;
  }
  const std::vector<RefineView> views = Views(rig);
  const Pose& truth = *rig.frames[0].ground_truth;
  for (const Eigen::Vector3d& shift :
       {Eigen::Vector3d(0.03, 0, 0), Eigen::Vector3d(-0.02, 0.02, 0)}) {
    Pose start = truth;
    start.translation() += shift;
    const RefineResult result = Refine(rig.structure, {{&views[0], start, start, true}}, {});
    const PoseError error = ComparePoses(result.sensors[0].structure_from_sensor, truth);
    EXPECT_FALSE(!(error.translation_m < 2e-3)) << error.translation_m;
  }
}

TEST(Refine, FindsADepthOffset) {
  // 8 mm too far all over, in one sensor of eight: a step back explains its faces, but neither
  // silhouettes nor neighbours.
  Rig rig = RingOfEight({true, 3.5});
  for (float& z : rig.frames[3].depth) {
    if (z > 0) z += 0.008f;
  }
  const std::vector<RefineView> views = Views(rig);
  std::vector<RefineSensor> sensors;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.01, 0.5, i);
    sensors.push_back({&views[i], start, start, true});
  }
  const RefineResult result = Refine(rig.structure, sensors, {});
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_NEAR(result.sensors[i].depth_offset, i == 3 ? -0.008 : 0, 2e-3) << i;
    EXPECT_LT(ComparePoses(result.sensors[i].structure_from_sensor, *rig.frames[i].ground_truth)
                  .translation_m,
              2e-3)
        << i;
  }
  RefineOptions trusting;
  trusting.depth_offset_sigma_m = 0;
  const RefinedSensor without = Refine(rig.structure, sensors, trusting).sensors[3];
  EXPECT_EQ(without.depth_offset, 0);
  EXPECT_GT(ComparePoses(without.structure_from_sensor, *rig.frames[3].ground_truth).translation_m,
            4e-3);
}

TEST(Refine, NeverWorse) {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("A", RingPose(40));
  rig.Add("B", RingPose(85));
  std::vector<RefineView> views = Views(rig);
  // What the solution sees is 2 cm off; what it is judged by is not.
  for (SidePoint& point : views[0].side_points) {
    if (!point.held_out) point.p.z() += 0.02;
  }
  std::vector<RefineSensor> sensors;
  for (std::size_t i = 0; i < 2; ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.001, 0.02, i);
    sensors.push_back({&views[i], start, start, true});
  }
  const RefineResult result = Refine(rig.structure, sensors, {});
  EXPECT_FALSE(result.sensors[0].accepted);
  EXPECT_TRUE(result.sensors[0].structure_from_sensor.isApprox(sensors[0].initial, 1e-12));
  EXPECT_DOUBLE_EQ(result.sensors[0].held_out_after, result.sensors[0].held_out_before);
  EXPECT_TRUE(result.sensors[1].accepted);
  EXPECT_LT(result.sensors[1].held_out_after, result.sensors[1].held_out_before);
  EXPECT_LT(ComparePoses(result.sensors[1].structure_from_sensor, *rig.frames[1].ground_truth)
                .translation_m,
            2e-3);
}

TEST(Refine, CovarianceIsThatOfRepeatedMeasurements) {
  // Monte Carlo: 30 frames with fresh white noise. The design effect can only widen what Ceres
  // says.
  Rig rig{PaperStructure(), {}, {}};
  const Pose truth = RingPose(35);
  rig.Add("A", truth);
  const DepthImage clean = rig.frames[0].depth;
  RefineOptions options;
  options.max_overlap_points = 0;
  Vector6d squares = Vector6d::Zero(), predicted = Vector6d::Zero();
  constexpr int kFrames = 30;
  for (int i = 0; i < kFrames; ++i) {
    rig.frames[0].depth = clean;
    AddNoise(&rig.frames[0].depth, 0.004, static_cast<std::uint64_t>(i));
    const std::vector<RefineView> views = Views(rig);
    const Pose start = Displaced(truth, 0.01, 0.5, static_cast<std::uint64_t>(i));
    const RefinedSensor sensor =
        Refine(rig.structure, {{&views[0], start, start, true}}, options).sensors[0];
    const Pose difference = sensor.structure_from_sensor * truth.inverse();
    Vector6d delta;
    delta << difference.translation(), RotationLog(difference.linear());
    squares += delta.cwiseAbs2() / kFrames;
    predicted += sensor.covariance.diagonal() / kFrames;
    EXPECT_TRUE(sensor.covariance.isApprox(sensor.covariance.transpose(), 1e-9));
    EXPECT_EQ(Eigen::LLT<Matrix6d>(sensor.covariance).info(), Eigen::Success);
  }
  for (int k = 0; k < 6; ++k) {
    const double ratio = std::sqrt(predicted[k] / squares[k]);
    EXPECT_FALSE(!(ratio > 0.6 && ratio < 4))
        << "component " << k << ": predicted/actual = " << ratio;
  }
}

}  // namespace
}  // namespace volalign
