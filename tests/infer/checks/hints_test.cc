#include "infer/checks/hints.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::hints_test {
namespace {

/// Labels in a rectangle of a 64x48 image.
LabelImage Marked(int u0, int u1, int v0, int v1) {
  LabelImage labels(64, 48);
  for (const auto [u, v] : Pixels({u0, v0}, {u1, v1})) labels(u, v) = 3;
  return labels;
}

TEST(MoveHint, SendsTheSensorTowardsWhatTheBorderCutsOff) {
  struct Case {
    LabelImage labels;
    const char* upright;   // no turn: the stored image is upright
    const char* one_turn;  // clockwise: its left border is the top
  };
  for (const Case& c : {Case{Marked(0, 20, 15, 35), "to the left", "up"},
                        Case{Marked(20, 40, 0, 20), "up", "to the right"},
                        Case{Marked(44, 64, 15, 35), "to the right", "down"},
                        Case{Marked(20, 40, 28, 48), "down", "to the left"}}) {
    const std::string upright = std::string("turn the sensor ") + c.upright + ",";
    EXPECT_NE(MoveHint(c.labels, 0).find(upright), std::string::npos) << MoveHint(c.labels, 0);
    const std::string turned = std::string("turn the sensor ") + c.one_turn + ",";
    EXPECT_NE(MoveHint(c.labels, 1).find(turned), std::string::npos) << MoveHint(c.labels, 1);
  }
}

TEST(MoveHint, NamesNoDirectionThatItDoesNotKnow) {
  // Cut on two sides; cut where nothing tells which way up the image is; not cut at all.
  const std::string further = "move the sensor further away";
  EXPECT_NE(MoveHint(Marked(0, 64, 15, 35), 0).find(further), std::string::npos);
  EXPECT_NE(MoveHint(Marked(0, 20, 15, 35), std::nullopt).find(further), std::string::npos);
  EXPECT_NE(MoveHint(Marked(20, 40, 15, 35), 0).find("round the structure"), std::string::npos);
}

TEST(UprightTurnsOfNetwork, TheMajorityOfPlacedSensorsDecides) {
  EXPECT_FALSE(UprightTurnsOfNetwork({}).has_value());
  // A sensor on its side is upright after one turn; a network that saw it after one turn sees
  // upright images.
  const Pose on_its_side = testing_infer::RingPose(30),
             upright = testing_infer::RingPose(30, 2.0, 0.4, 0);
  EXPECT_EQ(UprightTurns(upright), 0);
  const int side = UprightTurns(on_its_side);
  EXPECT_EQ(UprightTurnsOfNetwork({{on_its_side, side}}), 0);
  EXPECT_EQ(UprightTurnsOfNetwork({{on_its_side, 0}, {upright, 3}, {upright, (4 - side) % 4}}),
            side);
}

}  // namespace
}  // namespace volalign::hints_test
