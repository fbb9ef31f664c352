// What recorded frames show along their rays (infer/depth), where poses are right and where they
// are wrong: what the figures of the causes are fitted to. tests/bench/cause_shares.py runs it.
//
//   cause_shares STRUCTURE OTHER_STRUCTURE CAPTURE.json EXTRINSICS.json [MODEL.safetensors]
//
// The poses of the extrinsics are taken for right. Wrong ones are those of the structure's
// symmetries, but for those that move every box onto a box, and of turns and steps that are none,
// brought onto the boxes as far as they go, and the best that the other structure has in the same
// frames. Of two sensors, one has such a pose. One line each: "view" or "pair", "right" or "wrong",
// what it is of, cells of surface, before, behind and missing, and of a view cells that the model,
// which knows the structure, has named so and otherwise, and that both label and depth have on the
// structure. Lines of "floor" have cells on the floor and others; wrong are those of the wrong
// poses that stand on another floor. Lines of "sensor" have, for the right pose and each wrong one
// of this structure, what each factor says, log odds by the depths, the outline and the labels of
// the view, by its pairs with all others at theirs, and by the floor, and whether the pose turns
// the structure over.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/capture/capture.h"
#include "infer/depth/explain_view.h"
#include "infer/depth/measured_view.h"
#include "infer/initial/box_fit.h"
#include "infer/initial/floor.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/symmetries.h"
#include "infer/report/extrinsics.h"
#include "infer/segment/load.h"
#include "infer/view/alike.h"

namespace volalign {
namespace {

constexpr double kSigmaOfBoxes = 0.005, kSigmaOfInitialPoses = 0.03;  // m

void Print(const std::string& what, const std::string& of, const CauseShares& causes,
           double named_so = 0, double named_otherwise = 0, double labelled_on = 0) {
  fmt::print("{}\t{}", what, of);
  for (const double cells : causes) fmt::print("\t{:.4f}", cells);
  fmt::print("\t{:.4f}\t{:.4f}\t{:.4f}\n", named_so, named_otherwise, labelled_on);
}

/// Symmetries, turns about the vertical and upside down, and steps of half a box.
std::vector<Pose> WrongMotions(const Structure& structure) {
  std::vector<Pose> motions;
  for (const StructureSymmetry& symmetry : FindSymmetries(structure)) {
    if (symmetry.boxes < static_cast<int>(structure.boxes().size()))
      motions.push_back(symmetry.motion);
  }
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  double edge = 1;
  for (const Box& box : structure.boxes()) {
    middle += box.structure_from_box.translation() / static_cast<double>(structure.boxes().size());
    edge = std::min(edge, box.size.minCoeff());
  }
  const auto about = [&](const Eigen::AngleAxisd& turn) {
    return Pose(Eigen::Translation3d(middle) * turn * Eigen::Translation3d(-middle));
  };
  for (const double turn : {0.5, 1.0, 1.5})
    motions.push_back(about({turn * M_PI, Eigen::Vector3d::UnitY()}));
  motions.push_back(about({M_PI, Eigen::Vector3d::UnitX()}));
  motions.push_back(about({M_PI, Eigen::Vector3d::UnitZ()}));
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0})
      motions.push_back(Pose(Eigen::Translation3d(sign * edge * Eigen::Vector3d::Unit(axis))));
  }
  return motions;
}

struct Sensor {
  std::string name;
  SensorView view;
  Pose pose, initial;
  std::unique_ptr<SegmentationResult> segmentation;  // null without a model
};

/// A motion that moves every box onto a box: nothing tells the pose from what it was.
bool IsSymmetry(const Structure& structure, const Pose& from, const Pose& to) {
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
  return std::any_of(symmetries.begin(), symmetries.end(), [&](const StructureSymmetry& symmetry) {
    return symmetry.boxes == static_cast<int>(structure.boxes().size()) &&
           SamePose(structure, symmetry.motion * from, to);
  });
}

/// Returns the wrong poses of this structure.
std::vector<Pose> MeasureViews(const Sensor& sensor, const Structure& structure,
                               const Structure& other) {
  const auto print = [&](const std::string& what, const Structure& seen, const Pose& pose) {
    const ViewExplanation view =
        ExplainView(sensor.view, &seen == &structure ? sensor.segmentation.get() : nullptr, seen,
                    pose, kSigmaOfBoxes);
    Print(what, sensor.name, view.causes, view.named_so, view.named_otherwise, view.labelled_on);
  };
  print("view\tright", structure, sensor.pose);
  const std::vector<OrientedPoint> points = PointsOf(LookAround(sensor.view, structure).surface);
  std::vector<Pose> wrong;
  for (const Pose& motion : WrongMotions(structure)) {
    Pose pose = FitToBoxes(points, structure, BoxFit(), motion * sensor.pose);
    pose = FitToBoxes(points, structure, {4, 1500, 0.05, 0.03, false}, pose);
    if (SamePose(structure, pose, sensor.pose) || IsSymmetry(structure, sensor.pose, pose))
      continue;
    const bool known = std::any_of(wrong.begin(), wrong.end(), [&](const Pose& each) {
      return SamePose(structure, pose, each);
    });
    if (!known) wrong.push_back(pose);
  }
  for (const Pose& pose : wrong) print("view\twrong", structure, pose);
  const auto found = FindBestOnFloors(LookAround(sensor.view, other), other);
  if (found) print("view\twrong", other, found->structure_from_sensor);
  return wrong;
}

/// Of one sensor, all others being where they are.
void MeasureSensor(const std::vector<Sensor>& sensors, std::size_t i,
                   const std::vector<Pose>& wrong, const Structure& structure) {
  const Sensor& sensor = sensors[i];
  std::vector<Pose> poses{sensor.pose};
  poses.insert(poses.end(), wrong.begin(), wrong.end());
  const MeasuredView own(sensor.view, structure, poses);
  std::vector<CauseShares> between(poses.size());
  for (std::size_t j = 0; j < sensors.size(); ++j) {
    if (j == i) continue;
    const MeasuredView other(sensors[j].view, structure, {sensors[j].pose});
    for (std::size_t k = 0; k < poses.size(); ++k) {
      const CauseShares pair =
          ExplainPair(own, other, poses[k].inverse() * sensors[j].pose, kSigmaOfInitialPoses);
      for (std::size_t cause = 0; cause < kCauses; ++cause) between[k][cause] += pair[cause];
    }
  }
  const std::vector<FloorFit> floors = FindFloors(sensor.view, structure, poses);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const ViewExplanation view =
        ExplainView(sensor.view, sensor.segmentation.get(), structure, poses[k], kSigmaOfBoxes);
    const std::string pose = k == 0 ? "right" : "wrong";
    fmt::print("sensor\t{}\t{}\t{:.4f}\t{:.4f}\t{:.4f}\t{:.4f}\t{:.4f}\t{}\n", pose, sensor.name,
               view.LogOddsByDepth(), view.LogOddsByOutline(), view.LogOddsByLabels(),
               LogOddsOfPairs(between[k]), floors[k].LogOdds(), TurnsOver(poses[0], poses[k]));
    const Pose motion = poses[k] * poses[0].inverse();
    const bool same_floor =
        motion.linear()(1, 1) >= kFacesAlike && std::abs(motion.translation().y()) <= kFarthestOff;
    if (k > 0 && same_floor) continue;
    const double of_pixel = floors[k].cells / std::max(floors[k].pixels, 1);
    fmt::print("floor\t{}\t{}\t{:.4f}\t{:.4f}\n", pose, sensor.name, of_pixel * floors[k].on_floor,
               of_pixel * (floors[k].pixels - floors[k].on_floor));
  }
}

void MeasurePairs(const std::vector<Sensor>& sensors, const Structure& structure) {
  const std::vector<Pose> motions = WrongMotions(structure);
  std::vector<std::unique_ptr<MeasuredView>> views;
  for (const Sensor& sensor : sensors) {
    std::vector<Pose> poses{sensor.initial};
    for (const Pose& motion : motions) poses.push_back(motion * sensor.initial);
    views.push_back(std::make_unique<MeasuredView>(sensor.view, structure, poses));
  }
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto print = [&](const std::string& what, const Pose& pose) {
        Print(what, sensors[i].name + " " + sensors[j].name,
              ExplainPair(*views[i], *views[j], pose.inverse() * sensors[j].initial,
                          kSigmaOfInitialPoses));
      };
      print("pair\tright", sensors[i].initial);
      for (const Pose& motion : motions) print("pair\twrong", motion * sensors[i].initial);
    }
  }
}

void Run(const std::vector<std::string>& arguments) {
  const Structure structure = ReadStructure(arguments.at(0)),
                  other = ReadStructure(arguments.at(1));
  const CaptureFile capture = ReadCapture(arguments.at(2));
  const Extrinsics extrinsics = ReadExtrinsics(arguments.at(3));
  const std::unique_ptr<Segmenter> segmenter =
      arguments.size() > 4 ? LoadNetworkSegmenter(arguments[4]) : nullptr;
  std::vector<Sensor> sensors;
  for (const SensorFrame& frame : capture.sensors) {
    for (const Extrinsics::Sensor& placed : extrinsics.sensors) {
      if (placed.name != frame.name || !placed.structure_from_sensor) continue;
      sensors.push_back({frame.name, MakeSensorView(frame, placed.intrinsics),
                         *placed.structure_from_sensor, placed.initial, nullptr});
      if (!segmenter) continue;
      sensors.back().segmentation = std::make_unique<SegmentationResult>(
          segmenter->Segment(frame.depth, placed.intrinsics, placed.quarter_turns));
    }
  }
  for (std::size_t i = 0; i < sensors.size(); ++i)
    MeasureSensor(sensors, i, MeasureViews(sensors[i], structure, other), structure);
  MeasurePairs(sensors, structure);
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) { volalign::Run({argv + 1, argv + argc}); }
