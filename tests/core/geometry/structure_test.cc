#include "core/geometry/structure.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/stack_faults.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::structure_test {
namespace {

using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;

Structure PaperStructure() { return ReadStructure("configs/structure.yaml"); }

Box UnitBox(const std::string& name, double x = 0) {
  return Box::FromMinMax(name, {x, 0, 0}, {x + 1, 1, 1});
}

const Side& SideNamed(const Structure& structure, const std::string& name) {
  for (const Side& side : structure.sides()) {
    if (side.name == name) return side;
  }
  throw std::runtime_error("no side " + name);
}

// Names in the order of configs/structure.yaml, written out once more.
TEST(PaperStructure, HasTheAuthorsLabels) {
  const Structure structure = PaperStructure();
  EXPECT_EQ(structure.num_classes(), 21);
  EXPECT_EQ(structure.boxes().size(), 4u);
  EXPECT_EQ(structure.sides().size(), 24u);
  EXPECT_EQ(structure.SideNames(),
            (std::vector<std::string>{
                "mid_bottom/front", "mid_bottom/back", "mid_bottom/up", "mid_bottom/right",
                "mid_bottom/left",  "mid_top/right",   "mid_top/left",  "mid_top/up",
                "mid_top/front",    "mid_top/back",    "bottom/right",  "bottom/up",
                "bottom/back",      "bottom/front",    "bottom/left",   "top/front",
                "top/right",        "top/up",          "top/back",      "top/left"}));
  for (int label = 1; label < 21; ++label) {
    EXPECT_EQ(structure.SideOfLabel(label).label, label);
    EXPECT_NE(structure.SideOfLabel(label).face(), Face::kDown);
  }
  for (const Side& side : structure.sides()) EXPECT_EQ(side.label == 0, side.face() == Face::kDown);
  ExpectError<Error>([&] { structure.SideOfLabel(0); }, {"label 0"});
  ExpectError<Error>([&] { structure.SideOfLabel(21); }, {"label 21"});
  ExpectError<Error>([&] { structure.Keypoint(-1, KeypointKind::kCentre); }, {"label -1"});
}

// Centres by hand from the list of [min, max] in millimetres.
TEST(PaperStructure, HeightsCentresNormalsAndExtents) {
  const Structure structure = PaperStructure();
  EXPECT_NEAR(structure.FloorHeight(), -0.81, 1e-12);
  EXPECT_NEAR(structure.Height(), 1.62, 1e-12);
  const auto expect_centre = [&](const char* name, double x, double y, double z) {
    EXPECT_LT((SideNamed(structure, name).centre - Vector3d(x, y, z) / 1000).norm(), 1e-12) << name;
  };
  expect_centre("bottom/front", 275, -607.5, 0);
  expect_centre("bottom/back", -280, -607.5, 0);
  expect_centre("mid_bottom/up", -115, 0, -112.5);
  expect_centre("mid_top/down", -227.5, 0, 0);
  expect_centre("mid_top/left", -227.5, 202.5, -165);
  expect_centre("top/right", -115, 607.5, 390);
  for (const Side& side : structure.sides()) {
    const Box& box = structure.boxes()[static_cast<std::size_t>(side.box)];
    EXPECT_EQ(side.name, box.name + "/" + ToString(side.face()));
    const int axis = side.index / 2, sign = side.index % 2 == 0 ? 1 : -1;
    EXPECT_LT((side.normal - sign * Eigen::Vector3d::Unit(axis)).norm(), 1e-12);
    EXPECT_LT((side.axis_u.cross(side.axis_v) - side.normal).norm(), 1e-12) << side.name;
    // The three extents of the box: along u, v and the normal.
    const double depth = 2 * (side.centre - box.structure_from_box.translation()).dot(side.normal);
    EXPECT_NEAR(8 * side.half_u * side.half_v * depth / 2, box.size.prod(), 1e-12) << side.name;
    EXPECT_NEAR((box.size.array() * side.axis_u.cwiseAbs().array()).sum(), 2 * side.half_u, 1e-12);
    EXPECT_NEAR((box.size.array() * side.axis_v.cwiseAbs().array()).sum(), 2 * side.half_v, 1e-12);
    EXPECT_EQ(structure.Keypoint(std::max<int>(1, side.label), KeypointKind::kCentre),
              side.label ? side.centre : structure.SideOfLabel(1).centre);
  }
}

// mid_bottom/up is 330 x 555 mm; mid_top covers x in [-280, 50], z in [-165, 165]; what stays is
// z in [-390, -165].
TEST(PaperStructure, ExposedCentroidInClosedForm) {
  const Structure structure = PaperStructure();
  const Side& up = SideNamed(structure, "mid_bottom/up");
  EXPECT_NEAR(up.exposed_area, 0.330 * 0.225, 1e-12);
  EXPECT_LT((up.exposed_centroid - Vector3d(-0.115, 0, -0.2775)).norm(), 1e-12);
  const Side& top = SideNamed(structure, "top/up");
  EXPECT_NEAR(top.exposed_area, 0.330 * 0.555, 1e-12);
  EXPECT_LT((top.exposed_centroid - top.centre).norm(), 1e-12);
  EXPECT_EQ(structure.Keypoint(3, KeypointKind::kExposed), up.exposed_centroid);
  EXPECT_EQ(structure.Keypoint(3, KeypointKind::kCentre), up.centre);
}

TEST(Structure, YawedBoxesKeepTheirCentreAndTurn) {
  const TempFolder folder;
  const Structure structure = ReadStructure(
      folder.Write("yawed.yaml",
                   "boxes:\n"
                   "  - {name: a, x: [-300, 300], y: [0, 400], z: [-200, 200]}\n"
                   "  - {name: b, x: [-250, 150], y: [400, 700], z: [-100, 100], yaw_deg: 30}\n"));
  EXPECT_EQ(structure.name(), "yawed");
  const double c = std::cos(kPi / 6), s = std::sin(kPi / 6);
  const Side& front = SideNamed(structure, "b/front");
  // A positive yaw about y (up) turns +x towards -z.
  EXPECT_LT((front.normal - Vector3d(c, 0, -s)).norm(), 1e-12);
  EXPECT_LT((front.centre - (Vector3d(-0.05, 0.55, 0) + 0.2 * front.normal)).norm(), 1e-12);
  EXPECT_LT((SideNamed(structure, "b/up").normal - Vector3d::UnitY()).norm(), 1e-12);
  // a/up loses the whole of b's footprint.
  const Side& up = SideNamed(structure, "a/up");
  EXPECT_NEAR(up.exposed_area, 0.6 * 0.4 - 0.4 * 0.2, 1e-4);
  EXPECT_LT((up.exposed_centroid - Vector3d(0.05 * 0.08 / 0.16, 0.4, 0)).norm(), 2e-4);
  EXPECT_NEAR(SideNamed(structure, "b/down").exposed_area, 0, 1e-6);
}

TEST(Structure, CoversToAMillimetre) {
  Box low = Box::FromMinMax("low", {0, 0, 0}, {1, 1, 1});
  const auto exposed = [&](double gap) {
    return Structure::FromBoxes("s",
                                {low, Box::FromMinMax("high", {0, 1 + gap, 0}, {0.5, 2 + gap, 1})})
        .sides()[2]
        .exposed_area;
  };
  EXPECT_NEAR(exposed(0), 0.5, 1e-12);
  EXPECT_NEAR(exposed(0.0005), 0.5, 1e-12);
  EXPECT_NEAR(exposed(-0.01), 0.5, 1e-12);
  EXPECT_NEAR(exposed(0.002), 1, 1e-12);
}

TEST(Structure, ARowOfBoxesHasFiveLabelsEachUpTo255) {
  std::vector<Box> boxes;
  for (int b = 0; b < 51; ++b) boxes.push_back(UnitBox("b" + std::to_string(b), b));
  const Structure structure = Structure::FromBoxes("row", boxes);
  EXPECT_EQ(structure.num_classes(), 256);
  std::set<int> labels;
  for (const Side& side : structure.sides()) {
    if (side.face() != Face::kDown) labels.insert(side.label);
    // Neighbours hide each other's front and back.
    const bool hidden = (side.face() == Face::kFront && side.box < 50) ||
                        (side.face() == Face::kBack && side.box > 0);
    EXPECT_NEAR(side.exposed_area, hidden ? 0 : 1, 1e-12) << side.name;
    EXPECT_LT((side.exposed_centroid - side.centre).norm(), 1e-12) << side.name;
  }
  EXPECT_EQ(labels.size(), 255u);
  EXPECT_EQ(structure.SideOfLabel(255).name, "b50/left");
  boxes.push_back(UnitBox("b51", -5));
  ExpectError<DataError>([&] { Structure::FromBoxes("row", boxes); }, {"52 boxes", "51"});
}

TEST(Structure, RejectsBadBoxes) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto expect_bad = [](const std::vector<Box>& boxes, const std::string& part) {
    ExpectError<DataError>([&] { Structure::FromBoxes("s", boxes); }, {part});
  };
  expect_bad({}, "box");
  expect_bad({UnitBox("a"), UnitBox("a", 2)}, "'a'");
  expect_bad({UnitBox("")}, "empty");
  expect_bad({UnitBox("a/b")}, "'a/b'");
  expect_bad({UnitBox("a\x1b[31m")}, "a box");
  expect_bad({UnitBox("a\x1b[31m")}, "a\\x1b[31m");
  ExpectError<DataError>([] { Structure::FromBoxes("s\n", {UnitBox("a")}); }, {"a structure"});
  for (const double height : {0.0, -1.0, nan}) {
    Box flat = UnitBox("flat");
    flat.size.y() = height;
    expect_bad({flat}, "'flat'");
  }
  expect_bad({UnitBox("nowhere", nan)}, "'nowhere'");
}

// A file in micrometres, or in metres, is no structure of some kilometres or micrometres.
TEST(Structure, LimitsEdges) {
  const auto with_edge = [](double edge) {
    Box box = UnitBox("a");
    box.size.z() = edge;
    return Structure::FromBoxes("s", {box, UnitBox("b", 1)});
  };
  EXPECT_EQ(with_edge(0.01).boxes().size(), 2u);
  EXPECT_EQ(with_edge(100).boxes().size(), 2u);
  for (const double edge : {0.0005, 0.00999, 100.1, 2e5, 1e300}) {
    ExpectError<DataError>([&] { with_edge(edge); },
                           {"'a' is 1000 x 1000 x ", "10 mm to 100 m", "millimetres"});
  }
  Box far = UnitBox("far");
  far.structure_from_box.translation().x() = 1e300;
  ExpectError<DataError>([&] { Structure::FromBoxes("s", {far}); }, {"'far'", "1000 m away"});
}

// A side of 100 m under a box that stands askew is cut into strips, but not into any number.
TEST(Structure, LimitsStrips) {
  Box askew = Box::FromMinMax("askew", {0, 0, 0}, {100, 100, 100});
  askew.structure_from_box.linear() = RotationExp(0.3 * Vector3d::UnitY());
  const Structure structure =
      Structure::FromBoxes("s", {Box::FromMinMax("low", {0, -100, 0}, {100, 0, 100}), askew});
  const std::vector<Pose> offsets(2, Pose::Identity());
  EXPECT_NEAR(structure.Displaced(offsets, 1e4).sides()[2].exposed_area,
              1e8 * structure.sides()[2].exposed_area, 1e8);
}

TEST(Structure, RejectsBadLabelOrders) {
  const std::vector<std::string> good = {"a/left", "a/front", "a/up", "a/back", "a/right"};
  EXPECT_EQ(Structure::FromBoxes("s", {UnitBox("a")}, good).SideNames(), good);
  const auto expect_bad = [](const std::vector<std::string>& order, const std::string& part) {
    ExpectError<DataError>([&] { Structure::FromBoxes("s", {UnitBox("a")}, order); }, {part});
  };
  expect_bad({"a/left", "a/front", "a/up", "a/back"}, "'a/right' has no label");
  expect_bad({"a/left", "a/front", "a/up", "a/left", "a/right"}, "'a/left'");
  expect_bad({"a/left", "a/front", "a/up", "a/back", "a/right", "a/down"}, "'a/down'");
  expect_bad({"b/left", "a/front", "a/up", "a/back", "a/right"}, "'b/left'");
}

TEST(Structure, HashTellsDimensionsPosesAndLabels) {
  const Structure structure = PaperStructure();
  const auto order = structure.SideNames();
  const auto& boxes = structure.boxes();
  std::set<std::string> hashes = {structure.Hash()};
  EXPECT_EQ(structure.Hash().size(), 64u);
  EXPECT_EQ(structure.Hash(), PaperStructure().Hash());
  std::size_t variants = 1;
  const auto expect_new = [&](const std::vector<Box>& b, const std::vector<std::string>& o) {
    EXPECT_TRUE(hashes.insert(Structure::FromBoxes("x", b, o).Hash()).second);
    ++variants;
  };
  for (int axis = 0; axis < 3; ++axis) {
    auto changed = boxes;
    changed[2].size[axis] += 1e-5;
    expect_new(changed, order);
    changed = boxes;
    changed[2].structure_from_box.translation()[axis] += 1e-5;
    expect_new(changed, order);
    changed = boxes;
    changed[2].structure_from_box.linear() =
        RotationExp(1e-4 * Vector3d::Unit(axis)) * changed[2].structure_from_box.linear();
    expect_new(changed, order);
  }
  auto swapped = order;
  std::swap(swapped[4], swapped[17]);
  expect_new(boxes, swapped);
  auto renamed = boxes;
  renamed[0].name = "base";
  auto renamed_order = order;
  for (auto& name : renamed_order) {
    if (name.compare(0, 7, "bottom/") == 0) name = "base/" + name.substr(7);
  }
  expect_new(renamed, renamed_order);
  EXPECT_EQ(hashes.size(), variants);
  // A tenth of a micrometre is the same structure.
  auto same = boxes;
  same[1].structure_from_box.translation().x() += 1e-7;
  EXPECT_EQ(Structure::FromBoxes("other name", same, order).Hash(), structure.Hash());
}

TEST(Structure, DisplacedMovesBoxesAndKeepsLabels) {
  const Structure structure = PaperStructure();
  std::vector<Pose> offsets(4, Pose::Identity());
  offsets[1].translation() = Vector3d(0.01, 0, -0.02);
  offsets[3].linear() = RotationExp({0, 0.05, 0});
  const Structure moved = structure.Displaced(offsets, 1.01);
  ASSERT_EQ(moved.num_classes(), 21);
  EXPECT_EQ(moved.SideNames(), structure.SideNames());
  EXPECT_NE(moved.Hash(), structure.Hash());
  for (int label = 1; label < 21; ++label) {
    const Side& before = structure.SideOfLabel(label);
    const Side& after = moved.SideOfLabel(label);
    const Box& box = structure.boxes()[static_cast<std::size_t>(before.box)];
    const Pose& offset = offsets[static_cast<std::size_t>(before.box)];
    EXPECT_EQ(after.label, label);
    EXPECT_EQ(after.name, before.name);
    const Vector3d middle = box.structure_from_box.translation();
    EXPECT_LT((after.centre - offset * Vector3d(middle + 1.01 * (before.centre - middle))).norm(),
              1e-12);
    EXPECT_LT((after.normal - offset.linear() * before.normal).norm(), 1e-12);
    EXPECT_NEAR(after.half_u, 1.01 * before.half_u, 1e-12);
    EXPECT_NEAR(after.half_v, 1.01 * before.half_v, 1e-12);
  }
  EXPECT_EQ(structure.Displaced(std::vector<Pose>(4, Pose::Identity())).Hash(), structure.Hash());
  const Structure drawn = structure.DisplacedToDraw(offsets, 1.01);
  EXPECT_EQ(drawn.Hash(), moved.Hash());
  for (int label = 1; label < 21; ++label) {
    EXPECT_EQ(drawn.SideOfLabel(label).centre, moved.SideOfLabel(label).centre);
    EXPECT_TRUE(std::isnan(drawn.SideOfLabel(label).exposed_area));
    EXPECT_TRUE(std::isnan(drawn.Keypoint(label, KeypointKind::kExposed).x()));
  }
  ExpectError<Error>([&] { structure.Displaced({Pose::Identity()}); }, {"1 offsets", "4 boxes"});
}

TEST(Side, BulgesInItsMiddleAndNotAtItsEdges) {
  const Structure structure = PaperStructure();
  for (const Side& side : structure.sides()) {
    const Vector3d u = side.half_u * side.axis_u, v = side.half_v * side.axis_v;
    EXPECT_NEAR(side.BulgeAt(side.centre), 1, 1e-12);
    EXPECT_NEAR(side.BulgeAt(side.centre + u / 2), M_SQRT1_2, 1e-12);
    EXPECT_NEAR(side.BulgeAt(side.centre - u / 3 + v / 2), std::sqrt(0.75) * M_SQRT1_2, 1e-12);
    for (const Vector3d& edge : {u, v, Vector3d(-u), Vector3d(-2 * v)})
      EXPECT_NEAR(side.BulgeAt(side.centre + edge), 0, 1e-12);
  }
}

class StructureYaml : public testing::Test {
 protected:
  Structure Read(const std::string& text) {
    folder_.Write("boxes.yaml", text);
    return ReadStructure(path_);
  }
  void ExpectBad(const std::string& text, std::initializer_list<std::string> parts) {
    SCOPED_TRACE(text);
    ExpectError<ConfigError>([&] { Read(text); }, parts);
  }
  /// Of one box, on the second line.
  void ExpectBadBox(const std::string& box, const std::string& part) {
    ExpectBad("boxes:\n  - {" + box + "}\n", {path_ + ":2", part});
  }

  const TempFolder folder_;
  const std::string path_ = (folder_ / "boxes.yaml").string();
  const std::string box_ = "  - {name: a, x: [0, 10], y: [0, 20], z: [0, 30]}\n";
};

TEST_F(StructureYaml, LabelsAndNameAreOptional) {
  const Structure plain = Read("boxes:\n" + box_);
  EXPECT_EQ(plain.name(), "boxes");
  EXPECT_EQ(plain.SideNames()[0], "a/front");
  EXPECT_LT((plain.boxes()[0].size - Vector3d(0.01, 0.02, 0.03)).norm(), 1e-15);
  const Structure named = Read("name: lab\nboxes:\n" + box_ +
                               "labels:\n  - {id: 1, side: a/left}\n  - {id: 2, side: a/up}\n"
                               "  - {id: 3, side: a/front}\n  - {id: 4, side: a/back}\n"
                               "  - {id: 5, side: a/right}\n");
  EXPECT_EQ(named.name(), "lab");
  EXPECT_EQ(named.SideOfLabel(1).name, "a/left");
  EXPECT_EQ(named.SideOfLabel(5).name, "a/right");
}

// config_test has what every reader rejects.
TEST_F(StructureYaml, RejectsBadFiles) {
  ExpectBad("", {"at least one box or mesh", path_});
  ExpectBad("boxes:\n" + box_ + "colour: red\n", {path_ + ":3", "unknown key 'colour'"});
  ExpectBadBox("name: a, x: [0, 10], y: [0, 20]", "'boxes[0].z' is missing");
  ExpectBadBox("x: [0, 10], y: [0, 20], z: [0, 30]", "'boxes[0].name' is missing");
  ExpectBadBox("name: a, x: [0, 10], y: [20, 0], z: [0, 30]",
               "boxes[0].y = [20, 0] of box 'a' violates min < max");
  ExpectBadBox("name: a, x: [0, 10, 20], y: [0, 1], z: [0, 30]",
               "boxes[0].x = [0, 10, 20] has 3 values; 2 are expected");
  ExpectBad("boxes:\n  - name: a\n    x: [0, 10]\n    y: [0, 10]\n    z: [0 500]\n",
            {path_ + ":5", "boxes[0].z = [0 500]", "commas"});
  ExpectBad("boxes:\n  - {name: a, x: [0, 0.5], y: [0, 0.3], z: [0, 0.4]}\n",
            {path_, "'a' is 0.5 x 0.3 x 0.4 mm", "millimetres"});
  ExpectBad("boxes:\n" + box_ + box_, {path_, "two boxes are named 'a'"});
  ExpectBad("boxes:\n" + box_ + "sides: {front: +z}\n",
            {path_ + ":3", "sides.front = +z violates sides.front in {+x}"});
  ExpectBad("boxes:\n" + box_ + "sides: {north: +x}\n", {path_ + ":3", "'sides.north'"});
  ExpectBad("boxes:\n" + box_ + "labels:\n  - {id: 2, side: a/up}\n", {path_ + ":4", "label id 2"});
  ExpectBad("boxes:\n" + box_ + "labels:\n  - {id: 1, side: a/down}\n", {path_, "'a/down'"});
  ExpectError<IoError>([] { ReadStructure("missing/boxes.yaml"); }, {"missing/boxes.yaml"});
  ExpectError<ConfigError>([] { ReadStructure("boxes.txt"); }, {"boxes.txt", ".yaml"});
}

TEST_F(StructureYaml, WritesWhatItReadsAsTheSameStructure) {
  const Structure paper = ReadStructure("configs/structure.yaml");
  Structure read = Read(volalign::StructureYaml(paper));
  EXPECT_EQ(read.name(), paper.name());
  EXPECT_EQ(read.Hash(), paper.Hash());
  RandomStream random(8, 0, "boxes");
  std::vector<Box> boxes;
  for (int b = 0; b < 12; ++b) {
    Box& box = boxes.emplace_back();
    box.name = fmt::format("box: {}", b);
    box.size = {random.Uniform(0.1, 0.6), 0.3, random.Uniform(0.1, 0.6)};
    box.structure_from_box.translation() = Vector3d(random.Normal() * 0.01, 0.3 * b, 0.01);
    box.structure_from_box.linear() = RotationExp(random.Normal() * Vector3d::UnitY());
  }
  const Structure turned = Structure::FromBoxes("turned # 1", boxes);
  read = Read(volalign::StructureYaml(turned));
  EXPECT_EQ(read.name(), "turned # 1");
  EXPECT_EQ(read.SideNames(), turned.SideNames());
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    EXPECT_LT((read.boxes()[b].size - boxes[b].size).norm(), 2e-9);
    EXPECT_LT(
        (read.boxes()[b].structure_from_box.matrix() - boxes[b].structure_from_box.matrix()).norm(),
        4e-8);
  }
  boxes[0].structure_from_box.linear() = RotationExp(0.01 * Vector3d::UnitX());
  ExpectError<DataError>([&] { volalign::StructureYaml(Structure::FromBoxes("s", boxes)); },
                         {"'box: 0' leans"});
}

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
  for (const std::string& part : parts) EXPECT_TRUE(Has(faults[0].text, part));
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

}  // namespace
}  // namespace volalign::structure_test
