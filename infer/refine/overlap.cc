#include "infer/refine/overlap.h"

#include <algorithm>
#include <cmath>

namespace volalign::refine_internal {

namespace {

constexpr double kAround = 0.3;               // m from the structure's bounding box
constexpr std::size_t kTenthsFromAround = 7;  // of the chosen points

}  // namespace

std::vector<int> ChooseOverlapPoints(const Structure& structure, const SensorPoints& points,
                                     const Pose& structure_from_sensor, int most) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  for (const Side& side : structure.sides()) {
    const Eigen::Vector3d reach =
        side.half_u * side.axis_u.cwiseAbs() + side.half_v * side.axis_v.cwiseAbs();
    low = low.cwiseMin(side.centre - reach);
    high = high.cwiseMax(side.centre + reach);
  }
  low.array() -= kAround;
  high.array() += kAround;
  std::vector<int> near, far;
  for (std::size_t j = 0; j < points.cloud().size(); ++j) {
    const Eigen::Vector3d p = structure_from_sensor * points.cloud()[j].p;
    const bool inside = (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
    (inside ? near : far).push_back(static_cast<int>(j));
  }
  std::vector<int> chosen;
  const auto take = [&](const std::vector<int>& from, std::size_t count) {
    count = std::min(count, from.size());
    for (std::size_t j = 0; j < count; ++j) chosen.push_back(from[j * from.size() / count]);
  };
  take(near, static_cast<std::size_t>(most) * kTenthsFromAround / 10);
  take(far, static_cast<std::size_t>(most) - chosen.size());
  return chosen;
}

bool SeeEnough(std::size_t matches, const OverlapView& from, double min_overlap) {
  return matches >= kFewestMatches &&
         static_cast<double>(matches) >= min_overlap * static_cast<double>(from.chosen->size());
}

std::vector<Match> FindMatches(const OverlapView& a, const OverlapView& b, double gate,
                               double min_cosine) {
  const Pose b_from_a = b.state.structure_from_sensor.inverse() * a.state.structure_from_sensor;
  std::vector<Match> matches;
  for (const int i : *a.chosen) {
    const CloudPoint& from = a.Cloud(i);
    const Eigen::Vector3d p = b_from_a * a.state.Corrected(from.p);
    if (p.z() <= 0) continue;
    const int j = b.points->Nearest(p, gate);
    if (j < 0) continue;
    const CloudPoint& to = b.Cloud(j);
    if ((b_from_a.linear() * from.normal).dot(to.normal) < min_cosine) continue;
    matches.push_back({i, j, to.normal.dot(p - b.state.Corrected(to.p))});
  }
  return matches;
}

std::vector<Pair> FindPairs(const std::vector<OverlapView>& views, double gate, double min_cosine,
                            double min_overlap) {
  std::vector<Pair> pairs;
  for (std::size_t a = 0; a < views.size(); ++a) {
    for (std::size_t b = a + 1; b < views.size(); ++b) {
      std::vector<Match> matches = FindMatches(views[a], views[b], gate, min_cosine);
      const std::vector<Match> back = FindMatches(views[b], views[a], gate, min_cosine);
      matches.insert(matches.end(), back.begin(), back.end());
      const auto offered = static_cast<double>(views[a].chosen->size() + views[b].chosen->size());
      const auto count = static_cast<double>(matches.size());
      if (matches.empty() || count < min_overlap * offered) continue;
      double squares = 0;
      for (const Match& match : matches) squares += match.residual * match.residual;
      pairs.push_back(
          {static_cast<int>(a), static_cast<int>(b), count / offered, std::sqrt(squares / count)});
    }
  }
  return pairs;
}

}  // namespace volalign::refine_internal
