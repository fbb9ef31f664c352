#include "infer/evaluate/suite/graph_icp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::graph_icp_test {
namespace {

using testing_infer::Rig;
using testing_infer::RingPose;

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
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) rig.Add("S" + std::to_string(i), RingPose(90.0 * i + 45, 2.0, 1.0));
  const Perturbed start = Perturb(rig, 0.04, 0.02, 1);
  const std::vector<Pose> poses = RefineGraph(rig.structure, start.graph);
  ASSERT_EQ(poses.size(), 4u);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const PoseError before =
        ComparePoses(start.graph[i].structure_from_sensor, *rig.frames[i].ground_truth);
    const PoseError after = ComparePoses(poses[i], *rig.frames[i].ground_truth);
    EXPECT_GT(before.translation_m, 0.01);
    EXPECT_LT(after.translation_m, 0.003) << i;
    EXPECT_LT(after.rotation_deg, 0.1) << i;
  }
}

// What two views see of the same places tells how they stand to one another, beside what each sees
// of the structure.
TEST(GraphIcp, JoinsViewsThatOverlap) {
  double apart_m = 0, joined_m = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Rig rig{testing_infer::PaperStructure(), {}, {}};
    rig.Add("A", RingPose(90 * static_cast<double>(seed) + 25, 2.0, 1.0));
    rig.Add("B", RingPose(90 * static_cast<double>(seed) + 65, 2.0, 1.0));
    for (std::size_t i = 0; i < 2; ++i)
      testing_infer::AddSmoothError(&rig.frames[i].depth, 0.004, 20, 2 * seed + i);
    const Perturbed start = Perturb(rig, 0.03, 0.02, seed);
    GraphIcpOptions alone;
    alone.min_overlap = 1;  // no pair reaches it
    const auto between = [&](const std::vector<Pose>& poses) {
      const Pose& a = *rig.frames[0].ground_truth;
      const Pose& b = *rig.frames[1].ground_truth;
      return ComparePoses(poses[0].inverse() * poses[1], a.inverse() * b).translation_m;
    };
    const std::vector<Pose> joined = RefineGraph(rig.structure, start.graph);
    apart_m += between(RefineGraph(rig.structure, start.graph, alone)) / 8;
    joined_m += between(joined) / 8;
    for (std::size_t i = 0; i < 2; ++i)
      EXPECT_LT(ComparePoses(joined[i], *rig.frames[i].ground_truth).translation_m, 0.025);
  }
  EXPECT_LT(joined_m, apart_m);  // 11.7 and 13.3 mm
}

TEST(GraphIcp, AViewWithoutPointsStaysWhereItIs) {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  rig.Add("A", RingPose(0));
  Perturbed start = Perturb(rig, 0.03, 0.02, 5);
  std::fill(start.views[0].depth.begin(), start.views[0].depth.end(), 0.0f);
  const std::vector<Pose> poses = RefineGraph(rig.structure, start.graph);
  EXPECT_LT(ComparePoses(poses[0], start.graph[0].structure_from_sensor).translation_m, 1e-9);
  EXPECT_TRUE(RefineGraph(rig.structure, {}).empty());
}

}  // namespace
}  // namespace volalign::graph_icp_test
