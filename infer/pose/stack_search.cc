#include "infer/pose/stack_search.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "core/visibility.h"

namespace volalign {

namespace {

/// Slabs of the lowest box.
constexpr double kSlabsPerBox = 3;
constexpr double kLeastCell = 0.015, kMostCell = 0.06;  // m
constexpr double kLeastSlab = 0.04, kMostSlab = 0.2;    // m
constexpr double kLeastYawStep = 3 * M_PI / 180;
constexpr int kMostSlabs = 24;

/// What a measured cell counts that lies inside the structure.
constexpr double kInsideVote = -1.5;
/// Inside begins so many cells behind the surface.
constexpr double kInsideDepth = 1.3;
/// A cell counts in full when so much of it was measured.
constexpr double kFullCell = 0.5;
/// m: nearer to the foot there is the floor.
constexpr double kFloorDistance = 0.04;
/// m: surfaces farther from the sensor are not looked at.
constexpr double kFarthest = 8;

/// Ways in which a surface may face: up, or one of the sectors of the horizon.
/// The inside of a structure counts against all of them.
constexpr int kSectors = 8, kUp = kSectors, kInside = kSectors + 1, kWays = kSectors + 2;
constexpr double kFacesUp = 0.75, kFacesAside = 0.5;  // of a normal's upward part

/// Of the highest score, what a candidate needs.
constexpr double kLeastVotes = 0.5;
/// Candidates nearer than this, in cells and in steps of the turn, are one.
constexpr double kSameCells = 2.5, kSameSteps = 2.5;

/// Direction of a normal in the horizontal plane.
double Heading(const Eigen::Vector3d& normal) { return std::atan2(normal.z(), normal.x()); }

int SlabOf(const StackOutline& outline, double height) {
  return static_cast<int>(std::floor(height / outline.slab));
}

bool InSlabs(const StackOutline& outline, int slab) { return slab >= 0 && slab < outline.slabs; }

bool Within(const Structure& structure, const Eigen::Vector3d& p) {
  return std::any_of(structure.boxes().begin(), structure.boxes().end(), [&](const Box& box) {
    const Eigen::Vector3d local = box.structure_from_box.inverse() * p;
    return (local.cwiseAbs().array() <= box.size.array() / 2).all();
  });
}

std::vector<StackPiece> Pieces(const Structure& structure, const StackOutline& outline) {
  std::vector<StackPiece> pieces;
  const double area = outline.cell * outline.cell;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, outline.cell)) {
    const int side = DistanceToSurface(structure, p).side;
    const Eigen::Vector3d& normal = structure.sides()[static_cast<std::size_t>(side)].normal;
    const Eigen::Vector3d local = p - outline.foot;
    const bool top = normal.y() > kFacesUp;
    if (!top && std::abs(normal.y()) > kFacesAside) continue;
    // A top counts for the slab in which it is measured, a little below or above it.
    const int slab = SlabOf(outline, local.y() - (top ? outline.slab / 8 : 0));
    if (!InSlabs(outline, slab)) continue;
    pieces.push_back({local.x(), local.z(), slab, Heading(normal),
                      top ? StackPiece::kTop : StackPiece::kSide,
                      top ? 1.0 : area / (outline.cell * outline.slab)});
  }
  for (int slab = 0; slab < outline.slabs; ++slab) {
    for (double x = -outline.radius; x < outline.radius; x += outline.cell) {
      for (double z = -outline.radius; z < outline.radius; z += outline.cell) {
        const Eigen::Vector3d local(x, (slab + 0.5) * outline.slab, z);
        const Eigen::Vector3d p = outline.foot + local;
        if (!Within(structure, p)) continue;
        if (DistanceToSurface(structure, p).distance < kInsideDepth * outline.cell) continue;
        pieces.push_back({x, z, slab, 0, StackPiece::kInside, kInsideVote});
      }
    }
  }
  return pieces;
}

struct Vote {
  int dx, dz;
  float weight;
};

/// What a measured cell votes for, by its slab and the way that it faces.
class Votes {
 public:
  Votes(const StackOutline& outline)
      : outline_(outline),
        reach_(static_cast<int>(std::ceil(outline.radius / outline.cell)) + 2),
        width_(2 * reach_ + 1),
        sums_(static_cast<std::size_t>(outline.slabs * kWays * width_ * width_), 0.0f),
        lists_(static_cast<std::size_t>(outline.slabs * kWays)) {}

  void Make(const std::vector<StackPiece>& pieces, double yaw) {
    const double c = std::cos(yaw), s = std::sin(yaw);
    for (const StackPiece& piece : pieces) {
      const double x = (c * piece.x + s * piece.z) / outline_.cell;
      const double z = (-s * piece.x + c * piece.z) / outline_.cell;
      if (piece.kind != StackPiece::kSide) {
        Add(piece.slab, piece.kind == StackPiece::kTop ? kUp : kInside, x, z, piece.weight);
        continue;
      }
      // To the sector that it faces, and the nearer one of its neighbours.
      const double sector = (piece.heading - yaw) / (2 * M_PI / kSectors) + 3 * kSectors;
      Add(piece.slab, static_cast<int>(sector - 0.5) % kSectors, x, z, piece.weight);
      Add(piece.slab, static_cast<int>(sector + 0.5) % kSectors, x, z, piece.weight);
    }
    Collect();
  }

  const std::vector<Vote>& Of(int slab, int way) const {
    return lists_[static_cast<std::size_t>(slab * kWays + way)];
  }

 private:
  /// To the four cells round a place.
  void Add(int slab, int way, double x, double z, double weight) {
    const int ix = static_cast<int>(std::floor(x)), iz = static_cast<int>(std::floor(z));
    const double fx = x - ix, fz = z - iz;
    for (int k = 0; k < 4; ++k) {
      const int u = ix + (k & 1) + reach_, v = iz + (k >> 1) + reach_;
      if (u < 0 || v < 0 || u >= width_ || v >= width_) continue;
      const std::size_t at =
          static_cast<std::size_t>(((slab * kWays + way) * width_ + v) * width_ + u);
      if (sums_[at] == 0) touched_.push_back(at);
      sums_[at] += static_cast<float>(weight * (k & 1 ? fx : 1 - fx) * (k >> 1 ? fz : 1 - fz));
    }
  }

  void Collect() {
    for (std::vector<Vote>& list : lists_) list.clear();
    for (const std::size_t at : touched_) {
      const auto cell = static_cast<int>(at % static_cast<std::size_t>(width_ * width_));
      const float weight = std::clamp(sums_[at], static_cast<float>(kInsideVote), 1.0f);
      sums_[at] = 0;
      if (weight == 0) continue;
      lists_[at / static_cast<std::size_t>(width_ * width_)].push_back(
          {cell % width_ - reach_, cell / width_ - reach_, weight});
    }
    touched_.clear();
  }

  const StackOutline& outline_;
  int reach_, width_;
  std::vector<float> sums_;
  std::vector<std::size_t> touched_;
  std::vector<std::vector<Vote>> lists_;
};

/// A cell with measured surface.
struct Occupied {
  int x, z, slab, way;
  float weight;
};

/// The way that a normal of the room faces; -1: down, or between up and aside.
int WayOf(const Eigen::Vector3d& normal) {
  if (normal.y() > kFacesUp) return kUp;
  if (std::abs(normal.y()) > kFacesAside) return -1;
  return static_cast<int>(std::floor(Heading(normal) / (2 * M_PI / kSectors) + kSectors)) %
         kSectors;
}

/// A cell as one number, and back.
constexpr int kKeyBits = 20, kKeyMiddle = 1 << (kKeyBits - 1);
std::uint64_t Key(int slab_and_way, int z, int x) {
  const auto part = [](int value) { return static_cast<std::uint64_t>(value + kKeyMiddle); };
  return (static_cast<std::uint64_t>(slab_and_way) << kKeyBits | part(z)) << kKeyBits | part(x);
}
Occupied CellOf(std::uint64_t key) {
  const auto part = [&](int shift) {
    return static_cast<int>(key >> shift & ((1u << kKeyBits) - 1)) - kKeyMiddle;
  };
  const auto slab_and_way = static_cast<int>(key >> (2 * kKeyBits));
  return {part(0), part(kKeyBits), slab_and_way / kWays, slab_and_way % kWays, 0};
}

std::vector<Occupied> FindOccupied(const std::vector<OrientedPoint>& points,
                                   const StackOutline& outline, double foot,
                                   const Eigen::Matrix3d& room) {
  std::vector<std::pair<std::uint64_t, double>> areas;
  for (const OrientedPoint& point : points) {
    if (point.p.z() > kFarthest) continue;
    const Eigen::Vector3d p = room * point.p;
    const double height = p.y() - foot;
    if (height < kFloorDistance || !InSlabs(outline, SlabOf(outline, height))) continue;
    const int way = WayOf(room * point.normal);
    if (way < 0) continue;
    areas.emplace_back(Key(SlabOf(outline, height) * kWays + way,
                           static_cast<int>(std::lround(p.z() / outline.cell)),
                           static_cast<int>(std::lround(p.x() / outline.cell))),
                       point.area);
  }
  std::sort(areas.begin(), areas.end());
  std::vector<Occupied> occupied;
  for (std::size_t i = 0; i < areas.size();) {
    const std::uint64_t key = areas[i].first;
    double area = 0;
    for (; i < areas.size() && areas[i].first == key; ++i) area += areas[i].second;
    Occupied cell = CellOf(key);
    const double full = kFullCell * outline.cell * (cell.way == kUp ? outline.cell : outline.slab);
    cell.weight = static_cast<float>(std::min(1.0, area / full));
    occupied.push_back(cell);
  }
  return occupied;
}

/// A place of the structure with its votes, in cells and the indices of turn and foot.
struct Peak {
  float votes;
  int x, z, turn, foot;
};

/// Votes of one turn for each place.
class VoteMap {
 public:
  VoteMap(const std::vector<Occupied>& occupied, const StackOutline& outline) {
    if (occupied.empty()) return;
    const int margin = static_cast<int>(std::ceil(outline.radius / outline.cell)) + 3;
    x0_ = z0_ = std::numeric_limits<int>::max();
    int x1 = std::numeric_limits<int>::min(), z1 = x1;
    for (const Occupied& cell : occupied) {
      x0_ = std::min(x0_, cell.x - margin);
      z0_ = std::min(z0_, cell.z - margin);
      x1 = std::max(x1, cell.x + margin);
      z1 = std::max(z1, cell.z + margin);
    }
    width_ = x1 - x0_ + 1;
    height_ = z1 - z0_ + 1;
    map_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
  }

  void Count(const std::vector<Occupied>& occupied, const Votes& votes) {
    std::fill(map_.begin(), map_.end(), 0.0f);
    for (const Occupied& cell : occupied) {
      float* const at = &map_[Index(cell.x, cell.z)];
      for (const int way : {cell.way, kInside}) {
        for (const Vote& vote : votes.Of(cell.slab, way)) {
          at[-(static_cast<std::ptrdiff_t>(vote.dz) * width_ + vote.dx)] +=
              cell.weight * vote.weight;
        }
      }
    }
  }

  /// Appends the highest places of their surroundings that have at least a share of the most votes
  /// so far.
  void AppendPeaks(int turn, int foot, float* most, std::vector<Peak>* peaks) const {
    for (const float votes : map_) *most = std::max(*most, votes);
    for (int z = 1; z + 1 < height_; ++z) {
      for (int x = 1; x + 1 < width_; ++x) {
        const float* at = &map_[static_cast<std::size_t>(z) * static_cast<std::size_t>(width_) +
                                static_cast<std::size_t>(x)];
        if (!(*at > kLeastVotes * *most) || !(*at > 0)) continue;
        if (at[-1] > *at || at[1] >= *at || at[-width_] > *at || at[width_] >= *at) continue;
        peaks->push_back({*at, x + x0_, z + z0_, turn, foot});
      }
    }
  }

 private:
  std::size_t Index(int x, int z) const {
    return static_cast<std::size_t>(z - z0_) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x - x0_);
  }

  int x0_ = 0, z0_ = 0, width_ = 0, height_ = 0;
  std::vector<float> map_;
};

std::vector<Peak> Distinct(std::vector<Peak> peaks, std::size_t most, std::size_t turns,
                           bool every_turn) {
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Peak& a, const Peak& b) { return a.votes > b.votes; });
  std::vector<Peak> distinct;
  for (const Peak& peak : peaks) {
    if (distinct.size() == most || peak.votes < kLeastVotes * peaks.front().votes) break;
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Peak& other) {
      int steps = std::abs(peak.turn - other.turn);
      if (every_turn) steps = std::min(steps, static_cast<int>(turns) - steps);
      return peak.foot == other.foot &&
             std::hypot(peak.x - other.x, peak.z - other.z) < kSameCells &&
             (every_turn ? steps < kSameSteps : steps == 0);
    });
    if (!known) distinct.push_back(peak);
  }
  return distinct;
}

std::vector<double> Turns(const StackOutline& outline, const StandingGuess& guess) {
  if (!guess.yaws.empty()) return guess.yaws;
  const int count = static_cast<int>(std::ceil(2 * M_PI / outline.yaw_step));
  std::vector<double> turns;
  for (int k = 0; k < count; ++k) turns.push_back(2 * M_PI * k / count);
  return turns;
}

}  // namespace

StackOutline MakeStackOutline(const Structure& structure, double cells) {
  double smallest = std::numeric_limits<double>::infinity(), lowest = smallest;
  Eigen::AlignedBox3d bounds;
  for (const Box& box : structure.boxes()) {
    smallest = std::min(smallest, box.size.minCoeff());
    lowest = std::min(lowest, box.size.y());
    for (int k = 0; k < 8; ++k) {
      const Eigen::Vector3d sign(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
      bounds.extend(box.structure_from_box * Eigen::Vector3d(sign.cwiseProduct(box.size) / 2));
    }
  }
  StackOutline outline;
  outline.foot = bounds.center();
  outline.foot.y() = structure.FloorHeight();
  outline.radius = std::hypot(bounds.sizes().x(), bounds.sizes().z()) / 2;
  outline.cell = std::clamp(smallest / cells, kLeastCell, kMostCell);
  outline.slab = std::clamp(lowest / kSlabsPerBox, kLeastSlab, kMostSlab);
  outline.slab = std::max(outline.slab, structure.Height() / kMostSlabs);
  outline.slabs = static_cast<int>(std::ceil(structure.Height() / outline.slab + 0.1));
  outline.yaw_step = std::max(outline.cell / outline.radius, kLeastYawStep);
  outline.pieces = Pieces(structure, outline);
  return outline;
}

Eigen::Matrix3d RoomFromSensor(const Eigen::Vector3d& up) {
  Eigen::Matrix3d room;
  const Eigen::Vector3d x = up.unitOrthogonal();
  room << x.transpose(), up.transpose(), x.cross(up).transpose();
  return room;
}

std::vector<StackCandidate> SearchStack(const std::vector<OrientedPoint>& points,
                                        const StackOutline& outline, const StandingGuess& guess,
                                        std::size_t most) {
  const Eigen::Matrix3d room = RoomFromSensor(guess.up);
  std::vector<std::vector<Occupied>> occupied;
  std::vector<VoteMap> maps;
  for (const double foot : guess.feet) {
    occupied.push_back(FindOccupied(points, outline, foot, room));
    maps.emplace_back(occupied.back(), outline);
  }
  const std::vector<double> turns = Turns(outline, guess);
  Votes votes(outline);
  std::vector<Peak> peaks;
  float highest = 0;
  for (std::size_t k = 0; k < turns.size(); ++k) {
    votes.Make(outline.pieces, turns[k]);
    for (std::size_t f = 0; f < maps.size(); ++f) {
      if (occupied[f].empty()) continue;
      maps[f].Count(occupied[f], votes);
      maps[f].AppendPeaks(static_cast<int>(k), static_cast<int>(f), &highest, &peaks);
    }
  }
  std::vector<StackCandidate> candidates;
  for (const Peak& peak : Distinct(std::move(peaks), most, turns.size(), guess.yaws.empty())) {
    Pose room_from_structure = Pose::Identity();
    room_from_structure.linear() =
        Eigen::AngleAxisd(turns[static_cast<std::size_t>(peak.turn)], Eigen::Vector3d::UnitY())
            .toRotationMatrix();
    room_from_structure.translation() =
        Eigen::Vector3d(peak.x * outline.cell, guess.feet[static_cast<std::size_t>(peak.foot)],
                        peak.z * outline.cell) -
        room_from_structure.linear() * outline.foot;
    Pose room_from_sensor = Pose::Identity();
    room_from_sensor.linear() = room;
    candidates.push_back({room_from_structure.inverse() * room_from_sensor, peak.votes});
  }
  return candidates;
}

}  // namespace volalign
