// What a user's room does to the search for a first pose by geometry: whatever is found has to be
// the true pose, or one of several that the sensor is then ambiguous between.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::geometry_situations_test {
namespace {

using namespace testing_infer;

/// From where something near hides a part of the picture.
enum class From { kLeft, kRight, kBelow };

/// Puts a board 0.6 m before the sensor, whose picture lies on its side with +x down, so that it
/// hides a share of the structure's pixels.
void Hide(double share, From from, SyntheticView* view) {
  const bool columns = from == From::kBelow;
  std::vector<int> at;
  for (const auto [u, v] : Pixels(view->depth)) {
    if (view->labels(u, v) > 0) at.push_back(columns ? u : v);
  }
  ASSERT_FALSE(at.empty());
  std::sort(at.begin(), at.end());
  const bool from_zero = from == From::kLeft;
  const auto edge = static_cast<double>(at.size() - 1) * (from_zero ? share : 1 - share);
  const int limit = at[static_cast<std::size_t>(edge)];
  for (const auto [u, v] : Pixels(view->depth)) {
    const int place = columns ? u : v;
    if (from_zero ? place >= limit : place <= limit) continue;
    view->depth(u, v) = 0.6f;
    view->labels(u, v) = 0;
  }
}

SensorView Measured(SyntheticView view) {
  AddNoise(&view.depth, 0.005, 1);
  return MakeSensorView(view.depth, Kinect());
}

/// A pose that is chosen without a rival is the true one: to 5 cm and 2 deg, or, where a sensor
/// sees too little for that, to what still counts as the same place (10 cm, 5 deg).
void ExpectNotWrong(const PoseChoice& choice, const Pose& truth, bool sees_little = false) {
  if (!choice.found || choice.ambiguous) return;
  if (!sees_little) return ExpectChosen(choice, truth);
  EXPECT_TRUE(Within(ComparePoses(choice.best.structure_from_sensor, truth), 0.1, 5));
}

TEST(Situations, HalfHidden) {
  std::map<double, int> chosen;  // of nine each; found: 9, 7, 6
  for (const std::uint64_t seed : {0, 1, 2}) {
    const Structure structure = seed == 0 ? PaperStructure() : RandomStack(seed);
    const double y = structure.FloorHeight() + structure.Height() / 2;
    const Pose truth = RingPose(35.0 + 70 * static_cast<double>(seed), 2.2, y + 0.5, 90, {0, y, 0});
    for (const From from : {From::kLeft, From::kRight, From::kBelow}) {
      for (const double share : {0.15, 0.35, 0.6}) {
        SCOPED_TRACE(std::to_string(seed) + ", from " + std::to_string(static_cast<int>(from)) +
                     ": " + std::to_string(share));
        SyntheticView seen = Render(structure, Kinect(), truth, {true, 3.5});
        Hide(share, from, &seen);
        const SensorView view = Measured(seen);
        const PoseChoice choice = Choose(view, structure);
        ExpectNotWrong(choice, truth, share > 0.5);
        chosen[share] += choice.found && !choice.ambiguous;
        if (share < 0.2) {
          EXPECT_TRUE(Contains(Find(view, structure), truth));
        }
      }
    }
  }
  EXPECT_GE(chosen[0.15], 8);
  EXPECT_GE(chosen[0.35], 6);
  EXPECT_GE(chosen[0.6], 5);
}

// A sensor that stands near shows a part of the stack only: under a fifth of its surface.
TEST(Situations, CutByThePicturesBorder) {
  const Structure structure = PaperStructure();
  int found = 0;
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i, 1.5, 0.55, 0, {0.1 * (i % 3), -0.15, 0.1});
    const SensorView view = Measured(Render(structure, Kinect(), truth, {true, 3.5}));
    ExpectNotWrong(Choose(view, structure), truth);
    found += Contains(Find(view, structure), truth);
  }
  EXPECT_GE(found, 7);
}

TEST(Situations, AFloorThatIsUnevenByTwoCentimetres) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 4; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(20.0 + 90 * i, 2.2, 0.4);
    SyntheticView seen = Render(structure, Kinect(), truth, {true, 3.5});
    const SensorView exact = MakeSensorView(seen.depth, Kinect());
    for (const auto [u, v] : Pixels(exact)) {
      if (seen.labels(u, v) > 0 || !(exact.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = truth * exact.Point(u, v);
      const double fall = truth.translation().y() - p.y();
      if (p.y() > structure.FloorHeight() + 0.001 || !(fall > 0.1)) continue;
      // Along the ray, so that the floor is higher by this.
      const double bump = 0.02 * std::sin(7 * p.x()) * std::cos(6 * p.z() + 1);
      seen.depth(u, v) *= static_cast<float>(1 - bump / fall);
    }
    ExpectChosen(Choose(Measured(seen), structure), truth);
  }
}

}  // namespace
}  // namespace volalign::geometry_situations_test
