#include "infer/initial/stack_votes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Measured share of a cell from which on it counts in full.
constexpr double kFullCell = 0.5;

/// Ways in which a surface may face: up, or into one of the sectors of the horizon. The inside of a
/// structure counts against all of them.
constexpr int kSectors = 8, kUp = kSectors, kInside = kSectors + 1, kWays = kSectors + 2;

/// The way that a normal faces, room frame; -1: down, or between up and aside.
int WayOf(const Eigen::Vector3d& normal) {
  if (normal.y() > kFacesUp) return kUp;
  if (std::abs(normal.y()) > kFacesAside) return -1;
  return static_cast<int>(std::floor(Heading(normal) / (2 * M_PI / kSectors) + kSectors)) %
         kSectors;
}

std::size_t ListOf(int slab, int way) {
  return static_cast<std::size_t>(slab) * kWays + static_cast<std::size_t>(way);
}

}  // namespace

Votes::Votes(const StackOutline& outline)
    : outline_(outline),
      reach_(static_cast<int>(std::ceil(outline.radius / outline.cell)) + 2),
      width_(2 * reach_ + 1),
      sums_(static_cast<std::size_t>(outline.slabs * kWays * width_ * width_), 0.0f),
      lists_(static_cast<std::size_t>(outline.slabs * kWays)) {}

void Votes::Make(const std::vector<StackPiece>& pieces, double yaw) {
  const double c = std::cos(yaw), s = std::sin(yaw);
  for (const StackPiece& piece : pieces) {
    const double x = (c * piece.x + s * piece.z) / outline_.cell;
    const double z = (-s * piece.x + c * piece.z) / outline_.cell;
    if (piece.kind != StackPiece::kSide) {
      Add(piece.slab, piece.kind == StackPiece::kTop ? kUp : kInside, x, z, piece.weight);
      continue;
    }
    // It counts for the sector that it faces and for the nearer neighbour.
    const double sector = (piece.heading - yaw) / (2 * M_PI / kSectors) + 3 * kSectors;
    const auto lower = static_cast<int>(sector - 0.5);
    Add(piece.slab, lower % kSectors, x, z, piece.weight);
    Add(piece.slab, (lower + 1) % kSectors, x, z, piece.weight);
  }
  Collect();
}

const std::vector<Vote>& Votes::Of(int slab, int way) const { return lists_[ListOf(slab, way)]; }

/// Distributes a weight over the four cells round a place.
void Votes::Add(int slab, int way, double x, double z, double weight) {
  const int ix = static_cast<int>(std::floor(x)), iz = static_cast<int>(std::floor(z));
  const double fx = x - ix, fz = z - iz;
  const auto width = static_cast<std::size_t>(width_);
  for (int k = 0; k < 4; ++k) {
    const int u = ix + (k & 1) + reach_, v = iz + (k >> 1) + reach_;
    if (u < 0 || v < 0 || u >= width_ || v >= width_) continue;
    const std::size_t at = (ListOf(slab, way) * width + static_cast<std::size_t>(v)) * width +
                           static_cast<std::size_t>(u);
    if (sums_[at] == 0) touched_.push_back(at);
    sums_[at] += static_cast<float>(weight * (k & 1 ? fx : 1 - fx) * (k >> 1 ? fz : 1 - fz));
  }
}

void Votes::Collect() {
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

std::vector<OccupiedCell> FindOccupied(const std::vector<OrientedPoint>& points,
                                       const StackOutline& outline, double foot,
                                       const Eigen::Matrix3d& room) {
  using Cell = std::array<int, 4>;  // slab, way, z, x
  std::vector<std::pair<Cell, double>> areas;
  for (const OrientedPoint& point : points) {
    if (point.p.z() > kFarthest) continue;
    const Eigen::Vector3d p = room * point.p;
    const double height = p.y() - foot;
    const int slab = outline.SlabAt(height), way = WayOf(room * point.normal);
    if (height < kRoughPose || !outline.Has(slab) || way < 0) continue;
    areas.push_back({{slab, way, static_cast<int>(std::lround(p.z() / outline.cell)),
                      static_cast<int>(std::lround(p.x() / outline.cell))},
                     point.area});
  }
  std::sort(areas.begin(), areas.end());
  std::vector<OccupiedCell> occupied;
  for (std::size_t i = 0; i < areas.size();) {
    const auto [slab, way, z, x] = areas[i].first;
    double area = 0;
    for (const Cell cell = areas[i].first; i < areas.size() && areas[i].first == cell; ++i)
      area += areas[i].second;
    const double full = kFullCell * outline.cell * (way == kUp ? outline.cell : outline.slab);
    occupied.push_back({x, z, slab, way, static_cast<float>(std::min(1.0, area / full))});
  }
  return occupied;
}

VoteMap::VoteMap(const std::vector<OccupiedCell>& occupied, const StackOutline& outline) {
  if (occupied.empty()) return;
  const int margin = static_cast<int>(std::ceil(outline.radius / outline.cell)) + 3;
  x0_ = z0_ = std::numeric_limits<int>::max();
  int x1 = std::numeric_limits<int>::min(), z1 = x1;
  for (const OccupiedCell& cell : occupied) {
    x0_ = std::min(x0_, cell.x - margin);
    z0_ = std::min(z0_, cell.z - margin);
    x1 = std::max(x1, cell.x + margin);
    z1 = std::max(z1, cell.z + margin);
  }
  width_ = x1 - x0_ + 1;
  height_ = z1 - z0_ + 1;
  map_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
}

void VoteMap::Count(const std::vector<OccupiedCell>& occupied, const Votes& votes) {
  std::fill(map_.begin(), map_.end(), 0.0f);
  struct Place {
    int offset;  // in the map, from the measured cell
    float weight;
  };
  std::vector<Place> places;
  for (std::size_t i = 0; i < occupied.size();) {
    const int slab = occupied[i].slab, own_way = occupied[i].way;
    places.clear();
    for (const int way : {own_way, kInside}) {
      for (const Vote& vote : votes.Of(slab, way))
        places.push_back({-(vote.dz * width_ + vote.dx), vote.weight});
    }
    for (; i < occupied.size() && occupied[i].slab == slab && occupied[i].way == own_way; ++i) {
      const float weight = occupied[i].weight;
      float* const at = &map_[Index(occupied[i].x, occupied[i].z)];
      for (const Place& place : places) at[place.offset] += weight * place.weight;
    }
  }
}

void VoteMap::AppendPeaks(int turn, int foot, float* most, std::vector<Peak>* peaks) const {
  using Row = Eigen::Map<const Eigen::ArrayXf>;
  std::vector<float> highest;  // of each row
  for (int z = 0; z < height_; ++z) {
    highest.push_back(Row(&map_[Index(x0_, z + z0_)], width_).maxCoeff());
    *most = std::max(*most, highest.back());
  }
  const auto least = std::max(0.0f, static_cast<float>(kLeastVotes) * *most);
  for (int z = 1; z + 1 < height_; ++z) {
    if (!(highest[static_cast<std::size_t>(z)] > least)) continue;
    for (int x = 1; x + 1 < width_; ++x) {
      const float* at = &map_[Index(x + x0_, z + z0_)];
      if (!(*at > least)) continue;
      if (at[-1] > *at || at[1] >= *at || at[-width_] > *at || at[width_] >= *at) continue;
      peaks->push_back({*at, x + x0_, z + z0_, turn, foot});
    }
  }
}

std::size_t VoteMap::Index(int x, int z) const {
  return static_cast<std::size_t>(z - z0_) * static_cast<std::size_t>(width_) +
         static_cast<std::size_t>(x - x0_);
}

}  // namespace volalign
