#include "infer/checks/assembly.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/parallel_for.h"
#include "core/visibility.h"
#include "infer/pose/agreement.h"

namespace volalign {

namespace {

constexpr double kSamePlace = 0.02;  // m: boxes that are nearer than this are in the same place

Eigen::Vector3d Centre(const Box& box) { return box.structure_from_box.translation(); }

/// Half extents, structure axes, of a box's bounding box.
Eigen::Vector3d HalfExtent(const Box& box) {
  return box.structure_from_box.linear().cwiseAbs() * box.size / 2;
}

bool Overlap(const Box& a, const Box& b, int axis) {
  return std::abs(Centre(a)[axis] - Centre(b)[axis]) <
         HalfExtent(a)[axis] + HalfExtent(b)[axis] - kSamePlace;
}

/// Middle of what all boxes' footprints share, or of the boxes' middles where they share nothing.
Eigen::Vector3d ColumnOf(const std::vector<Box>& boxes) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(-1e9), high = Eigen::Vector3d::Constant(1e9);
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

/// Puts each box, in the order of their heights, on the highest one under it or on the floor.
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

/// The same solids in the same places, whatever their names.
bool SameSolids(const std::vector<Box>& a, const std::vector<Box>& b) {
  return std::all_of(a.begin(), a.end(), [&](const Box& box) {
    return std::any_of(b.begin(), b.end(), [&](const Box& other) {
      return (Centre(box) - Centre(other)).norm() < kSamePlace &&
             (HalfExtent(box) - HalfExtent(other)).norm() < kSamePlace;
    });
  });
}

class ArrangementList {
 public:
  explicit ArrangementList(const Structure& structure)
      : structure_(structure), boxes_(structure.boxes()), column_(ColumnOf(boxes_)) {
    Arrangement described;
    described.sentence = "the boxes stand as described";
    described.structure = structure;
    list_.push_back(std::move(described));
    // Stacks that hold together otherwise than by resting on each other keep their heights.
    stacked_ = SameSolids(Settled(boxes_, structure.FloorHeight()), boxes_);
  }

  std::vector<Arrangement> Take() {
    AddMissing();
    AddMirrored();
    AddTurned();
    AddSwapped();
    return std::move(list_);
  }

 private:
  bool Add(Arrangement arrangement, std::vector<Box> boxes) {
    if (stacked_) boxes = Settled(std::move(boxes), structure_.FloorHeight());
    for (const Arrangement& known : list_) {
      if (SameSolids(boxes, known.structure.boxes()) && SameSolids(known.structure.boxes(), boxes))
        return false;
    }
    arrangement.structure =
        Structure::FromBoxes(structure_.name(), std::move(boxes), structure_.SideNames());
    list_.push_back(std::move(arrangement));
    return true;
  }

  void AddMissing() {
    if (boxes_.size() < 2) return;
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      std::vector<Box> rest = boxes_;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      if (stacked_) rest = Settled(std::move(rest), structure_.FloorHeight());
      // Labels stay as they are: a speck inside another box has the name, and is never seen.
      Box speck = boxes_[i];
      speck.size.setConstant(1e-3);
      speck.structure_from_box.translation() = Centre(rest.front());
      rest.insert(rest.begin() + static_cast<std::ptrdiff_t>(i), speck);
      Arrangement arrangement;
      arrangement.code = SensorCode::kAssemblyMissing;
      arrangement.box = boxes_[i].name;
      arrangement.sentence = fmt::format("box {} is missing", boxes_[i].name);
      arrangement.structure =
          Structure::FromBoxes(structure_.name(), std::move(rest), structure_.SideNames());
      list_.push_back(std::move(arrangement));
    }
  }

  void AddMirrored() {
    // Both mirror images are the same solid; which one the labels of the described stack name half
    // a turn apart is the network's choice.
    for (const int axis : {2, 0}) {
      std::vector<Box> boxes = boxes_;
      for (Box& box : boxes) {
        auto centre = box.structure_from_box.translation();
        centre[axis] = 2 * column_[axis] - centre[axis];
        const Eigen::AngleAxisd turn(Eigen::Quaterniond(box.structure_from_box.linear()));
        box.structure_from_box.linear() =
            Eigen::AngleAxisd(-turn.angle(), turn.axis()).toRotationMatrix();
      }
      Arrangement arrangement;
      arrangement.code = SensorCode::kAssemblyMirrored;
      arrangement.sentence = "the stack is mirrored";
      Add(std::move(arrangement), std::move(boxes));
    }
  }

  void AddTurned() {
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      std::vector<Box> boxes = boxes_;
      for (int quarter = 1; quarter < 4; ++quarter) {
        boxes[i] = QuarterTurned(boxes[i], column_);
        AddTurn(i, quarter, boxes);
      }
      boxes[i] = QuarterTurned(boxes_[i], Centre(boxes_[i]));
      AddTurn(i, 1, boxes);
    }
  }

  void AddTurn(std::size_t i, int quarters, std::vector<Box> boxes) {
    Arrangement arrangement;
    arrangement.code = SensorCode::kAssemblyTurned;
    arrangement.box = boxes_[i].name;
    arrangement.turn_deg = 90 * quarters;
    arrangement.sentence = fmt::format("box {} is turned by {} deg", boxes_[i].name, 90 * quarters);
    Add(std::move(arrangement), std::move(boxes));
  }

  void AddSwapped() {
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      for (std::size_t j = i + 1; j < boxes_.size(); ++j) {
        // Each takes the other's footprint and height, and its own place in the order.
        std::vector<Box> boxes = boxes_;
        for (const auto& [to, from] : {std::pair{i, j}, std::pair{j, i}}) {
          Box& box = boxes[to];
          const double bottom = Centre(box).y() - HalfExtent(box).y();
          box.size = boxes_[from].size;
          box.structure_from_box = boxes_[from].structure_from_box;
          box.structure_from_box.translation().y() = bottom + HalfExtent(box).y();
        }
        Arrangement arrangement;
        arrangement.code = SensorCode::kAssemblySwapped;
        arrangement.box = boxes_[i].name;
        arrangement.other_box = boxes_[j].name;
        arrangement.sentence =
            fmt::format("boxes {} and {} are swapped", boxes_[i].name, boxes_[j].name);
        Add(std::move(arrangement), std::move(boxes));
      }
    }
  }

  const Structure& structure_;
  std::vector<Box> boxes_;
  Eigen::Vector3d column_;
  bool stacked_ = false;
  std::vector<Arrangement> list_;
};

/// A view of about 10 000 rays.
struct SmallView {
  SensorView view;
  SegmentationResult segmentation;
  const InitialPose* initial = nullptr;
  int labelled = 0;
};

SmallView MakeSmall(const AssemblySensor& sensor) {
  const int stride = std::max(1, static_cast<int>(std::floor(std::sqrt(
                                     static_cast<double>(sensor.view->depth.size()) / 10000))));
  SmallView small{Decimate(*sensor.view, stride),
                  {DecimateImage(sensor.segmentation->labels, stride),
                   DecimateImage(sensor.segmentation->confidence, stride)},
                  sensor.initial,
                  0};
  for (std::size_t i = 0; i < small.view.depth.size(); ++i)
    small.labelled += small.segmentation.labels[i] > 0 && small.view.depth[i] > 0 ? 1 : 0;
  return small;
}

/// The overlap at a pose; none where there is no pose, or one upside down.
DepthOverlap OverlapAt(const SmallView& small, const Structure& structure, const InitialPose& pose,
                       double min_confidence) {
  if (pose.found && FindFloor(small.view, structure, pose.structure_from_sensor).balance() >= 0) {
    return MeasureOverlap(small.view, small.segmentation, structure, pose.structure_from_sensor,
                          min_confidence);
  }
  DepthOverlap none;
  none.either = small.labelled;
  return none;
}

/// The same up to a turn of the whole stack by quarters.
bool SameTurnedSolids(const std::vector<Box>& a, std::vector<Box> b) {
  const Eigen::Vector3d column_a = ColumnOf(a);
  for (int quarter = 0; quarter < 4; ++quarter) {
    const Eigen::Vector3d column_b = ColumnOf(b);
    const Eigen::Vector3d shift(column_a.x() - column_b.x(), 0, column_a.z() - column_b.z());
    for (Box& box : b) {
      box.structure_from_box.translation() += shift;
    }
    if (SameSolids(a, b) && SameSolids(b, a)) return true;
    for (Box& box : b) box = QuarterTurned(box, column_a);
  }
  return false;
}

/// The whole stack a quarter turn further; sides are named by the directions that they face.
Structure QuarterTurned(const Structure& structure) {
  std::vector<Box> boxes = structure.boxes();
  const Eigen::Vector3d column = ColumnOf(boxes);
  for (Box& box : boxes) box = QuarterTurned(box, column);
  return Structure::FromBoxes(structure.name(), std::move(boxes), structure.SideNames());
}

/// Over all sensors, of each arrangement.
std::vector<DepthOverlap> Sums(const std::vector<DepthOverlap>& parts, std::size_t sensors) {
  std::vector<DepthOverlap> sums(parts.size() / sensors);
  for (std::size_t k = 0; k < parts.size(); ++k) {
    sums[k / sensors].both += parts[k].both;
    sums[k / sensors].either += parts[k].either;
  }
  return sums;
}

/// Without the specks that stand for missing boxes.
std::vector<Box> Visible(const std::vector<Box>& boxes) {
  std::vector<Box> visible;
  for (const Box& box : boxes) {
    if (box.size.minCoeff() > kSamePlace) visible.push_back(box);
  }
  return visible;
}

}  // namespace

std::vector<Arrangement> Arrangements(const Structure& structure) {
  return ArrangementList(structure).Take();
}

AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads,
                               std::size_t max_sensors) {
  std::vector<SmallView> views;
  for (const AssemblySensor& sensor : sensors) views.push_back(MakeSmall(sensor));
  std::stable_sort(views.begin(), views.end(),
                   [](const SmallView& a, const SmallView& b) { return a.labelled > b.labelled; });
  if (views.size() > max_sensors) views.resize(max_sensors);

  AssemblyReport report;
  report.arrangement.sentence = "the boxes stand as described";
  report.arrangement.structure = structure;
  const double confidence = initial.evidence.min_confidence;
  DepthOverlap described;
  for (const SmallView& small : views) {
    const DepthOverlap part = OverlapAt(small, structure, *small.initial, confidence);
    described.both += part.both;
    described.either += part.either;
  }
  report.described_overlap = report.overlap = described.ratio();
  if (views.empty() || described.ratio() >= options.suspicious_overlap) return report;

  std::vector<Arrangement> arrangements = Arrangements(structure);
  const auto try_structure = [&](const SmallView& small, const Structure& other) {
    const InitialPose pose = EstimateInitialPose(small.view, small.segmentation, other, initial);
    return OverlapAt(small, other, pose, confidence);
  };
  const std::size_t count = views.size();
  std::vector<DepthOverlap> parts(arrangements.size() * count);
  ParallelFor(parts.size(), threads, [&](std::size_t k) {
    parts[k] = try_structure(views[k % count], arrangements[k / count].structure);
  });
  std::vector<DepthOverlap> sums = Sums(parts, count);

  // A network that knows one stack may take a side of another for that of its neighbour: labels
  // that are a quarter turn off. The described and the best others get a pose for these too.
  constexpr std::size_t kBest = 8;
  constexpr double kGood = 0.9;
  std::vector<std::size_t> order(arrangements.size() - 1);
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k + 1;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t x, std::size_t y) { return sums[x].ratio() > sums[y].ratio(); });
  if (order.size() > kBest) order.resize(kBest);
  order.push_back(0);
  ParallelFor(order.size() * count, threads, [&](std::size_t k) {
    const std::size_t which = order[k / count];
    DepthOverlap& part = parts[which * count + k % count];
    Structure turned = arrangements[which].structure;
    for (int quarter = 1; quarter < 4 && part.ratio() < kGood; ++quarter) {
      turned = QuarterTurned(turned);
      const DepthOverlap other = try_structure(views[k % count], turned);
      if (other.ratio() > part.ratio()) part = other;
    }
  });
  sums = Sums(parts, count);
  // The pose search on fewer pixels may do better or worse than on all: the best counts.
  report.described_overlap = report.overlap = std::max(described.ratio(), sums.front().ratio());
  std::size_t best = 0;
  for (std::size_t k = 1; k < sums.size(); ++k) {
    if (best == 0 || sums[k].ratio() > sums[best].ratio()) best = k;
  }
  for (std::size_t k = 1; k < sums.size(); ++k) {
    if (k != best) report.runner_up = std::max(report.runner_up, sums[k].ratio());
  }
  if (best > 0 && sums[best].ratio() >= options.min_overlap &&
      sums[best].ratio() >= report.described_overlap + options.margin) {
    report.overlap = sums[best].ratio();
    report.arrangement = arrangements[best];
    // A stack without its highest box may be the one without its lowest, seen from the next side.
    const std::vector<Box> found = Visible(arrangements[best].structure.boxes());
    for (std::size_t k = 1; k < arrangements.size(); ++k) {
      if (k == best || arrangements[k].sentence == arrangements[best].sentence) continue;
      if (SameTurnedSolids(found, Visible(arrangements[k].structure.boxes())))
        report.arrangement.sentence += " or " + arrangements[k].sentence;
    }
  }
  return report;
}

}  // namespace volalign
