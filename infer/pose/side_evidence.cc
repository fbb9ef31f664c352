#include "infer/pose/side_evidence.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/random.h"

namespace volalign {

namespace {

/// Row-major pixel indices of each label, without components of fewer than kSpeck pixels.
std::vector<std::vector<int>> ConnectedPixels(const SensorView& view,
                                              const SegmentationResult& segmentation,
                                              int num_classes, double min_confidence) {
  constexpr std::size_t kSpeck = 12;
  const int width = view.width(), height = view.height();
  const auto usable = [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    return segmentation.labels[k] > 0 && segmentation.labels[k] < num_classes &&
           view.depth[k] > 0 && segmentation.confidence[k] >= min_confidence;
  };
  std::vector<std::vector<int>> pixels(static_cast<std::size_t>(num_classes));
  std::vector<char> seen(view.depth.size(), 0);
  std::vector<int> component;
  for (int start = 0; start < width * height; ++start) {
    if (seen[static_cast<std::size_t>(start)] || !usable(start)) continue;
    component.assign(1, start);
    seen[static_cast<std::size_t>(start)] = 1;
    const std::uint8_t label = segmentation.labels[static_cast<std::size_t>(start)];
    for (std::size_t next = 0; next < component.size(); ++next) {
      const int i = component[next], u = i % width, v = i / width;
      const double z = view.depth[static_cast<std::size_t>(i)];
      const auto visit = [&](int du, int dv) {
        if (!view.depth.Contains(u + du, v + dv)) return;
        const int j = i + dv * width + du;
        const auto k = static_cast<std::size_t>(j);
        if (seen[k] || segmentation.labels[k] != label || !usable(j)) return;
        if (std::abs(view.depth[k] - z) > DepthJump(z)) return;
        seen[k] = 1;
        component.push_back(j);
      };
      visit(1, 0);
      visit(-1, 0);
      visit(0, 1);
      visit(0, -1);
    }
    if (component.size() >= kSpeck) {
      auto& all = pixels[label];
      all.insert(all.end(), component.begin(), component.end());
    }
  }
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

class PatchFinder {
 public:
  PatchFinder(const std::vector<Eigen::Vector3d>& points, double tolerance, double diagonal)
      : points_(points), tolerance_(tolerance), diagonal_(diagonal) {}

  /// Indices, among `candidates`, of the largest planar patch; empty for fewer than `min_size`.
  std::vector<int> Find(const std::vector<int>& candidates, RandomStream& random,
                        int min_size) const {
    if (static_cast<int>(candidates.size()) < min_size) return {};
    constexpr std::size_t kSample = 400;
    std::vector<int> sample;
    const std::size_t step = std::max<std::size_t>(1, candidates.size() / kSample);
    for (std::size_t i = step / 2; i < candidates.size(); i += step)
      sample.push_back(candidates[i]);

    std::vector<int> best;
    constexpr int kTrials = 80;
    for (int trial = 0; trial < kTrials; ++trial) {
      const Eigen::Vector3d& a = Pick(sample, random);
      const Eigen::Vector3d& b = Pick(sample, random);
      const Eigen::Vector3d& c = Pick(sample, random);
      const Eigen::Vector3d cross = (b - a).cross(c - a);
      const double longest = std::max({(b - a).norm(), (c - a).norm(), (c - b).norm()});
      // Three points that are nearly in line, or farther apart than the side is large, are no
      // side's.
      if (longest > diagonal_ || cross.norm() < 0.05 * longest * longest || longest == 0) continue;
      std::vector<int> inliers = Inliers(sample, a, cross.normalized());
      if (inliers.size() > best.size()) best = std::move(inliers);
    }
    for (int round = 0; round < 3 && best.size() >= 3; ++round) {
      const Plane plane = FitPlane(points_, best);
      best = Inliers(candidates, plane.point, plane.normal);
    }
    if (static_cast<int>(best.size()) < min_size) best.clear();
    return best;
  }

 private:
  const Eigen::Vector3d& Pick(const std::vector<int>& from, RandomStream& random) const {
    return points_[static_cast<std::size_t>(
        from[static_cast<std::size_t>(random.Below(static_cast<int>(from.size())))])];
  }

  /// Points near the plane and within the side's diagonal of their own median.
  std::vector<int> Inliers(const std::vector<int>& from, const Eigen::Vector3d& point,
                           const Eigen::Vector3d& normal) const {
    std::vector<int> near;
    for (const int i : from) {
      const Eigen::Vector3d& p = points_[static_cast<std::size_t>(i)];
      if (std::abs(normal.dot(p - point)) <= tolerance_ * (1 + 0.1 * p.z() * p.z()))
        near.push_back(i);
    }
    if (near.empty()) return near;
    Eigen::Vector3d median;
    std::vector<double> values(near.size());
    for (int axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < near.size(); ++i)
        values[i] = points_[static_cast<std::size_t>(near[i])][axis];
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      median[axis] = *middle;
    }
    near.erase(std::remove_if(near.begin(), near.end(),
                              [&](int i) {
                                return (points_[static_cast<std::size_t>(i)] - median).norm() >
                                       diagonal_;
                              }),
               near.end());
    return near;
  }

  const std::vector<Eigen::Vector3d>& points_;
  double tolerance_, diagonal_;
};

SideEvidence Describe(const SensorView& view, const SegmentationResult& segmentation, int label,
                      const std::vector<int>& pixels, const std::vector<Eigen::Vector3d>& points,
                      const std::vector<int>& members) {
  const Plane plane = FitPlane(points, members);
  SideEvidence evidence;
  evidence.label = label;
  evidence.normal = plane.normal;
  evidence.centroid.setZero();
  for (const int i : members) {
    const auto k = static_cast<std::size_t>(i);
    const double area = view.PixelArea(points[k], plane.normal);
    evidence.area += area;
    evidence.centroid += area * points[k];
    evidence.pixels.push_back(pixels[k]);
    evidence.mean_confidence += segmentation.confidence[static_cast<std::size_t>(pixels[k])];
  }
  evidence.centroid /= evidence.area;
  const auto count = static_cast<double>(members.size());
  evidence.mean_confidence /= count;
  evidence.plane_rms = std::sqrt(plane.variances[0]);
  // A sensor's warp is smooth, so about a hundred neighbouring pixels tell as much as one
  // (facts/sensors.md section 1).
  constexpr double kPixelsPerObservation = 100, kWarp = 0.003;
  evidence.normal_sigma = std::max(evidence.plane_rms, kWarp) /
                          std::sqrt(std::max(plane.variances[1], 1e-8)) /
                          std::sqrt(std::max(1.0, count / kPixelsPerObservation));
  return evidence;
}

}  // namespace

std::vector<SideEvidence> CollectEvidence(const SensorView& view,
                                          const SegmentationResult& segmentation,
                                          const Structure& structure,
                                          const EvidenceOptions& options) {
  const std::vector<std::vector<int>> by_label =
      ConnectedPixels(view, segmentation, structure.num_classes(), options.min_confidence);
  std::vector<SideEvidence> found;
  for (int label = 1; label < structure.num_classes(); ++label) {
    const std::vector<int>& pixels = by_label[static_cast<std::size_t>(label)];
    if (static_cast<int>(pixels.size()) < options.min_pixels) continue;
    std::vector<Eigen::Vector3d> points;
    points.reserve(pixels.size());
    for (const int i : pixels) points.push_back(view.Point(i % view.width(), i / view.width()));

    const Side& side = structure.SideOfLabel(label);
    const PatchFinder finder(points, options.plane_tolerance_m,
                             2 * std::hypot(side.half_u, side.half_v));
    RandomStream random(0, static_cast<std::uint64_t>(label), "side_evidence");
    std::vector<int> candidates(pixels.size());
    for (std::size_t i = 0; i < candidates.size(); ++i) candidates[i] = static_cast<int>(i);
    const std::vector<int> first = finder.Find(candidates, random, options.min_pixels);
    if (first.empty()) continue;
    found.push_back(Describe(view, segmentation, label, pixels, points, first));

    std::vector<char> used(pixels.size(), 0);
    for (const int i : first) used[static_cast<std::size_t>(i)] = 1;
    candidates.erase(std::remove_if(candidates.begin(), candidates.end(),
                                    [&](int i) { return used[static_cast<std::size_t>(i)] != 0; }),
                     candidates.end());
    const std::vector<int> second = finder.Find(candidates, random, options.min_pixels);
    // Less than a third is what a label's frayed border leaves over, not a rival.
    if (3 * second.size() >= first.size()) {
      found.push_back(Describe(view, segmentation, label, pixels, points, second));
    }
  }
  return found;
}

}  // namespace volalign
