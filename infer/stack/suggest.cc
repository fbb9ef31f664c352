#include "infer/stack/suggest.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <mutex>
#include <optional>
#include <sstream>
#include <utility>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/parallel_for.h"
#include "core/base/random.h"
#include "core/base/text.h"
#include "core/geometry/stack_faults.h"

namespace volalign {

namespace {

constexpr double kStep = 0.01;   // m: overhangs are whole steps
constexpr int kMostDraws = 400;  // of a candidate, until one bears the tilt
/// The middles of two boxes are apart by at most this share of the distance at which the boxes
/// would part. The share falls evenly from the first draw to the last, because high towers bear
/// little.
constexpr double kMostApart = 0.7;
/// Views of a candidate: an odd number of directions has no two that are opposite.
const TargetViewOptions kCandidateViews = [] {
  TargetViewOptions views;
  views.heights_m = {1.5};
  views.directions = 9;
  return views;
}();

/// The faults of a stack, the most important first; smaller is better.
using Badness = std::array<double, 4>;

Badness BadnessOf(const TargetQuality& quality) {
  Badness badness{};
  for (const TargetView& view : quality.views) {
    const bool alike =
        std::any_of(view.look_alike.begin(), view.look_alike.end(), [&](int symmetry) {
          return !quality.symmetries[static_cast<std::size_t>(symmetry)].floor_tells;
        });
    badness[0] += alike;
    badness[1] += !view.sides_fix_pose;
    badness[2] += !view.look_alike.empty();
    badness[3] = std::max(badness[3], view.weakest_m);
  }
  return badness;
}

/// The edges with one of them upright (y).
Eigen::Vector3d Turned(const Eigen::Vector3d& size, int upright, bool swapped) {
  Eigen::Vector3d turned(size[(upright + 1) % 3], size[upright], size[(upright + 2) % 3]);
  if (swapped) std::swap(turned.x(), turned.z());
  return turned;
}

double Whole(double metres) { return kStep * std::round(metres / kStep); }

/// Draws a tower no higher than `most_height`; if all lie flat, the boxes have to be no higher. The
/// first one's middle is at x = z = 0 and its lower side at y = 0. `apart`: see kMostApart.
std::vector<Box> DrawTower(const std::vector<Eigen::Vector3d>& sizes, double most_height,
                           double apart, RandomStream* random) {
  double spare = most_height;
  for (const Eigen::Vector3d& size : sizes) spare -= size.minCoeff();
  std::vector<Box> boxes;
  Eigen::Vector3d at = Eigen::Vector3d::Zero(), below = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    int upright = random->Below(3);
    while (sizes[i][upright] - sizes[i].minCoeff() > spare) upright = (upright + 1) % 3;
    spare -= sizes[i][upright] - sizes[i].minCoeff();
    const Eigen::Vector3d size = Turned(sizes[i], upright, random->Chance(0.5));
    for (const int axis : {0, 2}) {
      const double reach = apart * (size[axis] + below[axis]) / 2;
      const double drawn = random->Uniform(-reach, reach);
      // Whole steps lie between edges, which people measure, not between middles.
      const double half = (size[axis] - below[axis]) / 2;
      if (i > 0) at[axis] += Whole(drawn + half) - half;
    }
    boxes.push_back(Box::FromMinMax(fmt::format("box_{}", i + 1),
                                    at - Eigen::Vector3d(size.x() / 2, 0, size.z() / 2),
                                    at + Eigen::Vector3d(size.x() / 2, size.y(), size.z() / 2)));
    at.y() += size.y();
    below = size;
  }
  return boxes;
}

struct Carton {
  int count = 1;
  Eigen::Vector3d edges_mm;
};

/// Reads "600x400x400" or "3x 600x400x400", with blanks about the numbers. None for anything else.
std::optional<Carton> ReadCarton(const std::string& text) {
  constexpr double kMost = 1e6;  // mm, and boxes
  std::vector<double> numbers;
  for (const std::string& part : Split(text, 'x')) {
    std::istringstream stream(part);
    std::string word, more;
    if (!(stream >> word) || stream >> more) return std::nullopt;
    const std::optional<double> number = NumberOf(word);
    if (!number || !(*number > 0 && *number < kMost)) return std::nullopt;
    numbers.push_back(*number);
  }
  if (numbers.size() == 3) numbers.insert(numbers.begin(), 1);
  if (numbers.size() != 4 || numbers[0] != std::floor(numbers[0])) return std::nullopt;
  return Carton{static_cast<int>(numbers[0]), {numbers[1], numbers[2], numbers[3]}};
}

}  // namespace

std::vector<Eigen::Vector3d> ParseBoxes(const std::string& text) {
  std::vector<Eigen::Vector3d> sizes;
  for (const std::string& part : Split(text, ',')) {
    const std::optional<Carton> carton = ReadCarton(part);
    if (!carton) {
      throw DataError(
          fmt::format("cannot read the boxes '{}'; expected is a list such as '3x 600x400x400, "
                      "400x300x250': how "
                      "many, and the three edges in millimetres",
                      Shortened(part)));
    }
    if (sizes.size() + static_cast<std::size_t>(carton->count) >
        static_cast<std::size_t>(kMaxBoxes)) {
      throw DataError(fmt::format("more than {} boxes; labels of sides are 8-bit", kMaxBoxes));
    }
    sizes.insert(sizes.end(), static_cast<std::size_t>(carton->count), carton->edges_mm * 1e-3);
  }
  if (sizes.empty()) throw DataError("no box is named");
  return sizes;
}

double TiltOfTower(const std::vector<Box>& boxes) {
  double least = std::numeric_limits<double>::infinity();
  double mass = 0;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (std::size_t i = boxes.size(); i-- > 0;) {
    const Eigen::AlignedBox3d box = BoundsOf(boxes[i]);
    mass += box.volume();
    moment += box.volume() * box.center();
    const Eigen::Vector3d middle = moment / mass;
    Eigen::AlignedBox3d joint = box;
    if (i > 0) {
      const Eigen::AlignedBox3d below = BoundsOf(boxes[i - 1]);
      joint.min() = joint.min().cwiseMax(below.min());
      joint.max() = joint.max().cwiseMin(below.max());
    }
    for (const int axis : {0, 2}) {
      const double inside =
          std::min(middle[axis] - joint.min()[axis], joint.max()[axis] - middle[axis]);
      least = std::min(least, std::atan2(inside, middle.y() - box.min().y()));
    }
  }
  return least / kDegree;
}

SuggestedStack SuggestStack(const std::string& name, const std::vector<Eigen::Vector3d>& sizes,
                            const SuggestOptions& options, const CountDone& count) {
  std::vector<Eigen::Vector3d> sorted = sizes;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.prod() > b.prod(); });
  double flat = 0;
  for (const Eigen::Vector3d& size : sorted) flat += size.minCoeff();
  if (flat > options.height_m) {
    throw DataError(fmt::format(
        "the boxes are {:.2f} m high even if all lie flat, and the stack may have {:.2f} m; leave "
        "boxes out or allow a higher stack (--height)",
        flat, options.height_m));
  }

  struct Candidate {
    std::vector<Box> boxes;
    Badness badness{};
  };
  std::vector<std::optional<Candidate>> candidates(static_cast<std::size_t>(options.candidates));
  std::mutex mutex;
  std::int64_t done = 0;
  const auto add = [&](std::int64_t more) {
    const std::lock_guard<std::mutex> lock(mutex);
    done += more;
    if (count) count(done, options.candidates);
  };
  add(0);
  ParallelFor(candidates.size(), options.threads, [&](std::size_t i) {
    RandomStream random(0, i, "suggest");
    for (int draw = 0; draw < kMostDraws; ++draw) {
      const double apart = kMostApart * (1 - static_cast<double>(draw) / kMostDraws);
      std::vector<Box> boxes = DrawTower(sorted, options.height_m, apart, &random);
      if (TiltOfTower(boxes) < options.tilt_deg) continue;
      const Structure structure = Structure::FromBoxes(name, boxes);
      candidates[i] = {std::move(boxes), BadnessOf(MeasureTarget(structure, kCandidateViews))};
      break;
    }
    add(1);
  });
  const Candidate* best = nullptr;
  for (const std::optional<Candidate>& candidate : candidates) {
    if (candidate && (!best || candidate->badness < best->badness)) best = &*candidate;
  }
  if (!best) {
    throw DataError(
        fmt::format("none of {} towers of these boxes stands until the floor is tilted by {:g} "
                    "deg: they are too "
                    "narrow for their height; leave boxes out",
                    options.candidates * kMostDraws, options.tilt_deg));
  }

  std::vector<Box> boxes = best->boxes;
  const double up = 1e-3 * std::round(-500 * Structure::FromBoxes(name, boxes).Height());
  for (Box& box : boxes) box.structure_from_box.translation().y() += up;
  SuggestedStack suggested;
  suggested.structure = Structure::FromBoxes(name, boxes);
  suggested.quality = MeasureTarget(suggested.structure);
  suggested.tilt_deg = TiltOfTower(boxes);
  return suggested;
}

}  // namespace volalign
