#include "core/geometry/stack_faults.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::stack_faults_test {
namespace {

Box MakeBox(const std::string& name, const Eigen::Vector3d& min, const Eigen::Vector3d& max,
            double yaw = 0) {
  Box box = Box::FromMinMax(name, min, max);
  box.structure_from_box.linear() = RotationExp(yaw * Eigen::Vector3d::UnitY());
  return box;
}

const Box kLow = MakeBox("low", {-0.3, 0, -0.2}, {0.3, 0.4, 0.2});

std::vector<StackFault> FaultsOf(const std::vector<Box>& boxes) {
  return FindStackFaults(Structure::FromBoxes("stack", boxes));
}

/// One fault, which has all of the parts.
void ExpectFault(const std::vector<Box>& boxes, bool impossible,
                 const std::vector<std::string>& parts) {
  const std::vector<StackFault> faults = FaultsOf(boxes);
  ASSERT_EQ(faults.size(), 1u);
  EXPECT_EQ(faults[0].impossible, impossible);
  for (const std::string& part : parts)
    EXPECT_NE(faults[0].text.find(part), std::string::npos) << faults[0].text;
}

TEST(FindStackFaults, StacksThatStandHaveNone) {
  EXPECT_TRUE(FindStackFaults(ReadStructure("configs/structure.yaml")).empty());
  // Measured to a few millimetres, above and below; turned; a bridge over two; side by side.
  EXPECT_TRUE(FaultsOf({kLow, MakeBox("a", {-0.2, 0.404, -0.2}, {0.2, 0.7, 0.2}, 0.4)}).empty());
  EXPECT_TRUE(FaultsOf({kLow, MakeBox("a", {-0.2, 0.396, -0.2}, {0.2, 0.7, 0.2})}).empty());
  const Box far = MakeBox("far", {0.7, 0, -0.2}, {1.2, 0.4, 0.2});
  EXPECT_TRUE(FaultsOf({kLow, far, MakeBox("a", {0.1, 0.4, -0.1}, {0.9, 0.6, 0.1})}).empty());
  EXPECT_TRUE(FaultsOf({kLow, MakeBox("a", {0.303, 0, -0.2}, {0.9, 0.4, 0.2})}).empty());
  // What it carries holds a box whose middle is over nothing.
  EXPECT_TRUE(FaultsOf({kLow, MakeBox("out", {0.2, 0.4, -0.2}, {0.9, 0.6, 0.2}),
                        MakeBox("heavy", {0.2, 0.6, -0.2}, {0.6, 1, 0.2})})
                  .empty());
}

TEST(FindStackFaults, BoxesShareNoSpace) {
  ExpectFault({kLow, MakeBox("a", {-0.2, 0.38, -0.2}, {0.2, 0.7, 0.2})}, false,
              {"'low' and 'a' share space, 20 mm deep"});
  ExpectFault({kLow, MakeBox("again", {-0.3, 0, -0.2}, {0.3, 0.4, 0.2})}, true, {"400 mm deep"});
  ExpectFault({kLow, MakeBox("within", {-0.1, 0.1, -0.1}, {0.1, 0.3, 0.1})}, true, {"'within'"});
  // Turned by 45 deg, the corner of one is in the other; their bounding boxes overlap far more.
  ExpectFault({kLow, MakeBox("turned", {0.4, 0, -0.2}, {0.8, 0.4, 0.2}, M_PI / 4)}, false,
              {"gap of 17 mm"});
  ExpectFault({kLow, MakeBox("turned", {0.36, 0, -0.2}, {0.76, 0.4, 0.2}, M_PI / 4)}, false,
              {"share space, 23 mm deep"});
  ExpectFault({kLow, MakeBox("turned", {0.3, 0, -0.2}, {0.7, 0.4, 0.2}, M_PI / 4)}, true,
              {"share space, 83 mm deep"});
}

TEST(FindStackFaults, EveryBoxStandsOnSomething) {
  ExpectFault({kLow, MakeBox("a", {-0.2, 0.42, -0.2}, {0.2, 0.7, 0.2})}, false,
              {"'a' stands on nothing", "20 mm above box 'low'"});
  ExpectFault({kLow, MakeBox("a", {-0.2, 0.48, -0.2}, {0.2, 0.7, 0.2})}, true,
              {"'a' stands on nothing", "80 mm above box 'low'"});
  ExpectFault({kLow, MakeBox("a", {1, 0.6, -0.2}, {1.4, 0.9, 0.2})}, true,
              {"600 mm above the floor"});
  ExpectFault({kLow, MakeBox("a", {0.1, 0.4, -0.2}, {0.9, 0.7, 0.2})}, false,
              {"'a' would fall", "200 mm beyond"});
  ExpectError<DataError>(
      [] {
        RequireStack(
            Structure::FromBoxes("s", {kLow, MakeBox("a", {1, 0.6, -0.2}, {1.4, 0.9, 0.2})}));
      },
      {"'a' stands on nothing"});
}

TEST(FindStackFaults, DoubtsGapsAndUnits) {
  ExpectFault({kLow, MakeBox("a", {0.32, 0, -0.2}, {0.9, 0.4, 0.2})}, false,
              {"gap of 20 mm between boxes 'low' and 'a'"});
  ExpectFault({MakeBox("cm", {0, 0, 0}, {0.04, 0.03, 0.05})}, false, {"40 x 30 x 50 mm", "unit"});
  ExpectFault({MakeBox("large", {0, 0, 0}, {40, 3, 5})}, false, {"unit"});
}

TEST(ReadStructureYaml, RefusesAStackThatCannotBe) {
  const TempFolder folder;
  folder.Write("s.yaml",
               "boxes:\n  - {name: a, x: [0, 500], y: [0, 400], z: [0, 300]}\n"
               "  - {name: b, x: [0, 500], y: [1000, 1400], z: [0, 300]}\n");
  ExpectError<ConfigError>([&] { ReadStructure((folder / "s.yaml").string()); },
                           {"s.yaml: box 'b' stands on nothing", "600 mm above box 'a'"});
}

}  // namespace
}  // namespace volalign::stack_faults_test
