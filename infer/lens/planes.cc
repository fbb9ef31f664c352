#include "infer/lens/planes.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr int kSamples = 8;           // of a block, along each side
constexpr double kLeastFilled = 0.7;  // share of a block's samples that have depth
constexpr double kFlat = 0.004;  // rms distance of a patch's points from its plane, of depth, and m
constexpr double kMostBent = 0.006;  // smallest by middle variance of a patch
constexpr double kStep = 2 * kFlat;  // distance of one neighbour from the other's plane, of depth
constexpr double kLeastStep = kClearly * kFlat;  // m
constexpr double kPixelsPerError = 2;            // neighbouring pixels have about the same error

struct Patch {
  PlanePatch patch;
  Eigen::Vector3d normal;
  double picture_area;  // of its block
};

/// The plane through the samples of the block whose first pixel is (u, v), if they are flat.
std::optional<Patch> FitPatch(const SensorView& view, int u, int v) {
  const int stride = std::max(1, kBlock / kSamples);
  std::vector<Eigen::Vector3d> points;
  int looked_at = 0;
  double picture_area = 0;
  for (int y = v + stride / 2; y < v + kBlock; y += stride) {
    for (int x = u + stride / 2; x < u + kBlock; x += stride) {
      ++looked_at;
      picture_area += stride * stride * view.ray_areas(x, y);
      const double z = view.depth(x, y);
      if (z > 0 && z < kFarthest) points.push_back(view.Point(x, y));
    }
  }
  const auto count = static_cast<double>(points.size());
  if (count < kLeastFilled * looked_at) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p;
  mean /= count;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) covariance += (p - mean) * (p - mean).transpose();
  covariance /= count;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  const double variance = std::max(solver.eigenvalues()[0], 0.0);
  const double flat = kFlat * std::max(1.0, mean.z());
  if (!(variance < flat * flat) || !(variance < kMostBent * solver.eigenvalues()[1]))
    return std::nullopt;
  const Eigen::Vector3d normal = solver.eigenvectors().col(0);
  if (std::abs(normal.dot(mean)) < kGrazing * mean.norm()) return std::nullopt;
  return Patch{{mean, kPixelsPerError * variance / count}, normal, picture_area};
}

/// Are these neighbours on one surface?
bool Continues(const Patch& a, const Patch& b) {
  const double cosine = std::abs(a.normal.dot(b.normal));
  const Eigen::Vector3d d = b.patch.p - a.patch.p;
  const double step = std::max(kLeastStep, kStep * std::min(a.patch.p.z(), b.patch.p.z()));
  return cosine > kSameDirection && std::abs(a.normal.dot(d)) < step &&
         std::abs(b.normal.dot(d)) < step;
}

/// The patches of an image on a grid of blocks, and the surface of each.
class PatchGrid {
 public:
  explicit PatchGrid(const SensorView& view)
      : columns_(view.width() / kBlock), rows_(view.height() / kBlock) {
    for (int row = 0; row < rows_; ++row) {
      for (int column = 0; column < columns_; ++column) {
        patches_.push_back(FitPatch(view, column * kBlock, row * kBlock));
      }
    }
    taken_.assign(patches_.size(), false);
  }

  int size() const { return static_cast<int>(patches_.size()); }

  /// The patches that steps on the same surface reach from one. Empty if that one is taken.
  LargePlane Grow(int seed) {
    LargePlane plane;
    if (!patches_[Index(seed)] || taken_[Index(seed)]) return plane;
    std::vector<int> open = {seed};
    taken_[Index(seed)] = true;
    while (!open.empty()) {
      const int at = open.back();
      open.pop_back();
      const int column = at % columns_, row = at / columns_;
      plane.patches.push_back(patches_[Index(at)]->patch);
      plane.picture_area += patches_[Index(at)]->picture_area;
      for (const auto& [dx, dy] : kBeside) {
        const int x = column + dx, y = row + dy;
        if (x < 0 || y < 0 || x >= columns_ || y >= rows_) continue;
        const int next = y * columns_ + x;
        if (taken_[Index(next)] || !patches_[Index(next)] ||
            !Continues(*patches_[Index(at)], *patches_[Index(next)]))
          continue;
        taken_[Index(next)] = true;
        open.push_back(next);
      }
    }
    return plane;
  }

 private:
  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }

  int columns_, rows_;
  std::vector<std::optional<Patch>> patches_;
  std::vector<bool> taken_;
};

}  // namespace

std::vector<LargePlane> FindLargePlanes(const SensorView& view, double min_picture_area) {
  PatchGrid grid(view);
  std::vector<LargePlane> planes;
  for (int seed = 0; seed < grid.size(); ++seed) {
    LargePlane plane = grid.Grow(seed);
    if (plane.picture_area >= min_picture_area) planes.push_back(std::move(plane));
  }
  return planes;
}

}  // namespace volalign
