#include "infer/initial/pose_candidates.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/lists.h"
#include "core/base/random.h"
#include "core/geometry/procrustes.h"
#include "core/geometry/visibility.h"
#include "infer/initial/agreement.h"
#include "infer/initial/box_fit.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/rig_choice.h"
#include "infer/initial/side_patch.h"
#include "infer/initial/sides_fix_pose.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_candidates_test {
namespace {

using namespace testing_infer;

/// A side as a sensor at `pose` that saw all of it would have it.
SidePatch WholeSide(const Structure& structure, const std::string& name, const Pose& pose) {
  SidePatch patch;
  patch.label = LabelOf(structure, name);
  const Side& side = structure.SideOfLabel(patch.label);
  patch.centroid = pose.inverse() * structure.Keypoint(patch.label, KeypointKind::kExposed);
  patch.normal = pose.linear().transpose() * side.normal;
  patch.area = 4 * side.half_u * side.half_v;
  patch.normal_sigma = 0.01;
  return patch;
}

class PoseCandidates : public ::testing::Test {
 protected:
  void Add(const std::string& name) { patches.push_back(WholeSide(structure, name, truth)); }
  std::vector<Eigen::Vector3d> Keypoints() const { return SideKeypoints(patches, structure); }
  void ExpectTruth(const Pose& pose) const {
    EXPECT_TRUE(Within(ComparePoses(pose, truth), 1e-9, 1e-6));
  }

  Structure structure = PaperStructure();
  Pose truth = RingPose(35);
  std::vector<SidePatch> patches;
};

TEST_F(PoseCandidates, TwoSidesOfDifferentDirectionsFixThePose) {
  Add("top/front");
  Add("mid_top/right");
  const auto pose = SolvePose(patches, PatchSet{0, 1}, Keypoints(), structure);
  ASSERT_TRUE(pose.has_value());
  ExpectTruth(*pose);
}

// Four centres in a plane alone would leave a mirror image; three in a line a turn about it.
TEST_F(PoseCandidates, NormalsFixWhatParallelSidesLeaveFree) {
  for (const char* name : {"mid_bottom/front", "mid_top/front", "top/front"}) Add(name);
  const auto pose = SolvePose(patches, PatchSet{0, 1, 2}, Keypoints(), structure);
  ASSERT_TRUE(pose.has_value());
  ExpectTruth(*pose);
}

TEST_F(PoseCandidates, SidesAboveEachOtherFixNoTurn) {
  structure = Structure::FromBoxes("tower", {Box::FromMinMax("low", {0, 0, 0}, {0.4, 0.4, 0.4}),
                                             Box::FromMinMax("high", {0, 0.8, 0}, {0.4, 1, 0.4})});
  Add("low/up");
  Add("high/up");
  EXPECT_FALSE(SolvePose(patches, PatchSet{0, 1}, Keypoints(), structure).has_value());
}

TEST_F(PoseCandidates, APatchAgreesByPlaceAndDirection) {
  for (const char* name : {"top/front", "top/right", "mid_top/front", "mid_bottom/front"})
    Add(name);
  Add("bottom/front");
  const Eigen::Vector3d axis = patches[0].normal.unitOrthogonal();
  patches[0].centroid += 0.1 * axis;
  patches[1].centroid += 0.15 * axis;
  patches[2].centroid += 0.25 * axis;                                                // too far
  patches[3].normal = Eigen::AngleAxisd(35 * M_PI / 180, axis) * patches[3].normal;  // turned
  patches[4].centroid -= 0.19 * axis;
  Add("mid_top/right");
  patches[5].normal = Eigen::AngleAxisd(35 * M_PI / 180, axis) * patches[5].normal;
  patches[5].normal_sigma = 0.2;  // a sliver, whose normal says little
  const PatchSet agreeing =
      AgreeingPatches(patches, Keypoints(), structure, kMostKeypointError, truth);
  EXPECT_EQ(agreeing, (PatchSet{0, 1, 4, 5}));
}

TEST_F(PoseCandidates, TheCandidateThatMostPatchesAgreeWithComesFirst) {
  for (const char* name : {"top/front", "mid_top/right", "mid_bottom/front", "bottom/up"})
    Add(name);
  // Two true sides with each other's labels.
  patches.push_back(WholeSide(structure, "bottom/front", truth));
  patches.push_back(WholeSide(structure, "top/right", truth));
  std::swap(patches[4].label, patches[5].label);
  SortLargestFirst(&patches, [](const SidePatch& patch) { return patch.area; });
  const std::vector<Pose> poses = FindCandidates(patches, structure);
  ASSERT_FALSE(poses.empty());
  ExpectTruth(poses.front());
  EXPECT_LE(poses.size(), 8u);
}

TEST_F(PoseCandidates, OneSideOrNoneGivesNoCandidate) {
  EXPECT_TRUE(FindCandidates(patches, structure).empty());
  Add("top/front");
  EXPECT_TRUE(FindCandidates(patches, structure).empty());
}

Pose Moved(const Pose& pose, double x, double yaw) {
  return MakePose({0, yaw, 0}, {x, 0, 0}) * pose;
}

/// A view of a box that looks the same after half a turn, its labels, and poses of it.
class Proposals : public testing::Test {
 protected:
  /// Of both sources, where labels have led the network to a pose.
  std::vector<Hypothesis> Hypotheses(const Pose& network, const LabelImage& labels) const {
    Labelling labelling;
    labelling.segmentation = Certain(labels);
    labelling.initial.found = true;
    labelling.initial.structure_from_sensor = network;
    return FindHypotheses(view_, box_, FindSymmetries(box_), {&labelling}, true, PoseMethod::kAuto);
  }
  PoseChoice Combined(const Pose& network, const LabelImage& labels) const {
    return ChooseTogether({{&view_, Hypotheses(network, labels), 0}}, box_).front();
  }
  LabelImage LabelsAt(const Pose& pose, const DepthErrorModel& errors) const {
    return LabelsFromPose(view_, box_, pose, SurfaceTolerance::AtRoughPose(errors)).labels;
  }

  bool IsChosen(const PoseChoice& choice, const Pose& pose) const {
    return choice.found && SamePose(box_, choice.best.structure_from_sensor, pose);
  }

  const Structure box_ = Structure::FromBoxes(
      "box", {Box::FromMinMax("box", {-0.35, -0.8, -0.25}, {0.35, 0.2, 0.25})});
  const Pose truth_ = RingPose(40, 2.0, 0.6);
  const Pose half_turn_ = Moved(truth_, 0, M_PI);
  const Pose elsewhere_ = Moved(truth_, 0.3, 0);
  const SensorView view_ = See(box_, truth_);
  const LabelImage labels_ = LabelsAt(truth_, view_.errors);
};

TEST_F(Proposals, OfBothThatAgreeAreTheNetworks) {
  for (const Pose& pose : {truth_, half_turn_}) {
    const PoseChoice choice = Combined(pose, LabelsAt(pose, view_.errors));
    EXPECT_TRUE(IsChosen(choice, pose)) << "labels tell from which end";
    EXPECT_EQ(choice.best.source, PoseSource::kNetwork);
    EXPECT_FALSE(choice.ambiguous());
  }
}

TEST_F(Proposals, OfGeometryStandInForAPoseThatLabelsDoNotSpeakFor) {
  const PoseChoice choice = Combined(elsewhere_, labels_);
  EXPECT_TRUE(IsChosen(choice, truth_));
}

// As a network labels what is beyond the distances that it was trained for.
TEST_F(Proposals, OfGeometryStandInWhereLabelsSayNothing) {
  LabelImage few = LabelsAt(elsewhere_, view_.errors);
  for (const auto [u, v] : Pixels(few)) {
    if (u / 4 % 3 > 0) few(u, v) = 0;
  }
  const PoseChoice choice = Combined(elsewhere_, few);
  EXPECT_TRUE(IsChosen(choice, truth_) || IsChosen(choice, half_turn_));
  EXPECT_TRUE(choice.ambiguous());
}

Structure Cube(double edge) {
  return Structure::FromBoxes(
      "cube", {Box::FromMinMax("cube", {-edge / 2, 0, -edge / 2}, {edge / 2, edge, edge / 2})});
}

TEST(SamePose, FollowsFromTheSmallestEdge) {
  const Pose pose = RingPose(30);
  struct Case {
    double edge, same, other;
  };
  // Half an edge; not under 3 cm, which is what two estimates differ by, nor over 20.
  for (const Case& c : {Case{0.1, 0.049, 0.051}, Case{0.3, 0.149, 0.151}, Case{0.02, 0.029, 0.031},
                        Case{2, 0.199, 0.201}}) {
    EXPECT_TRUE(SamePose(Cube(c.edge), pose, Moved(pose, c.same, 0))) << c.edge;
    EXPECT_FALSE(SamePose(Cube(c.edge), pose, Moved(pose, -c.other, 0))) << c.edge;
  }
  // A corner is 0.707 edges from the axis of the turn and moves by twice the sine of half of it.
  EXPECT_TRUE(SamePose(Cube(0.3), pose, Moved(pose, 0, 41 * M_PI / 180)));
  EXPECT_FALSE(SamePose(Cube(0.3), pose, Moved(pose, 0, 42 * M_PI / 180)));
}

TEST(SamePose, NoNumberIsNoPose) {
  Pose pose = Pose::Identity();
  pose.translation().x() = std::nan("");
  EXPECT_FALSE(SamePose(Cube(1), pose, pose));
}

const SurfaceTolerance kTolerance = SurfaceTolerance::AtRoughPose(ErrorsOf(""));  // 4.3 cm at 1 m

/// A box whose face at 1 m covers the left half of Coarse's view; from x = 0 on it is out of view.
Structure LeftBox() {
  return Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 1, 2))});
}

TEST(CompareWithView, CountsPixels) {
  const Structure box = LeftBox();
  const auto seen = static_cast<std::uint8_t>(LabelOf(box, "b/left"));
  const auto hidden = static_cast<std::uint8_t>(LabelOf(box, "b/right"));
  DepthImage depth(20, 10, 3.0f);
  SegmentationResult segmentation = Certain(LabelImage(20, 10, 0));
  for (int v = 0; v < 10; ++v) {
    for (int u = 3; u < 9; ++u) depth(u, v) = 1.01f;
    depth(0, v) = 0;
    depth(1, v) = 0.5f;   // in front
    depth(2, v) = 1.5f;   // 28 cm behind the face, as far from every other
    depth(3, v) = 1.04f;  // within the tolerance
    depth(9, v) = 1.2f;   // far behind the face, but 1.5 cm from the side x = 0
    for (const int u : {0, 1, 3, 4, 6, 8, 9, 15}) segmentation.labels(u, v) = seen;
    segmentation.labels(5, v) = hidden;
    segmentation.confidence(6, v) = 0.3f;
  }
  const Agreement agreement = CompareWithView(MakeSensorView(depth, Coarse()), segmentation, box,
                                              Pose::Identity(), kTolerance);
  EXPECT_EQ(agreement.visible, 90);     // columns 1 to 9
  EXPECT_EQ(agreement.explained, 70);   // 3 to 9
  EXPECT_EQ(agreement.same_label, 40);  // 3, 4, 8, 9
  EXPECT_EQ(agreement.either, 100);     // 1 to 9, 15
  EXPECT_DOUBLE_EQ(agreement.explained_share(), 7.0 / 9);
  EXPECT_DOUBLE_EQ(agreement.score(), 0.4);
  // Of the pixels with depth, whatever the confidence. The face: 6 columns of 10; the hidden side:
  // 0 of 1; background: 9 of 12.
  EXPECT_NEAR(agreement.miou, (0.6 + 0 + 0.75) / 3, 1e-9);
}

TEST(CompareWithView, LabelsAreComparedPixelByPixel) {
  // Its face at 1 m covers the left half of the upper rows.
  const Structure box = Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 0, 2))});
  const auto seen = static_cast<std::uint8_t>(LabelOf(box, "b/left"));
  const Agreement agreement =
      CompareWithView(MakeSensorView(DepthImage(20, 10, 1.0f), Coarse()),
                      Certain(LabelImage(20, 10, seen)), box, Pose::Identity(), kTolerance);
  EXPECT_EQ(agreement.explained, 50);
  EXPECT_EQ(agreement.same_label, 50);
}

TEST(CompareWithView, NothingMeasuredIsNoAgreement) {
  const Agreement agreement =
      CompareWithView(MakeSensorView(DepthImage(20, 10, 0.0f), Coarse()),
                      Certain(LabelImage(20, 10, 1)), LeftBox(), Pose::Identity(), kTolerance);
  EXPECT_EQ(agreement.visible, 0);
  EXPECT_EQ(agreement.either, 0);
  EXPECT_EQ(agreement.score(), 0);
}

TEST(LabelsFromPose, NamesTheSideThatWasMeasured) {
  const Structure box = LeftBox();
  const int seen = LabelOf(box, "b/left");
  DepthImage depth(20, 10, 3.0f);
  for (int v = 0; v < 10; ++v) {
    for (int u = 2; u < 10; ++u) depth(u, v) = 1.01f;
    depth(0, v) = 0;
    depth(1, v) = 1.06f;
  }
  const SegmentationResult labels =
      LabelsFromPose(MakeSensorView(depth, Coarse()), box, Pose::Identity(), kTolerance);
  for (const auto [u, v] : Pixels(20, 10)) {
    const bool on_side = u >= 2 && u < 10;
    EXPECT_EQ(labels.labels(u, v), on_side ? seen : 0) << u << " " << v;
    EXPECT_EQ(labels.confidence(u, v), on_side ? 1.0f : 0.0f) << u << " " << v;
  }
}

/// The upper box is turned by `yaw_deg`.
Structure Stack(double yaw_deg = 0, double height = 0) {
  return Structure::FromBoxes(
      "stack", {Standing("low", {0.5, 0.35, 0.4}, {0, height, 0}),
                Standing("high", {0.35, 0.4, 0.3}, {0.05, height + 0.35, 0}, yaw_deg)});
}

const Pose kTruth = RingPose(40, 1.9, 0.9, 90, {0, 0.35, 0});

TEST(ShapeLogOdds, AtTheTruePoseOnly) {
  const SensorView view = See(Stack(), kTruth);
  EXPECT_TRUE(ShapeLogOdds(view, Stack(), kTruth).has_value());
  const Pose aside = Eigen::Translation3d(-0.08, 0, -0.05) * kTruth;
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), aside).has_value());
}

// Within the tolerance of a first look, the sides of a box that is turned lie where they should.
TEST(ShapeLogOdds, NotWhereASideFacesElsewhere) {
  const SensorView view = See(Stack(16), kTruth);
  EXPECT_TRUE(HasShape(MeasureShape(LookAround(view, Stack()).surface, Stack(), kTruth)));
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), kTruth).has_value());
  EXPECT_TRUE(ShapeLogOdds(See(Stack(5), kTruth), Stack(), kTruth).has_value());
}

// The upper box is 20 cm narrower than described: so much of it is seen through.
TEST(ShapeLogOdds, NotWhereMuchIsMissing) {
  const Structure narrow =
      Structure::FromBoxes("narrow", {Standing("low", {0.5, 0.35, 0.4}, {0, 0, 0}),
                                      Standing("high", {0.15, 0.4, 0.3}, {0.15, 0.35, 0})});
  const SensorView view = See(narrow, kTruth);
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), kTruth).has_value());
}

const SidePatch* Largest(const std::vector<SidePatch>& evidence, int label) {
  for (const SidePatch& patch : evidence) {
    if (patch.label == label) return &patch;
  }
  return nullptr;
}

/// A single box seen at 45 deg: both faces are whole, so that centre, normal and area are known in
/// closed form.
class OneBox : public ::testing::Test {
 protected:
  OneBox()
      : structure(
            Structure::FromBoxes("one", {Box::FromMinMax("box", Eigen::Vector3d(-0.25, -0.3, -0.2),
                                                         Eigen::Vector3d(0.25, 0.3, 0.2))})),
        pose(RingPose(45, 2.0, 0.1, 90, Eigen::Vector3d::Zero())),
        rendered(Render(structure, Kinect(), pose)),
        view(MakeSensorView(rendered.depth, Kinect())) {}

  void ExpectExact(const std::vector<SidePatch>& evidence, double tolerance) {
    for (const std::string name : {"box/front", "box/right"}) {
      const int label = LabelOf(structure, name);
      const SidePatch* patch = Largest(evidence, label);
      ASSERT_NE(patch, nullptr) << name;
      const Side& side = structure.SideOfLabel(label);
      EXPECT_LT((pose * patch->centroid - side.centre).norm(), tolerance) << name;
      EXPECT_LT((pose.linear() * patch->normal - side.normal).norm(), tolerance) << name;
      const double area = 4 * side.half_u * side.half_v;
      EXPECT_NEAR(patch->area, area, 0.03 * area) << name;
    }
  }

  Structure structure;
  Pose pose;
  SyntheticView rendered;
  SensorView view;
};

TEST_F(OneBox, GivesCentreNormalAndAreaOfWholeFaces) {
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.003);
}

// Beside the axis a pixel covers more than on it.
TEST_F(OneBox, ThroughALensToo) {
  const Intrinsics lens = KinectWithLens();
  pose = RingPose(45, 2.4, 0.1, 90, Eigen::Vector3d(-0.75, 0, 0.75));
  rendered = Render(structure, lens, pose);
  view = MakeSensorView(rendered.depth, lens);
  const Eigen::Vector3d centre = pose.inverse() * Eigen::Vector3d::Zero();
  EXPECT_GT(centre.head<2>().norm() / centre.z(), 0.4);
  ExpectExact(CollectPatches(view, Certain(rendered.labels), structure), 0.005);
}

TEST_F(OneBox, AHandfulOfFarPixelsHasNoSay) {
  // Isolated and clustered background pixels with a side's label, metres behind it.
  LabelImage labels = rendered.labels;
  const auto front = static_cast<std::uint8_t>(LabelOf(structure, "box/front"));
  RandomStream random(3, 0, "far");
  int spoilt = 0;
  for (int i = 0; i < 400; ++i) {
    const int u = random.Below(320), v = random.Below(288);
    if (labels(u, v) == 0 && view.depth(u, v) > 3) {
      labels(u, v) = front;
      ++spoilt;
    }
  }
  for (const auto [u, v] : Pixels({290, 5}, {310, 15})) {
    labels(u, v) = front;
    if (view.depth(u, v) > 0) ++spoilt;
  }
  ASSERT_GT(spoilt, 100);
  ExpectExact(CollectPatches(view, Certain(labels), structure), 0.005);
}

TEST_F(OneBox, UnsurePixelsAreNotEvidence) {
  SegmentationResult segmentation = Certain(rendered.labels);
  for (float& c : segmentation.confidence) c = 0.49f;
  EXPECT_TRUE(CollectPatches(view, segmentation, structure).empty());
}

TEST(SidePatch, ALabelOnTwoSurfacesGivesBoth) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(20);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  LabelImage labels = rendered.labels;
  const int from = LabelOf(structure, "top/front"), to = LabelOf(structure, "bottom/front");
  for (std::uint8_t& label : labels) {
    if (label == from) label = static_cast<std::uint8_t>(to);
  }
  int patches = 0;
  bool near_top = false, near_bottom = false;
  for (const SidePatch& patch : CollectPatches(view, Certain(labels), structure)) {
    if (patch.label != to) continue;
    ++patches;
    const double height = (pose * patch.centroid).y();
    near_top = near_top || std::abs(height - structure.SideOfLabel(from).centre.y()) < 0.1;
    near_bottom = near_bottom || std::abs(height - structure.SideOfLabel(to).centre.y()) < 0.1;
  }
  EXPECT_EQ(patches, 2);
  EXPECT_TRUE(near_top);
  EXPECT_TRUE(near_bottom);
}

TEST(SidesFixPose, KnowsTheStructuresCollinearKeypoints) {
  const Structure structure = PaperStructure();
  const auto fixes = [&](const std::vector<std::string>& names) {
    return SidesFixPose(structure, LabelsOf(structure, names));
  };
  // Exactly collinear centres, of parallel sides.
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/front", "top/front"}));
  EXPECT_FALSE(fixes({"bottom/right", "mid_bottom/right", "mid_top/right"}));
  EXPECT_FALSE(fixes({"mid_bottom/front"}));
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/right"}));
  EXPECT_FALSE(fixes({}));
  // One side off the line.
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/front", "bottom/front"}));
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/right"}));
  EXPECT_TRUE(fixes({"bottom/right", "mid_bottom/front", "mid_top/up"}));
}

TEST(SidesFixPose, PlanesFixWhatKeypointsInALineDoNot) {
  const auto box = [](const char* name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
    return Box::FromMinMax(name, min, max);
  };
  // Faces of three directions whose centres are (0, 0, 0), (0, 1, 0) and (0, 2, 0).
  const Structure mixed =
      Structure::FromBoxes("mixed", {box("a", {-0.5, -0.25, -0.25}, {0, 0.25, 0.25}),
                                     box("b", {-0.25, 0.75, -0.5}, {0.25, 1.25, 0}),
                                     box("c", {-0.25, 1.5, -0.25}, {0.25, 2, 0.25})});
  const std::vector<int> labels = LabelsOf(mixed, {"a/front", "b/right", "c/up"});
  std::vector<Eigen::Vector3d> centres;
  centres.reserve(labels.size());
  for (const int label : labels) centres.push_back(mixed.SideOfLabel(label).centre);
  ASSERT_LT((centres[1] - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  ASSERT_LT(SecondSingularValue(centres), 1e-9);
  EXPECT_TRUE(SidesFixPose(mixed, labels));
  EXPECT_FALSE(SidesFixPose(mixed, LabelsOf(mixed, {"a/front", "b/right"})));
}

Structure TwoBoxes() {
  return Structure::FromBoxes("stack", {Standing("low", {0.6, 0.3, 0.4}, {0, 0, 0}),
                                        Standing("high", {0.3, 0.4, 0.25}, {0.1, 0.3, -0.05})});
}

const Pose kFitTruth = RingPose(35, 1.9, 1.1, 20, {0, 0.3, 0});

/// Points on the sides that face the sensor, whatever hides them; `away`: along the normal, m.
std::vector<OrientedPoint> Surface(const Structure& structure, double away = 0) {
  std::vector<OrientedPoint> points;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, 0.03)) {
    const Eigen::Vector3d& normal =
        structure.sides()[static_cast<std::size_t>(DistanceToSurface(structure, p).side)].normal;
    if (normal.dot(kFitTruth.translation() - p) > 0) {
      points.push_back({kFitTruth.inverse() * (p + away * normal),
                        kFitTruth.linear().transpose() * normal, 0.03 * 0.03});
    }
  }
  return points;
}

/// The structure moved, and turned about its middle.
Pose Moved(const Eigen::Vector3d& shift, const Eigen::Vector3d& turn) {
  const Eigen::Vector3d middle(0, 0.35, 0);
  Pose moved = Pose::Identity();
  moved.linear() = RotationExp(turn);
  moved.translation() = middle + shift - moved.linear() * middle;
  return moved * kFitTruth;
}

double Off(const Pose& pose) {
  const Eigen::Matrix4d off = (pose * kFitTruth.inverse()).matrix() - Eigen::Matrix4d::Identity();
  return off.cwiseAbs().maxCoeff();
}

TEST(FitToBoxes, BringsPointsOntoTheirSides) {
  RandomStream random(1, 0, "box fit");
  const auto draw = [&](double size) {
    return Eigen::Vector3d{random.Uniform(-size, size), random.Uniform(-size, size),
                           random.Uniform(-size, size)};
  };
  BoxFit fit;
  fit.steps = 30;
  fit.points = 5000;
  for (int k = 0; k < 10; ++k) {
    const Pose start = Moved(draw(0.03), draw(0.05));
    // The least-squares answer is the truth itself, but for the weak prior.
    EXPECT_LT(Off(FitToBoxes(Surface(TwoBoxes()), TwoBoxes(), fit, start)), 2e-4) << k;
  }
}

TEST(FitToBoxes, StaysAtTheTruth) {
  EXPECT_LT(Off(FitToBoxes(Surface(TwoBoxes()), TwoBoxes(), BoxFit(), kFitTruth)), 1e-9);
  // Nothing measured moves nothing.
  EXPECT_LT(Off(FitToBoxes({}, TwoBoxes(), BoxFit(), kFitTruth)), 1e-12);
}

// A third of the points lie 3 cm before their sides: an ordinary mean would be off by 1 cm.
TEST(FitToBoxes, IsRobust) {
  std::vector<OrientedPoint> points = Surface(TwoBoxes());
  const std::vector<OrientedPoint> before = Surface(TwoBoxes(), 0.03);
  for (std::size_t k = 0; k < points.size(); k += 3) points[k] = before[k];
  BoxFit fit;
  fit.steps = 30;
  fit.last_reach = 0.02;
  EXPECT_LT(Off(FitToBoxes(points, TwoBoxes(), fit, kFitTruth)), 1e-3);
}

TEST(FitToBoxes, LeavesOutWhatFacesElsewhereOrIsFar) {
  std::vector<OrientedPoint> points = Surface(TwoBoxes());
  const std::size_t own = points.size();
  for (std::size_t k = 0; k < own; ++k) {
    // On the same places, of surfaces that are turned by 60 deg; and 15 cm away.
    OrientedPoint turned = points[k], far = points[k];
    turned.normal = Eigen::AngleAxisd(M_PI / 3, turned.normal.unitOrthogonal()) * turned.normal;
    turned.p += 0.02 * points[k].normal;
    far.p += 0.15 * points[k].normal;
    points.push_back(turned);
    points.push_back(far);
  }
  BoxFit fit;
  fit.points = 10000;
  // Some of those that are turned face as a neighbouring side does and lie near it.
  EXPECT_LT(Off(FitToBoxes(points, TwoBoxes(), fit, kFitTruth)), 3e-3);
}

// One side, seen head on: it tells its distance and two turns, its border the place along it. Where
// the points end is no border, so that they may slide as long as they stay on the side.
TEST(FitToBoxes, ASidesBorderHoldsItsPoints) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -10; i <= 10; ++i) {
    for (int j = 0; j <= 20; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  BoxFit fit;
  fit.steps = 40;
  fit.points = 10000;
  const auto fitted = [&](const Eigen::Vector3d& shift) -> Eigen::Vector3d {
    return FitToBoxes(points, cube, fit, Pose(Eigen::Translation3d(shift))).translation();
  };
  EXPECT_LT(fitted({0.03, 0, 0}).norm(), 1e-3);
  EXPECT_LT(fitted({0, 0, 0.03}).norm(), 3e-3);
  EXPECT_LT(fitted({0, -0.03, 0}).norm(), 3e-3);
  // Half as wide, they are anywhere on it.
  std::vector<OrientedPoint> some;
  for (const OrientedPoint& point : points) {
    if (std::abs(point.p.z()) < 0.1) some.push_back(point);
  }
  const Pose slid = FitToBoxes(some, cube, fit, Pose(Eigen::Translation3d(0, 0, 0.03)));
  EXPECT_NEAR(slid.translation().z(), 0.03, 1e-3);
}

// The stack hovers 3 cm above the floor that is seen beside it. Its own sides are upright: nothing
// else tells its height.
TEST(FitToBoxes, TheFloorHoldsTheHeight) {
  const Structure cube =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
  std::vector<OrientedPoint> points;
  for (int i = -8; i <= 8; ++i) {
    for (int j = 5; j <= 15; ++j) points.push_back({{0.2, 0.02 * j, 0.02 * i}, {1, 0, 0}, 4e-4});
  }
  for (int i = -20; i <= 20; ++i) {
    for (int j = -20; j <= 20; ++j) {
      if (std::max(std::abs(i), std::abs(j)) > 8)
        points.push_back({{0.04 * i, 0, 0.04 * j}, {0, 1, 0}, 16e-4});
    }
  }
  BoxFit fit;
  fit.steps = 30;
  fit.points = 10000;
  const Pose start(Eigen::Translation3d(0, 0.03, 0));
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0.03, 1e-3);
  fit.floor = true;
  EXPECT_NEAR(FitToBoxes(points, cube, fit, start).translation().y(), 0, 1e-3);
}

}  // namespace
}  // namespace volalign::pose_candidates_test
