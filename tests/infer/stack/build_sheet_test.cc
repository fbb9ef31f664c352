#include "infer/stack/build_sheet.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "infer/stack/build_steps.h"

namespace volalign::build_sheet_test {
namespace {

struct Text {
  std::string words;
  double left, right, top, bottom;
};

/// Every text of the SVG with the room that it takes in DejaVu Sans, at least.
std::vector<Text> TextsOf(const std::string& svg) {
  static const std::regex kText("<text x=\"([-0-9.]+)\" y=\"([-0-9.]+)\"([^>]*)>([^<]*)</text>"),
      kSize("font-size=\"([0-9.]+)\"");
  std::vector<Text> texts;
  for (std::sregex_iterator it(svg.begin(), svg.end(), kText), end; it != end; ++it) {
    const std::string attributes = (*it)[3], words = (*it)[4];
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
  for (int i = 0; i < 8; ++i) {
    tower.push_back(Box::FromMinMax(fmt::format("t{}", i), {0.01 * i, 0.4 * i, 0},
                                    {0.3, 0.4 * (i + 1), 0.2 + 0.03 * i}));
  }
  ExpectNoOverlap(Structure::FromBoxes("tower", tower));
}

// What the page of the paper's stack has to say, from the numbers of configs/structure.yaml.
TEST(BuildSheet, SaysHowThePapersStackIsBuilt) {
  const std::vector<Text> texts = TextsOf(BuildSheet(ReadStructure("configs/structure.yaml")));
  const auto count = [&](const std::string& words) {
    return std::count_if(texts.begin(), texts.end(),
                         [&](const Text& text) { return text.words == words; });
  };
  EXPECT_EQ(count("4 boxes, 1620 mm high. Build from 1 to 4. All lengths are in millimetres."), 1);
  EXPECT_EQ(count("555 front-back, 330 left-right, 405 up"), 2 * 2);  // view and plan
  EXPECT_EQ(count("330 front-back, 555 left-right, 405 up"), 2 * 2);
  EXPECT_EQ(count("on the floor"), 1);
  EXPECT_EQ(count("on 1 bottom"), 1);
  EXPECT_EQ(count("on 2 mid_bottom"), 1);
  EXPECT_EQ(count("on 3 mid_top"), 1);
  EXPECT_EQ(count("225 out"), 3);
  EXPECT_EQ(count("225 in"), 3);
  EXPECT_EQ(count("flush"), 6);
  EXPECT_EQ(count("front (+x)"), 1);
  EXPECT_EQ(count("back (-x)"), 1);
  EXPECT_EQ(count("left (-z)"), 1);
  EXPECT_EQ(count("measured: ______ × ______ × ______"), 4);
  EXPECT_EQ(count("origin (+) 275 from its front edge,"), 1);
  EXPECT_EQ(count("165 from its right edge, 810 above"), 1);
}

TEST(BuildSheet, NamesATurnAndABoxInTheAir) {
  Box turned = Box::FromMinMax("turned", {0, 0.25, 0}, {0.4, 0.5, 0.4});
  turned.structure_from_box.linear() = RotationExp(-0.25 * Eigen::Vector3d::UnitY());
  const std::string svg = BuildSheet(
      Structure::FromBoxes("two", {Box::FromMinMax("base", {0, 0, 0}, {0.5, 0.2, 0.5}), turned}));
  EXPECT_NE(svg.find(">on nothing (check y), 14.3° clockwise<"), std::string::npos);
}

TEST(BuildSheet, IsThePictureOfTheReadme) {
  EXPECT_TRUE(BuildSheet(ReadStructure("configs/structure.yaml")) ==
              ReadFile("docs/build.svg", kMaxTextBytes))
      << "volalign structure sheet configs/structure.yaml -o docs/build.svg";
}

}  // namespace
}  // namespace volalign::build_sheet_test

namespace volalign::build_steps_test {
namespace {

void ExpectOverhang(const Overhang& overhang, double front, double back, double right,
                    double left) {
  EXPECT_NEAR(overhang.front, front, 1e-9);
  EXPECT_NEAR(overhang.back, back, 1e-9);
  EXPECT_NEAR(overhang.right, right, 1e-9);
  EXPECT_NEAR(overhang.left, left, 1e-9);
}

// By hand, from the numbers of configs/structure.yaml.
TEST(BuildSteps, OfThePapersStack) {
  const std::vector<BuildStep> steps = BuildSteps(ReadStructure("configs/structure.yaml"));
  ASSERT_EQ(steps.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(steps[i].box, static_cast<int>(i));
    EXPECT_NEAR(steps[i].height, 0.405, 1e-9);
    EXPECT_NEAR(steps[i].yaw_deg, 0, 1e-9);
    EXPECT_EQ(steps[i].on_floor, i == 0);
  }
  EXPECT_NEAR(steps[1].front_to_back, 0.330, 1e-9);
  EXPECT_NEAR(steps[1].left_to_right, 0.555, 1e-9);
  EXPECT_TRUE(steps[0].on.empty());
  EXPECT_EQ(steps[3].on, std::vector<int>{2});
  ExpectOverhang(steps[1].overhang, -0.225, 0, 0, 0.225);
  ExpectOverhang(steps[2].overhang, 0, 0.225, 0, -0.225);
  ExpectOverhang(steps[3].overhang, 0, -0.225, 0.225, 0);
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

}  // namespace
}  // namespace volalign::build_steps_test
