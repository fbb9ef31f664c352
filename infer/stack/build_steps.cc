#include "infer/stack/build_steps.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace volalign {

namespace {

Overhang OverhangOf(const Eigen::AlignedBox3d& box, const Eigen::AlignedBox3d& below) {
  return {box.max().x() - below.max().x(), below.min().x() - box.min().x(),
          box.max().z() - below.max().z(), below.min().z() - box.min().z()};
}

double SharedArea(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) {
  const double x = std::min(a.max().x(), b.max().x()) - std::max(a.min().x(), b.min().x());
  const double z = std::min(a.max().z(), b.max().z()) - std::max(a.min().z(), b.min().z());
  return std::max(x, 0.0) * std::max(z, 0.0);
}

}  // namespace

Eigen::AlignedBox3d Bounds(const Box& box) {
  Eigen::AlignedBox3d bounds;
  for (const Eigen::Vector3d& corner : box.Corners()) bounds.extend(corner);
  return bounds;
}

std::vector<BuildStep> BuildSteps(const Structure& structure) {
  std::vector<Eigen::AlignedBox3d> bounds;
  for (const Box& box : structure.boxes()) bounds.push_back(Bounds(box));
  std::vector<int> order(bounds.size());
  std::iota(order.begin(), order.end(), 0);
  const auto of = [&](int b) -> const Eigen::AlignedBox3d& {
    return bounds[static_cast<std::size_t>(b)];
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return of(a).min().y() < of(b).min().y() - kTouching; });

  std::vector<BuildStep> steps;
  for (const int b : order) {
    const Box& box = structure.boxes()[static_cast<std::size_t>(b)];
    const Eigen::Matrix3d& r = box.structure_from_box.linear();
    BuildStep step;
    step.box = b;
    step.height = box.size.y();
    step.front_to_back = box.size.x();
    step.left_to_right = box.size.z();
    step.yaw_deg = std::atan2(r(0, 2), r(2, 2)) / kDegree;
    step.on_floor = of(b).min().y() < structure.FloorHeight() + kTouching;
    std::vector<std::pair<double, int>> below;  // minus the area, box
    for (const BuildStep& earlier : steps) {
      const double area = SharedArea(of(b), of(earlier.box));
      if (std::abs(of(earlier.box).max().y() - of(b).min().y()) < kTouching && area > 0)
        below.emplace_back(-area, earlier.box);
    }
    std::sort(below.begin(), below.end());
    for (const auto& [area, on] : below) step.on.push_back(on);
    if (!step.on.empty()) {
      step.overhang = OverhangOf(of(b), of(step.on.front()));
    } else if (step.on_floor && !steps.empty()) {
      step.overhang = OverhangOf(of(b), of(steps.front().box));
    }
    steps.push_back(std::move(step));
  }
  return steps;
}

}  // namespace volalign
