#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "infer/initial/oriented_points.h"
#include "infer/initial/stack_outline.h"

namespace volalign {

/// A measured cell's vote for a place of the structure, at an offset in cells. The weight is that
/// of the structure's piece there.
struct Vote {
  int dx, dz;
  float weight;
};

/// The votes of every cell, by its slab and the way that it faces.
class Votes {
 public:
  explicit Votes(const StackOutline& outline);

  /// For the structure turned by `yaw`, rad.
  void Make(const std::vector<StackPiece>& pieces, double yaw);

  const std::vector<Vote>& Of(int slab, int way) const;

 private:
  void Add(int slab, int way, double x, double z, double weight);
  void Collect();

  const StackOutline& outline_;
  int reach_, width_;
  std::vector<float> sums_;
  std::vector<std::size_t> touched_;
  std::vector<std::vector<Vote>> lists_;
};

/// A cell with measured surface.
struct OccupiedCell {
  int x, z, slab, way;
  float weight;
};

/// The measured cells at the height of the structure's slabs above `foot`, m, by slab and way.
/// `room`: the turn from the sensor into a frame whose y is up.
std::vector<OccupiedCell> FindOccupied(const std::vector<OrientedPoint>& points,
                                       const StackOutline& outline, double foot,
                                       const Eigen::Matrix3d& room);

/// A place of the structure with its votes, in cells, and the indices of turn and foot.
struct Peak {
  float votes;
  int x, z, turn, foot;
};

/// Share of the highest score that a candidate needs.
inline constexpr double kLeastVotes = 0.5;

/// Votes of one turn for each place.
class VoteMap {
 public:
  VoteMap(const std::vector<OccupiedCell>& occupied, const StackOutline& outline);

  void Count(const std::vector<OccupiedCell>& occupied, const Votes& votes);

  /// Appends the local maxima that have at least kLeastVotes of the most votes so far.
  void AppendPeaks(int turn, int foot, float* most, std::vector<Peak>* peaks) const;

 private:
  std::size_t Index(int x, int z) const;

  int x0_ = 0, z0_ = 0, width_ = 0, height_ = 0;
  std::vector<float> map_;
};

}  // namespace volalign
