#include "infer/stack/suggest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::suggest_test {
namespace {

TEST(ParseBoxes, ReadsNumbersAndEdges) {
  const auto sizes = ParseBoxes("2x 600x400x300,  400 x 300.5 x 250");
  ASSERT_EQ(sizes.size(), 3u);
  EXPECT_TRUE(sizes[0].isApprox(Eigen::Vector3d(0.6, 0.4, 0.3)));
  EXPECT_TRUE(sizes[1].isApprox(Eigen::Vector3d(0.6, 0.4, 0.3)));
  EXPECT_TRUE(sizes[2].isApprox(Eigen::Vector3d(0.4, 0.3005, 0.25)));
  for (const char* text : {"", "600x400", "two 600x400x300", "600x400x300;400x300x250", "0x",
                           "3x 600x400x-300", "52x 100x100x100", "0x 100x100x100"}) {
    EXPECT_THROW(ParseBoxes(text), DataError) << text;
  }
  EXPECT_EQ(ParseBoxes(" 3 x\t600x 400 x300 ").size(), 3u);
  for (const char* text :
       {"3x600x400x300", "600x400x", "600x400x300.", "600x400x.5", "600 0x400x300",
        "1234567x400x300", "12345x 600x400x300", "600x400x3e2", "1x 1x 1x 1x 1"}) {
    EXPECT_THROW(ParseBoxes(text), DataError) << text;
  }
}

// A std::regex, which goes as deep as its text is long, ended the program here.
TEST(ParseBoxes, TakesTextsOfAnyLength) {
  EXPECT_EQ(ParseBoxes(std::string(500000, ' ') + "600x400x300").size(), 1u);
  EXPECT_THROW(ParseBoxes(std::string(500000, ' ')), DataError);
  EXPECT_THROW(ParseBoxes("600x400x300." + std::string(500000, '1') + "e"), DataError);
}

// The joints of the paper's stack by hand: the upper three boxes' middle is 127.5 mm inside the
// joint's edge and 607.5 mm above it, the upper two 106.25 inside ... : the least angle counts.
TEST(TiltOfTower, IsThatOfTheWeakestJoint) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const auto deg = [](double inside, double above) {
    return std::atan2(inside, above) * 180 / M_PI;
  };
  // Middles of boxes along x: -2.5, -115, -227.5, -115; along z: 0, -112.5, 0, 112.5.
  // Joints: x -280..275, z -165..165 (floor); x -280..50, z -165..165 (three times).
  const double floor = deg(280 - 115, 810);
  const double first = deg(280 - (115 + 227.5 + 115) / 3, 607.5);
  const double second = deg(std::min(280 - (227.5 + 115) / 2, 165 - 112.5 / 2), 405);
  const double third = deg(165 - 112.5, 202.5);
  EXPECT_NEAR(TiltOfTower(structure.boxes()), std::min({floor, first, second, third}), 1e-6);
  EXPECT_GT(TiltOfTower(structure.boxes()), SuggestOptions().tilt_deg);
}

TEST(TiltOfTower, IsNegativeForATowerThatFalls) {
  EXPECT_LT(TiltOfTower({Box::FromMinMax("a", {0, 0, 0}, {0.4, 0.4, 0.4}),
                         Box::FromMinMax("b", {0.3, 0.4, 0}, {0.9, 0.8, 0.4})}),
            0);
}

int Alike(const TargetQuality& quality) {
  return static_cast<int>(
      std::count_if(quality.views.begin(), quality.views.end(),
                    [](const TargetView& view) { return !view.look_alike.empty(); }));
}

// A straight column of equal cartons looks the same after half a turn. The suggestion has no view
// that another pose shares, even without the floor, though it was measured from other places.
TEST(SuggestStack, EqualCartonsGetAStackWithoutAnAlternative) {
  SuggestOptions options;
  options.candidates = 8;
  const SuggestedStack suggested = SuggestStack("cartons", ParseBoxes("3x 600x400x350"), options);
  EXPECT_EQ(Alike(suggested.quality), 0);
  for (const TargetView& view : suggested.quality.views) EXPECT_TRUE(view.sides_fix_pose);
  EXPECT_GE(suggested.tilt_deg, options.tilt_deg);
  EXPECT_LE(suggested.structure.Height(), options.height_m);

  std::vector<Box> column;
  for (int i = 0; i < 3; ++i) {
    column.push_back(
        Box::FromMinMax(std::to_string(i), {-0.3, 0.35 * i, -0.2}, {0.3, 0.35 * (i + 1), 0.2}));
  }
  const TargetQuality of_column = MeasureTarget(Structure::FromBoxes("column", column));
  EXPECT_EQ(Alike(of_column), static_cast<int>(of_column.views.size()));
}

TEST(SuggestStack, UsesEveryBoxOnceAndTheLargestBelow) {
  SuggestOptions options;
  options.candidates = 2;
  const auto sizes = ParseBoxes("400x300x250, 600x400x300");
  const std::vector<Box> boxes = SuggestStack("two", sizes, options).structure.boxes();
  ASSERT_EQ(boxes.size(), 2u);
  const auto sorted = [](Eigen::Vector3d size) {
    std::sort(size.data(), size.data() + 3);
    return size;
  };
  EXPECT_TRUE(sorted(boxes[0].size).isApprox(Eigen::Vector3d(0.3, 0.4, 0.6)));
  EXPECT_TRUE(sorted(boxes[1].size).isApprox(Eigen::Vector3d(0.25, 0.3, 0.4)));
  const auto edge = [&](int box, double sign, int axis) {
    const Box& b = boxes[static_cast<std::size_t>(box)];
    return b.structure_from_box.translation()[axis] + sign * b.size[axis] / 2;
  };
  for (const int axis : {0, 2}) {  // overhangs are whole centimetres on one side of each axis
    const double cm = 100 * (edge(1, 1, axis) - edge(0, 1, axis));
    EXPECT_NEAR(cm, std::round(cm), 1e-6);
  }
}

TEST(SuggestStack, IsTheSameOnAnyNumberOfThreadsAndFromItsFile) {
  SuggestOptions options;
  options.candidates = 3;
  const auto sizes = ParseBoxes("2x 500x400x300");
  const SuggestedStack once = SuggestStack("two", sizes, options);
  options.threads = 3;
  const SuggestedStack again = SuggestStack("two", sizes, options);
  EXPECT_EQ(once.structure.Hash(), again.structure.Hash());
  const TempFolder folder;
  WriteFileAtomically(folder.path() / "two.yaml", StructureYaml(once.structure));
  const Structure read = ReadStructure((folder.path() / "two.yaml").string());
  EXPECT_EQ(read.Hash(), once.structure.Hash());
  EXPECT_EQ(read.name(), "two");
}

TEST(SuggestStack, SaysWhyThereIsNone) {
  try {
    SuggestStack("high", ParseBoxes("9x 400x300x250"));
    FAIL();
  } catch (const DataError& e) {
    EXPECT_NE(std::string(e.what()).find("2.25 m high even if all lie flat"), std::string::npos);
  }
  SuggestOptions options;
  options.candidates = 2;
  options.height_m = 3;
  EXPECT_THROW(SuggestStack("narrow", ParseBoxes("9x 400x100x100, 5x 300x300x300"), options),
               DataError);
}

}  // namespace
}  // namespace volalign::suggest_test
