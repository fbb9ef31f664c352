#include "infer/checks/arrangements.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>

#include "core/geometry/stack_faults.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

Eigen::Vector3d Centre(const Box& box) { return box.structure_from_box.translation(); }

bool Overlap(const Box& a, const Box& b, int axis) {
  return BoundsOf(a).intersection(BoundsOf(b)).sizes()[axis] > kSamePlace;
}

/// The middle of the area that all footprints share, or of the boxes' middles where they share
/// none.
Eigen::Vector3d ColumnOf(const std::vector<Box>& boxes) {
  Eigen::AlignedBox3d shared = BoundsOf(boxes.front());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Box& box : boxes) {
    shared = shared.intersection(BoundsOf(box));
    mean += Centre(box) / static_cast<double>(boxes.size());
  }
  for (const int axis : {0, 2}) {
    if (shared.sizes()[axis] > 0) mean[axis] = shared.center()[axis];
  }
  return mean;
}

/// The box a quarter turn further about a vertical line, from +x towards +z. Its sides keep the
/// directions that their names say: width and depth change places instead.
Box QuarterTurned(Box box, const Eigen::Vector3d& about) {
  auto centre = box.structure_from_box.translation();
  const Eigen::Vector3d arm = centre - about;
  centre.x() = about.x() - arm.z();
  centre.z() = about.z() + arm.x();
  std::swap(box.size.x(), box.size.z());
  return box;
}

/// Puts each box, in the order of heights, on the highest one under it or on the floor.
std::vector<Box> Settled(std::vector<Box> boxes, double floor) {
  std::vector<std::size_t> order(boxes.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return BoundsOf(boxes[a]).min().y() < BoundsOf(boxes[b]).min().y();
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    Box& box = boxes[order[i]];
    double bottom = floor;
    for (std::size_t j = 0; j < i; ++j) {
      const Box& under = boxes[order[j]];
      if (Overlap(box, under, 0) && Overlap(box, under, 2))
        bottom = std::max(bottom, BoundsOf(under).max().y());
    }
    box.structure_from_box.translation().y() += bottom - BoundsOf(box).min().y();
  }
  return boxes;
}

/// Is every solid of one set in the other, whatever their names?
bool Contained(const std::vector<Box>& a, const std::vector<Box>& b) {
  return std::all_of(a.begin(), a.end(), [&](const Box& box) {
    return std::any_of(b.begin(), b.end(), [&](const Box& other) {
      return (Centre(box) - Centre(other)).norm() < kSamePlace &&
             (BoundsOf(box).sizes() - BoundsOf(other).sizes()).norm() < 2 * kSamePlace;
    });
  });
}

bool SameSolids(const std::vector<Box>& a, const std::vector<Box>& b) {
  return Contained(a, b) && Contained(b, a);
}

std::vector<Box> Mirrored(std::vector<Box> boxes, const Eigen::Vector3d& column) {
  for (Box& box : boxes) {
    auto centre = box.structure_from_box.translation();
    centre.z() = 2 * column.z() - centre.z();
    const Eigen::AngleAxisd turn(Eigen::Quaterniond(box.structure_from_box.linear()));
    box.structure_from_box.linear() =
        Eigen::AngleAxisd(-turn.angle(), turn.axis()).toRotationMatrix();
  }
  return boxes;
}

/// The box on another edge: its new edges are those of these axes. The boxes under it and on it are
/// settled about it.
Box Laid(Box box, const Eigen::Vector3i& axes) {
  const double height = box.size.y();
  box.size = Eigen::Vector3d(box.size[axes[0]], box.size[axes[1]], box.size[axes[2]]);
  box.structure_from_box.translation().y() += (box.size.y() - height) / 2;
  return box;
}

/// Two boxes exchanged, each in its own place beside the column or in the other one's. Each keeps
/// its place in the order of heights.
std::vector<Box> Swapped(std::vector<Box> boxes, std::size_t i, std::size_t j, bool own_place) {
  const std::vector<Box> before = boxes;
  for (const auto& [to, from] : {std::pair{i, j}, std::pair{j, i}}) {
    Box& box = boxes[to];
    const double bottom = BoundsOf(box).min().y();
    box.size = before[from].size;
    if (own_place) box.structure_from_box = before[from].structure_from_box;
    box.structure_from_box.translation().y() += bottom - BoundsOf(box).min().y();
  }
  return boxes;
}

/// The described stack and the other arrangements so far.
class List {
 public:
  explicit List(const Structure& structure)
      : structure_(structure),
        settles_(Contained(Settled(structure.boxes(), structure.FloorHeight()), structure.boxes())),
        list_(1) {
    list_.front().sentence = "the boxes stand as described";
    list_.front().structure = structure;
  }

  /// `about`: the boxes that stand otherwise.
  void Add(SensorCode code, const std::string& sentence, const std::vector<std::size_t>& about,
           std::vector<Box> boxes, int turn_deg = 0) {
    // Boxes that do not rest on each other keep their heights.
    if (settles_) boxes = Settled(std::move(boxes), structure_.FloorHeight());
    const bool missing = code == SensorCode::kAssemblyMissing;
    if (!missing && std::any_of(list_.begin(), list_.end(), [&](const Arrangement& other) {
          return SameSolids(boxes, other.structure.boxes());
        }))
      return;
    Arrangement arrangement;
    arrangement.code = code;
    arrangement.sentence = sentence;
    if (!about.empty()) arrangement.box = structure_.boxes()[about[0]].name;
    if (about.size() > 1) arrangement.other_box = structure_.boxes()[about[1]].name;
    if (!missing) arrangement.moved = about;
    arrangement.turn_deg = turn_deg;
    arrangement.structure = Structure::FromBoxes(structure_.name(), std::move(boxes));
    list_.push_back(std::move(arrangement));
  }

  std::vector<Arrangement> Take() { return std::move(list_); }

 private:
  const Structure& structure_;
  bool settles_;  // do the boxes rest on each other?
  std::vector<Arrangement> list_;
};

}  // namespace

std::vector<Arrangement> Arrangements(const Structure& structure) {
  const std::vector<Box>& described = structure.boxes();
  List list(structure);
  if (!structure.IsOfBoxes()) return list.Take();  // nobody stacks the parts of a mesh
  const Eigen::Vector3d column = ColumnOf(described);
  const auto with = [&](std::size_t i, const Box& box) {
    std::vector<Box> boxes = described;
    boxes[i] = box;
    return boxes;
  };
  for (std::size_t i = 0; described.size() > 1 && i < described.size(); ++i) {
    std::vector<Box> boxes = described;
    boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(i));
    list.Add(SensorCode::kAssemblyMissing, fmt::format("box {} is missing", described[i].name), {i},
             std::move(boxes));
  }
  list.Add(SensorCode::kAssemblyMirrored, "the stack or the frames are mirrored", {},
           Mirrored(described, column));
  for (std::size_t i = 0; i < described.size(); ++i) {
    const auto add = [&](int turn_deg, const Box& box) {
      list.Add(SensorCode::kAssemblyTurned,
               fmt::format("box {} is turned by {} deg", box.name, turn_deg), {i}, with(i, box),
               turn_deg);
    };
    Box turned = described[i];
    for (const int turn_deg : {90, 180, 270}) {
      turned = QuarterTurned(turned, column);
      add(turn_deg, turned);
    }
    add(90, QuarterTurned(described[i], Centre(described[i])));
  }
  for (std::size_t i = 0; i < described.size(); ++i) {
    for (const Eigen::Vector3i& axes : {Eigen::Vector3i(0, 2, 1), Eigen::Vector3i(1, 2, 0),
                                        Eigen::Vector3i(1, 0, 2), Eigen::Vector3i(2, 0, 1)}) {
      list.Add(SensorCode::kAssemblyTurned,
               fmt::format("box {} lies on another edge", described[i].name), {i},
               with(i, Laid(described[i], axes)));
    }
  }
  for (std::size_t i = 0; i < described.size(); ++i) {
    for (std::size_t j = i + 1; j < described.size(); ++j) {
      for (const bool own_place : {true, false}) {
        list.Add(SensorCode::kAssemblySwapped,
                 fmt::format("boxes {} and {} are swapped", described[i].name, described[j].name),
                 {i, j}, Swapped(described, i, j, own_place));
      }
    }
  }
  return list.Take();
}

Arrangement Displaced(const Structure& structure, const std::vector<std::size_t>& moved,
                      const Eigen::Vector3d& offset) {
  std::vector<Box> boxes = structure.boxes();
  Box below = boxes[moved.front()];
  Arrangement arrangement;
  arrangement.box = below.name;
  const std::string what =
      fmt::format("box {}{}", below.name, moved.size() > 1 ? ", with what stands on it," : "");
  for (const std::size_t i : moved) boxes[i].structure_from_box.translation() += offset;
  const double up = offset.y();
  if (up == 0) {
    arrangement.code = SensorCode::kAssemblyShifted;
    arrangement.moved = moved;
    arrangement.sentence = fmt::format("{} is shifted by {:.0f} cm along x and {:.0f} cm along z",
                                       what, 100 * offset.x(), 100 * offset.z());
  } else {
    arrangement.code = SensorCode::kAssemblyHeight;
    arrangement.sentence = fmt::format("{} stands {:.0f} cm {} than described", what,
                                       100 * std::abs(up), up > 0 ? "higher" : "lower");
    if (moved.size() == boxes.size()) {
      arrangement.sentence = fmt::format("box {} stands higher than described", below.name);
      below.name = "below";
      below.structure_from_box.translation().y() += (up - below.size.y()) / 2;
      below.size.y() = up;
      boxes.push_back(std::move(below));
    }
  }
  arrangement.structure = Structure::FromBoxes(structure.name(), std::move(boxes));
  return arrangement;
}

}  // namespace volalign
