#include "infer/checks/arrangements.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <tuple>
#include <utility>

#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Beyond every structure, m.
constexpr double kFar = std::numeric_limits<double>::max();

Eigen::Vector3d Centre(const Box& box) { return box.structure_from_box.translation(); }

/// Half extents, structure axes, of a box's bounding box.
Eigen::Vector3d HalfExtent(const Box& box) {
  return box.structure_from_box.linear().cwiseAbs() * box.size / 2;
}

bool Overlap(const Box& a, const Box& b, int axis) {
  return std::abs(Centre(a)[axis] - Centre(b)[axis]) <
         HalfExtent(a)[axis] + HalfExtent(b)[axis] - kSamePlace;
}

/// The middle of the area that all footprints share, or of the boxes' middles where they share
/// none.
Eigen::Vector3d ColumnOf(const std::vector<Box>& boxes) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(-kFar), high = Eigen::Vector3d::Constant(kFar);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Box& box : boxes) {
    low = low.cwiseMax(Centre(box) - HalfExtent(box));
    high = high.cwiseMin(Centre(box) + HalfExtent(box));
    mean += Centre(box) / static_cast<double>(boxes.size());
  }
  for (const int axis : {0, 2}) {
    if (high[axis] > low[axis]) mean[axis] = (low[axis] + high[axis]) / 2;
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
    return Centre(boxes[a]).y() - HalfExtent(boxes[a]).y() <
           Centre(boxes[b]).y() - HalfExtent(boxes[b]).y();
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    Box& box = boxes[order[i]];
    double bottom = floor;
    for (std::size_t j = 0; j < i; ++j) {
      const Box& under = boxes[order[j]];
      if (Overlap(box, under, 0) && Overlap(box, under, 2))
        bottom = std::max(bottom, Centre(under).y() + HalfExtent(under).y());
    }
    box.structure_from_box.translation().y() = bottom + HalfExtent(box).y();
  }
  return boxes;
}

/// Is every solid of one set in the other, whatever their names?
bool Contained(const std::vector<Box>& a, const std::vector<Box>& b) {
  return std::all_of(a.begin(), a.end(), [&](const Box& box) {
    return std::any_of(b.begin(), b.end(), [&](const Box& other) {
      return (Centre(box) - Centre(other)).norm() < kSamePlace &&
             (HalfExtent(box) - HalfExtent(other)).norm() < kSamePlace;
    });
  });
}

bool SameSolids(const std::vector<Box>& a, const std::vector<Box>& b) {
  return Contained(a, b) && Contained(b, a);
}

/// The described stack.
struct Stack {
  const Structure& structure;
  std::vector<Box> boxes;
  Eigen::Vector3d column;
  /// Do the boxes rest on each other? Else the stack keeps its heights.
  bool settles = false;
};

std::vector<Box> Settled(std::vector<Box> boxes, const Stack& stack) {
  return stack.settles ? Settled(std::move(boxes), stack.structure.FloorHeight()) : boxes;
}

Arrangement WithBoxes(Arrangement arrangement, std::vector<Box> boxes, const Stack& stack) {
  arrangement.structure = Structure::FromBoxes(stack.structure.name(), std::move(boxes));
  return arrangement;
}

std::vector<Arrangement> Missing(const Stack& stack) {
  std::vector<Arrangement> list;
  if (stack.boxes.size() < 2) return list;
  for (std::size_t i = 0; i < stack.boxes.size(); ++i) {
    std::vector<Box> boxes = stack.boxes;
    boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(i));
    Arrangement arrangement;
    arrangement.code = SensorCode::kAssemblyMissing;
    arrangement.box = stack.boxes[i].name;
    arrangement.sentence = fmt::format("box {} is missing", arrangement.box);
    list.push_back(WithBoxes(std::move(arrangement), Settled(std::move(boxes), stack), stack));
  }
  return list;
}

std::vector<Arrangement> Mirrored(const Stack& stack) {
  std::vector<Arrangement> list;
  std::vector<Box> boxes = stack.boxes;
  for (Box& box : boxes) {
    auto centre = box.structure_from_box.translation();
    centre.z() = 2 * stack.column.z() - centre.z();
    const Eigen::AngleAxisd turn(Eigen::Quaterniond(box.structure_from_box.linear()));
    box.structure_from_box.linear() =
        Eigen::AngleAxisd(-turn.angle(), turn.axis()).toRotationMatrix();
  }
  Arrangement arrangement;
  arrangement.code = SensorCode::kAssemblyMirrored;
  arrangement.sentence = "the stack or the frames are mirrored";
  list.push_back(WithBoxes(std::move(arrangement), Settled(std::move(boxes), stack), stack));
  return list;
}

Arrangement Turned(const Stack& stack, std::size_t i, int quarters, std::vector<Box> boxes) {
  Arrangement arrangement;
  arrangement.code = SensorCode::kAssemblyTurned;
  arrangement.box = stack.boxes[i].name;
  arrangement.moved = {i};
  arrangement.turn_deg = 90 * quarters;
  arrangement.sentence =
      fmt::format("box {} is turned by {} deg", arrangement.box, arrangement.turn_deg);
  return WithBoxes(std::move(arrangement), Settled(std::move(boxes), stack), stack);
}

std::vector<Arrangement> Turned(const Stack& stack) {
  std::vector<Arrangement> list;
  for (std::size_t i = 0; i < stack.boxes.size(); ++i) {
    std::vector<Box> boxes = stack.boxes;
    for (int quarters = 1; quarters < 4; ++quarters) {
      boxes[i] = QuarterTurned(boxes[i], stack.column);
      list.push_back(Turned(stack, i, quarters, boxes));
    }
    boxes[i] = QuarterTurned(stack.boxes[i], Centre(stack.boxes[i]));
    list.push_back(Turned(stack, i, 1, boxes));
  }
  return list;
}

/// A box with another edge upright, turned either way.
std::vector<Arrangement> Laid(const Stack& stack) {
  std::vector<Arrangement> list;
  for (std::size_t i = 0; i < stack.boxes.size(); ++i) {
    const Eigen::Vector3d& size = stack.boxes[i].size;
    for (const auto& [x, y, z] :
         {std::tuple(0, 2, 1), std::tuple(1, 2, 0), std::tuple(1, 0, 2), std::tuple(2, 0, 1)}) {
      // The boxes under it and on it are settled about it.
      std::vector<Box> boxes = stack.boxes;
      boxes[i].size = {size[x], size[y], size[z]};
      boxes[i].structure_from_box.translation().y() += (size[y] - size.y()) / 2;
      Arrangement arrangement;
      arrangement.code = SensorCode::kAssemblyTurned;
      arrangement.box = stack.boxes[i].name;
      arrangement.moved = {i};
      arrangement.sentence = fmt::format("box {} lies on another edge", arrangement.box);
      list.push_back(WithBoxes(std::move(arrangement), Settled(std::move(boxes), stack), stack));
    }
  }
  return list;
}

std::vector<Arrangement> Swapped(const Stack& stack) {
  std::vector<Arrangement> list;
  for (std::size_t i = 0; i < stack.boxes.size(); ++i) {
    for (std::size_t j = i + 1; j < stack.boxes.size(); ++j) {
      for (const bool own_place : {true, false}) {
        // Each keeps its place in the order of heights.
        std::vector<Box> boxes = stack.boxes;
        for (const auto& [to, from] : {std::pair{i, j}, std::pair{j, i}}) {
          Box& box = boxes[to];
          const double bottom = Centre(box).y() - HalfExtent(box).y();
          box.size = stack.boxes[from].size;
          if (own_place) box.structure_from_box = stack.boxes[from].structure_from_box;
          box.structure_from_box.translation().y() = bottom + HalfExtent(box).y();
        }
        Arrangement arrangement;
        arrangement.code = SensorCode::kAssemblySwapped;
        arrangement.box = stack.boxes[i].name;
        arrangement.other_box = stack.boxes[j].name;
        arrangement.moved = {i, j};
        arrangement.sentence =
            fmt::format("boxes {} and {} are swapped", arrangement.box, arrangement.other_box);
        list.push_back(WithBoxes(std::move(arrangement), Settled(std::move(boxes), stack), stack));
      }
    }
  }
  return list;
}

}  // namespace

std::vector<Arrangement> Arrangements(const Structure& structure) {
  Stack stack{structure, structure.boxes(), ColumnOf(structure.boxes()), false};
  stack.settles = Contained(Settled(stack.boxes, structure.FloorHeight()), stack.boxes);

  std::vector<Arrangement> list(1);
  list.front().sentence = "the boxes stand as described";
  list.front().structure = structure;
  std::vector<Arrangement> missing = Missing(stack);
  std::move(missing.begin(), missing.end(), std::back_inserter(list));
  for (std::vector<Arrangement> others :
       {Mirrored(stack), Turned(stack), Laid(stack), Swapped(stack)}) {
    for (Arrangement& arrangement : others) {
      const bool known = std::any_of(list.begin(), list.end(), [&](const Arrangement& other) {
        return SameSolids(arrangement.structure.boxes(), other.structure.boxes());
      });
      if (!known) list.push_back(std::move(arrangement));
    }
  }
  return list;
}

std::vector<std::size_t> BoxesAbove(const Structure& structure, std::size_t box) {
  const std::vector<Box>& boxes = structure.boxes();
  const double top = Centre(boxes[box]).y() + HalfExtent(boxes[box]).y();
  std::vector<std::size_t> above;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    if (Centre(boxes[i]).y() - HalfExtent(boxes[i]).y() > top - kSamePlace) above.push_back(i);
  }
  return above;
}

Arrangement Displaced(const Structure& structure, const std::vector<std::size_t>& boxes,
                      const Eigen::Vector3d& offset) {
  Arrangement arrangement;
  arrangement.box = structure.boxes()[boxes.front()].name;
  arrangement.moved = boxes;
  std::vector<Pose> motions(structure.boxes().size(), Pose::Identity());
  for (const std::size_t i : boxes) motions[i] = Eigen::Translation3d(offset);
  arrangement.structure = structure.Displaced(motions);
  arrangement.code = SensorCode::kAssemblyShifted;
  arrangement.sentence = fmt::format(
      "box {}{} is shifted by {:.0f} cm along x and {:.0f} cm along z", arrangement.box,
      boxes.size() > 1 ? ", with what stands on it," : "", 100 * offset.x(), 100 * offset.z());
  return arrangement;
}

Arrangement Raised(const Structure& structure, const std::vector<std::size_t>& boxes, double up) {
  std::vector<Box> all = structure.boxes();
  Box below = all[boxes.front()];
  Arrangement arrangement;
  arrangement.code = SensorCode::kAssemblyHeight;
  arrangement.box = below.name;
  arrangement.sentence = fmt::format("box {}{} stands {:.0f} cm {} than described", arrangement.box,
                                     boxes.size() > 1 ? ", with what stands on it," : "",
                                     100 * std::abs(up), up > 0 ? "higher" : "lower");
  for (const std::size_t i : boxes) all[i].structure_from_box.translation().y() += up;
  if (boxes.size() == all.size()) {
    below.name = "below";
    below.structure_from_box.translation().y() += (up - below.size.y()) / 2;
    below.size.y() = up;
    all.push_back(std::move(below));
    arrangement.sentence = fmt::format("box {} stands higher than described", arrangement.box);
  }
  arrangement.structure = Structure::FromBoxes(structure.name(), std::move(all));
  return arrangement;
}

}  // namespace volalign
