#include "infer/initial/side_patch.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

#include "core/base/random.h"
#include "core/base/statistics.h"
#include "infer/depth/surface_tolerance.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Least ratio of twice a triangle's area to the square of its longest side.
constexpr double kThinTriangle = 0.05;
/// A label's second patch counts if it has at least one part in so many of the first. Smaller ones
/// are left over at the frayed border of a label.
constexpr int kRivalDivisor = 3;
/// A sensor's depth error is smooth, so about a hundred neighbouring pixels tell as much as one. No
/// plane is known better than kSmoothError, m.
constexpr double kPixelsPerPlane = 100, kSmoothError = 0.003;
/// Least variance of a patch along its short direction, m^2: bounds the uncertainty of its normal.
const double kMinVariance = std::pow(StepSigma() * kDepthStep, 2);

/// Row-major pixel indices of each label.
std::vector<std::vector<int>> PixelsByLabel(const SensorView& view,
                                            const SegmentationResult& segmentation,
                                            int num_classes) {
  std::vector<std::vector<int>> pixels(static_cast<std::size_t>(num_classes));
  view.VisitMeasured(1, [&](int u, int v) {
    const int label = segmentation.LabelAt(u, v);
    if (label > 0 && label < num_classes)
      pixels[static_cast<std::size_t>(label)].push_back(v * view.width() + u);
  });
  return pixels;
}

struct Plane {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d variances = Eigen::Vector3d::Zero();  // ascending, m^2
};

Plane FitPlane(const std::vector<Eigen::Vector3d>& points, const std::vector<int>& members) {
  Plane plane;
  for (const int i : members) plane.point += points[static_cast<std::size_t>(i)];
  plane.point /= static_cast<double>(members.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const int i : members) {
    const Eigen::Vector3d d = points[static_cast<std::size_t>(i)] - plane.point;
    covariance += d * d.transpose();
  }
  covariance /= static_cast<double>(members.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  plane.normal = solver.eigenvectors().col(0);
  plane.variances = solver.eigenvalues().cwiseMax(0);
  if (plane.normal.dot(plane.point) > 0) plane.normal = -plane.normal;
  return plane;
}

/// Largest distances of one side's points from its plane and from each other, m.
struct PatchLimits {
  SurfaceTolerance tolerance;
  double diagonal = 0;  // of the side
};

const Eigen::Vector3d& Pick(const std::vector<Eigen::Vector3d>& points,
                            const std::vector<int>& from, RandomStream& random) {
  return points[static_cast<std::size_t>(
      from[static_cast<std::size_t>(random.Below(static_cast<int>(from.size())))])];
}

/// The points near a plane and within the side's diagonal of their own median. None if no more than
/// `beaten` points are near the plane.
std::vector<int> Inliers(const std::vector<Eigen::Vector3d>& points, const std::vector<int>& from,
                         const PatchLimits& limits, const Eigen::Vector3d& point,
                         const Eigen::Vector3d& normal, std::size_t beaten = 0) {
  std::vector<int> near;
  for (const int i : from) {
    const Eigen::Vector3d& p = points[static_cast<std::size_t>(i)];
    if (std::abs(normal.dot(p - point)) <= limits.tolerance(p.z())) near.push_back(i);
  }
  if (near.size() <= beaten) return {};
  Eigen::Vector3d median;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values(near.size());
    for (std::size_t i = 0; i < near.size(); ++i)
      values[i] = points[static_cast<std::size_t>(near[i])][axis];
    median[axis] = Quantile(std::move(values), 0.5);
  }
  const auto far = [&](int i) {
    return (points[static_cast<std::size_t>(i)] - median).norm() > limits.diagonal;
  };
  near.erase(std::remove_if(near.begin(), near.end(), far), near.end());
  return near;
}

/// Indices, among `candidates`, of the largest planar patch, by RANSAC; empty for fewer than
/// `min_size`.
std::vector<int> FindPatch(const std::vector<Eigen::Vector3d>& points,
                           const std::vector<int>& candidates, const PatchLimits& limits,
                           int min_size, RandomStream& random) {
  if (static_cast<int>(candidates.size()) < min_size) return {};
  std::vector<int> sample;
  const std::size_t step = std::max<std::size_t>(1, candidates.size() / kManyProbes);
  for (std::size_t i = step / 2; i < candidates.size(); i += step) sample.push_back(candidates[i]);

  std::vector<int> best;
  for (std::size_t trial = 0; trial < kFewProbes; ++trial) {
    const Eigen::Vector3d& a = Pick(points, sample, random);
    const Eigen::Vector3d& b = Pick(points, sample, random);
    const Eigen::Vector3d& c = Pick(points, sample, random);
    const Eigen::Vector3d cross = (b - a).cross(c - a);
    const double longest = std::max({(b - a).norm(), (c - a).norm(), (c - b).norm()});
    // Points of one side are no farther apart than its diagonal.
    if (longest > limits.diagonal || cross.norm() < kThinTriangle * longest * longest ||
        longest == 0)
      continue;
    std::vector<int> inliers = Inliers(points, sample, limits, a, cross.normalized(), best.size());
    if (inliers.size() > best.size()) best = std::move(inliers);
  }
  for (int round = 0; round < kRounds && best.size() >= 3; ++round) {
    const Plane plane = FitPlane(points, best);
    best = Inliers(points, candidates, limits, plane.point, plane.normal);
  }
  if (static_cast<int>(best.size()) < min_size) best.clear();
  return best;
}

SidePatch Describe(const SensorView& view, const SegmentationResult& segmentation, int label,
                   const std::vector<int>& pixels, const std::vector<Eigen::Vector3d>& points,
                   const std::vector<int>& members) {
  const Plane plane = FitPlane(points, members);
  SidePatch patch;
  patch.label = label;
  patch.normal = plane.normal;
  patch.centroid.setZero();
  for (const int i : members) {
    const auto k = static_cast<std::size_t>(i);
    const int u = pixels[k] % view.width(), v = pixels[k] / view.width();
    const double area = view.PixelArea(u, v, points[k].z(), plane.normal);
    patch.area += area;
    patch.centroid += area * points[k];
    patch.pixels.push_back(pixels[k]);
    patch.mean_confidence += segmentation.confidence[static_cast<std::size_t>(pixels[k])];
  }
  patch.centroid /= patch.area;
  const auto count = static_cast<double>(members.size());
  patch.mean_confidence /= count;
  patch.normal_sigma = std::max(std::sqrt(plane.variances[0]), kSmoothError) /
                       std::sqrt(std::max(plane.variances[1], kMinVariance)) /
                       std::sqrt(std::max(1.0, count / kPixelsPerPlane));
  return patch;
}

}  // namespace

std::vector<SidePatch> CollectPatches(const SensorView& view,
                                      const SegmentationResult& segmentation,
                                      const Structure& structure) {
  const std::vector<std::vector<int>> by_label =
      PixelsByLabel(view, segmentation, structure.num_classes());
  const SurfaceTolerance tolerance = SurfaceTolerance::OfPlane(view.errors);
  std::vector<SidePatch> found;
  for (int label = 1; label < structure.num_classes(); ++label) {
    const std::vector<int>& pixels = by_label[static_cast<std::size_t>(label)];
    if (static_cast<int>(pixels.size()) < kFewestSidePixels) continue;
    std::vector<Eigen::Vector3d> points;
    points.reserve(pixels.size());
    for (const int i : pixels) points.push_back(view.Point(i % view.width(), i / view.width()));

    const Side& side = structure.SideOfLabel(label);
    const PatchLimits limits{tolerance, 2 * std::hypot(side.half_u, side.half_v)};
    RandomStream random(0, static_cast<std::uint64_t>(label), "side_patch");
    std::vector<int> candidates(pixels.size());
    std::iota(candidates.begin(), candidates.end(), 0);
    std::size_t largest = 0;
    for (int k = 0; k < 2; ++k) {
      const std::vector<int> members =
          FindPatch(points, candidates, limits, kFewestSidePixels, random);
      if (members.empty() || kRivalDivisor * members.size() < largest) break;
      largest = members.size();
      found.push_back(Describe(view, segmentation, label, pixels, points, members));
      std::vector<int> rest;
      std::set_difference(candidates.begin(), candidates.end(), members.begin(), members.end(),
                          std::back_inserter(rest));
      candidates = std::move(rest);
    }
  }
  return found;
}

}  // namespace volalign
