#include "infer/joint_solution.h"

#include <gtest/gtest.h>

#include <utility>
#include <variant>
#include <vector>

#include "tests/infer/pose/geometry_frames.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// Three sensors that see the structure from one place: two that geometry has placed, of which the
/// joint solution takes the second half a metre away, and one that a network has placed, which it
/// takes there as well.
class WithoutShape : public testing::Test {
 protected:
  void SetUp() override {
    Pose away = truth_;
    away.translation().x() += 0.5;
    StillStages still;
    for (const bool geometry : {true, true, false}) {
      still.views.push_back(testing_infer::See(structure_, truth_));
      PlacedSensor placed;
      if (geometry) placed.visible_by_geometry = 1;
      still.placements.emplace_back(std::move(placed));
    }
    stages_.push_back(std::move(still));
    refined_.placements.push_back({Pose::Identity(), {}, {}, structure_});
    for (const Pose& pose : {truth_, away, away}) {
      refined_.frames.emplace_back();
      refined_.frames.back().structure_from_sensor = pose;
    }
  }

  bool IsPlaced(std::size_t sensor) const {
    return std::holds_alternative<PlacedSensor>(stages_[0].placements[sensor]);
  }

  const Structure structure_ = PaperStructure();
  const Pose truth_ = RingPose(40);
  const InitialPoseOptions initial_{};
  const RefineOptions refine_{};
  const VerdictOptions verdict_{};
  const AssemblyOptions assembly_{};
  const PlacementOptions options_{initial_, refine_, verdict_, assembly_};
  std::vector<StillStages> stages_;
  RefineResult refined_;
};

TEST_F(WithoutShape, ASensorThatGeometryAlonePlacedIsDropped) {
  EXPECT_TRUE(DropWithoutShape(refined_, options_, &stages_));
  EXPECT_TRUE(IsPlaced(0));
  ASSERT_FALSE(IsPlaced(1));
  EXPECT_EQ(std::get<Finding>(stages_[0].placements[1]).code, SensorCode::kNoStructure);
  EXPECT_TRUE(IsPlaced(2));
}

// Frames are those of the placed sensors alone.
TEST_F(WithoutShape, SensorsThatAreNotPlacedHaveNoFrame) {
  stages_[0].placements[0] = Finding();
  refined_.frames.erase(refined_.frames.begin());
  refined_.frames[0].structure_from_sensor = truth_;
  EXPECT_FALSE(DropWithoutShape(refined_, options_, &stages_));
  EXPECT_TRUE(IsPlaced(1));
}

}  // namespace
}  // namespace volalign
