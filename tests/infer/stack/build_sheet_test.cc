#include "infer/stack/build_sheet.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "infer/stack/suggest.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/mesh_shapes.h"

namespace volalign::build_sheet_test {
namespace {

struct Text {
  std::string words;
  double left, right, top, bottom;
};

/// Every text of the SVG with the room that it takes in DejaVu Sans, at least. Without the numbers
/// on the drawn sides, which other boxes may hide.
std::vector<Text> TextsOf(const std::string& svg) {
  static const std::regex kText("<text x=\"([-0-9.]+)\" y=\"([-0-9.]+)\"([^>]*)>([^<]*)</text>"),
      kSize("font-size=\"([0-9.]+)\"");
  std::vector<Text> texts;
  for (std::sregex_iterator it(svg.begin(), svg.end(), kText), end; it != end; ++it) {
    const std::string attributes = (*it)[3], words = (*it)[4];
    if (Has(attributes, "class=\"number\"")) continue;
    std::smatch found;
    const double size = std::regex_search(attributes, found, kSize) ? std::stod(found[1]) : 13;
    const auto letters = std::count_if(words.begin(), words.end(), [](char c) {
      return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
    });
    const double width = 0.45 * size * static_cast<double>(letters);
    const double x = std::stod((*it)[1]), y = std::stod((*it)[2]);
    const double left = attributes.find("\"end\"") != std::string::npos      ? x - width
                        : attributes.find("\"middle\"") != std::string::npos ? x - width / 2
                                                                             : x;
    texts.push_back({words, left, left + width, y - 0.7 * size, y});
  }
  return texts;
}

void ExpectNoOverlap(const Structure& structure) {
  const std::vector<Text> texts = TextsOf(BuildSheet(structure));
  ASSERT_GT(texts.size(), 8 * structure.boxes().size());
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const Text& a = texts[i];
    EXPECT_TRUE(a.left >= 0 && a.right <= 794 && a.top >= 0 && a.bottom <= 1123) << a.words;
    for (std::size_t j = 0; j < i; ++j) {
      const Text& b = texts[j];
      EXPECT_TRUE(a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top)
          << structure.name() << ": '" << a.words << "' lies over '" << b.words << "'";
    }
  }
}

Structure Grid(int boxes, const std::string& name) {
  std::vector<Box> all;
  for (int i = 0; i < boxes; ++i) {
    const int layer = i / 6, row = i / 3 % 2;
    const Eigen::Vector3d at(0.42 * (i % 3), 0.3 * layer, 0.32 * row + 0.013 * i);
    all.push_back(
        Box::FromMinMax(fmt::format("{}_{}", name, i), at, at + Eigen::Vector3d(0.4, 0.3, 0.3)));
  }
  return Structure::FromBoxes(name, all);
}

TEST(BuildSheet, NoTextLiesOverAnother) {
  ExpectNoOverlap(ReadStructure("configs/structure.yaml"));
  for (const int boxes : {1, 2, 3, 7, 12, 20, 51}) ExpectNoOverlap(Grid(boxes, "carton"));
  ExpectNoOverlap(Grid(4, std::string(90, 'w')));
  std::vector<Box> tower;
  for (int i = 0; i < 8; ++i)
    tower.push_back(Box::FromMinMax(fmt::format("t{}", i), {0.01 * i, 0.4 * i, 0},
                                    {0.3, 0.4 * (i + 1), 0.2 + 0.03 * i}));
  ExpectNoOverlap(Structure::FromBoxes("tower", tower));
}

TEST(BuildSheet, NamesATurnAndABoxInTheAir) {
  Box turned = Box::FromMinMax("turned", {0, 0.25, 0}, {0.4, 0.5, 0.4});
  turned.structure_from_box.linear() = RotationExp(-0.25 * Eigen::Vector3d::UnitY());
  const std::string svg = BuildSheet(
      Structure::FromBoxes("two", {Box::FromMinMax("base", {0, 0, 0}, {0.5, 0.2, 0.5}), turned}));
  EXPECT_TRUE(Has(svg, ">on nothing (check y), 14.3° clockwise<"));
}

// From two sides, three sides of each box.
TEST(BuildSheet, EveryDrawnSideHasItsBoxesNumber) {
  const std::string svg = BuildSheet(Grid(12, "carton"));
  for (int box = 1; box <= 12; ++box) {
    const std::regex number(fmt::format("class=\"number\">{}<", box));
    const std::sregex_iterator first(svg.begin(), svg.end(), number), end;
    EXPECT_EQ(std::distance(first, end), 6) << box;
  }
}

// It says how the paper's stack is built.
TEST(BuildSheet, IsThePictureOfTheReadme) {
  EXPECT_TRUE(BuildSheet(ReadStructure("configs/structure.yaml")) ==
              ReadFile("docs/build.svg", kMaxTextBytes))
      << "volalign structure sheet configs/structure.yaml -o docs/build.svg";
}

void ExpectOverhang(const Overhang& overhang, double front, double back, double right,
                    double left) {
  EXPECT_NEAR(overhang.front, front, 1e-9);
  EXPECT_NEAR(overhang.back, back, 1e-9);
  EXPECT_NEAR(overhang.right, right, 1e-9);
  EXPECT_NEAR(overhang.left, left, 1e-9);
}

// Two feet and a bridge, written from the top downwards; the bridge lies on the right foot for 250
// x 300 mm, on the left one for 250 x 250 mm.
TEST(BuildSteps, ABoxOnTwoComesAfterThem) {
  const Structure structure =
      Structure::FromBoxes("table", {Box::FromMinMax("bridge", {0, 0.3, -0.45}, {0.25, 0.5, 0.5}),
                                     Box::FromMinMax("left", {0, 0, -0.5}, {0.3, 0.3, -0.2}),
                                     Box::FromMinMax("right", {-0.05, 0, 0.2}, {0.25, 0.3, 0.6})});
  const std::vector<BuildStep> steps = BuildSteps(structure);
  ASSERT_EQ(steps.size(), 3u);
  EXPECT_EQ(steps[0].box, 1);
  EXPECT_EQ(steps[1].box, 2);
  EXPECT_EQ(steps[2].box, 0);
  EXPECT_EQ(steps[2].on, (std::vector<int>{2, 1}));
  ExpectOverhang(steps[2].overhang, 0, -0.05, -0.1, 0.65);
  ExpectOverhang(steps[1].overhang, -0.05, 0.05, 0.8, -0.7);  // over the first box on the floor
}

TEST(BuildSteps, ATurnedBoxHasItsOwnEdges) {
  Box turned = Box::FromMinMax("turned", {-0.1, 0.2, -0.3}, {0.1, 0.3, 0.3});
  turned.structure_from_box.linear() = RotationExp(M_PI / 6 * Eigen::Vector3d::UnitY());
  const std::vector<BuildStep> steps = BuildSteps(Structure::FromBoxes(
      "two", {Box::FromMinMax("base", {-0.5, 0, -0.5}, {0.5, 0.2, 0.5}), std::move(turned)}));
  EXPECT_NEAR(steps[1].yaw_deg, 30, 1e-9);
  EXPECT_NEAR(steps[1].front_to_back, 0.2, 1e-9);
  EXPECT_NEAR(steps[1].left_to_right, 0.6, 1e-9);
  // Half of what its corners span: 0.1 cos 30 + 0.3 sin 30 along x, 0.1 sin 30 + 0.3 cos 30 along
  // z.
  const double x = 0.1 * std::sqrt(0.75) + 0.15 - 0.5, z = 0.05 + 0.3 * std::sqrt(0.75) - 0.5;
  ExpectOverhang(steps[1].overhang, x, x, z, z);
}

TEST(BuildSteps, ABoxInTheAirStandsOnNothing) {
  const std::vector<BuildStep> steps = BuildSteps(
      Structure::FromBoxes("two", {Box::FromMinMax("base", {0, 0, 0}, {0.5, 0.2, 0.5}),
                                   Box::FromMinMax("air", {0, 0.25, 0}, {0.5, 0.4, 0.5})}));
  EXPECT_TRUE(steps[1].on.empty());
  EXPECT_FALSE(steps[1].on_floor);
}

TEST(ParseBoxes, ReadsNumbersAndEdges) {
  const auto sizes = ParseBoxes("2x 600x400x300,  400 x 300.5 x 250");
  ASSERT_EQ(sizes.size(), 3u);
  EXPECT_TRUE(sizes[0].isApprox(Eigen::Vector3d(0.6, 0.4, 0.3)));
  EXPECT_TRUE(sizes[1].isApprox(Eigen::Vector3d(0.6, 0.4, 0.3)));
  EXPECT_TRUE(sizes[2].isApprox(Eigen::Vector3d(0.4, 0.3005, 0.25)));
  EXPECT_EQ(ParseBoxes(" 3 x\t600x 400 x300 ").size(), 3u);
  for (const char* text :
       {"", "600x400", "two 600x400x300", "600x400x300;400x300x250", "0x", "3x 600x400x-300",
        "52x 100x100x100", "0x 100x100x100", "600x400x", "600 0x400x300", "1234567x400x300",
        "12345x 600x400x300", "1.5x 600x400x300", "1x 1x 1x 1x 1"}) {
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
  for (int i = 0; i < 3; ++i)
    column.push_back(
        Box::FromMinMax(std::to_string(i), {-0.3, 0.35 * i, -0.2}, {0.3, 0.35 * (i + 1), 0.2}));
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
  ExpectError<DataError>([] { SuggestStack("high", ParseBoxes("9x 400x300x250")); },
                         {"2.25 m high even if all lie flat"});
  SuggestOptions options;
  options.candidates = 2;
  options.height_m = 3;
  EXPECT_THROW(SuggestStack("narrow", ParseBoxes("9x 400x100x100, 5x 300x300x300"), options),
               DataError);
}

TEST(BuildSheet, OfAMeshIsRefused) {
  ExpectError<DataError>([] { BuildSheet(mesh_shapes::StructureOf(mesh_shapes::Ell())); },
                         {"ell: only a stack of boxes has a build sheet"});
}

}  // namespace
}  // namespace volalign::build_sheet_test
