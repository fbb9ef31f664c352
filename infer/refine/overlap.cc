#include "infer/refine/overlap.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "core/geometry/visibility.h"

namespace volalign::refine_internal {

namespace {

constexpr double kAround = 0.3;  // m from the structure's bounding box

}  // namespace

std::vector<int> ChooseOverlapPoints(const Structure& structure, const SensorPoints& points,
                                     const Pose& structure_from_sensor, int most, bool all) {
  if (most == 0) return {};
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()),
                  high = -low;
  for (const Side& side : structure.sides()) {
    const Eigen::Vector3d reach =
        side.half_u * side.axis_u.cwiseAbs() + side.half_v * side.axis_v.cwiseAbs();
    low = low.cwiseMin(side.centre - reach);
    high = high.cwiseMax(side.centre + reach);
  }
  low.array() -= kAround;
  high.array() += kAround;
  const auto at = [&](int j) {
    return structure_from_sensor * points.cloud.points()[static_cast<std::size_t>(j)].p;
  };
  std::vector<int> near, far;
  for (int j = 0; j < static_cast<int>(points.cloud.points().size()); ++j) {
    const Eigen::Vector3d p = at(j);
    const bool inside = (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
    (inside ? near : far).push_back(j);
  }
  std::vector<int> chosen;
  // Each point has its own place in the order. So a pose that differs a little gives only a few
  // other points. Multiples of the golden ratio are even over any part of the cloud (Weyl's
  // sequence).
  const auto take = [&](std::vector<int> from, std::size_t count) {
    const auto place = [](int j) { return static_cast<std::uint32_t>(j) * 0x9E3779B9U; };
    const auto is_before = [&](int a, int b) { return place(a) < place(b); };
    if (from.size() > count) {
      std::nth_element(from.begin(), from.begin() + static_cast<std::ptrdiff_t>(count), from.end(),
                       is_before);
      from.resize(count);
    }
    std::sort(from.begin(), from.end(), is_before);
    chosen.insert(chosen.end(), from.begin(), from.end());
  };
  take(std::move(near), static_cast<std::size_t>(most) / 2);
  take(std::move(far), static_cast<std::size_t>(most) - chosen.size());
  if (all) return chosen;
  const auto is_for_others = [&](int j) {
    return DistanceToSurface(structure, at(j)).distance < kOffStructure;
  };
  chosen.erase(std::remove_if(chosen.begin(), chosen.end(), is_for_others), chosen.end());
  return chosen;
}

std::vector<Match> FindMatches(const OverlapEnd& a, const OverlapEnd& b, double gate,
                               double min_cosine) {
  const Pose b_from_a = b.state.structure_from_sensor.inverse() * a.state.structure_from_sensor;
  std::vector<Match> matches;
  for (const int i : *a.chosen) {
    const CloudPoint& from = a.Cloud(i);
    const Eigen::Vector3d p = b_from_a * a.state.Corrected(from.p);
    if (p.z() <= 0) continue;
    const int j = b.points->cloud.Nearest(b.state.AsMeasured(p), gate);
    if (j < 0) continue;
    const CloudPoint& to = b.Cloud(j);
    if ((b_from_a.linear() * from.normal).dot(to.normal) < min_cosine) continue;
    matches.push_back({i, j, to.normal.dot(p - b.state.Corrected(to.p))});
  }
  return matches;
}

SharedPoints FindShared(const OverlapEnd& a, const OverlapEnd& b, double gate, double min_cosine) {
  SharedPoints shared{FindMatches(a, b, gate, min_cosine), FindMatches(b, a, gate, min_cosine)};
  const std::size_t offered = a.chosen->size() + b.chosen->size();
  if (offered > 0) {
    shared.overlap =
        static_cast<double>(shared.of_a.size() + shared.of_b.size()) / static_cast<double>(offered);
  }
  return shared;
}

double SharedPoints::rms() const {
  double squares = 0;
  for (const Match& match : of_a) squares += match.residual * match.residual;
  for (const Match& match : of_b) squares += match.residual * match.residual;
  return std::sqrt(squares / static_cast<double>(of_a.size() + of_b.size()));
}

}  // namespace volalign::refine_internal
