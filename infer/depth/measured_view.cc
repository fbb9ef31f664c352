#include "infer/depth/measured_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/geometry/visibility.h"
#include "infer/depth/explain_view.h"
#include "infer/depth/share_odds.h"

namespace volalign {

namespace {

/// Number of rays of a view. About a quarter of them serve as points for other views.
constexpr double kRays = 6000;
constexpr double kBesideStructure = 0.15;  // m from it

// From recorded frames, by tests/bench/cause_shares.py: the share that neither sensor sees through,
// of all surfaces that both could have seen.
constexpr ShareOdds kNotFloating{{240, 0.63}, {1.7, 0.60}};

}  // namespace

MeasuredView::MeasuredView(const SensorView& view, const Structure& structure,
                           const std::vector<Pose>& poses)
    : stride_(StrideForRays(view.depth.size(), kRays)), view_(Decimate(view, stride_)) {
  std::vector<Eigen::Vector3d> rays;
  for (int v = 0; v < view_.height(); ++v) {
    for (int u = 0; u < view_.width(); ++u) {
      if (!(view_.ray_areas(u, v) > 0)) continue;  // the lens has no ray for this pixel
      rays.emplace_back(view_.rays.at(u, v).x(), view_.rays.at(u, v).y(), 0);
      pixels_.emplace_back(u, v);
      widest_pitch_ = std::max(widest_pitch_, PitchAt(u, v));
    }
  }
  rays_ = std::make_unique<KdTree>(std::move(rays));
  const SensorView few = Decimate(view_, StrideForRays(view_.depth.size(), kRays / 4));
  few.VisitMeasured(1, [&](int u, int v) {
    const Eigen::Vector3d p = few.Point(u, v);
    if (std::all_of(poses.begin(), poses.end(), [&](const Pose& pose) {
          return DistanceToSurface(structure, pose * p).distance >= kBesideStructure;
        }))
      points_.push_back({p, CellsOf(few, u, v)});
  });
}

double MeasuredView::PitchAt(int u, int v) const {
  return stride_ * std::sqrt(view_.ray_areas(u, v));
}

CauseShares MeasuredView::Explain(const MeasuredView& other, const Pose& this_from_other,
                                  double sigma_m) const {
  CauseShares causes = {};
  for (const Point& point : other.points_) {
    const Eigen::Vector3d p = this_from_other * point.p;
    if (!(p.z() > 0)) continue;
    const KdTree::Neighbour ray = rays_->Nearest({p.x() / p.z(), p.y() / p.z(), 0}, widest_pitch_);
    if (ray.index < 0) continue;
    const auto [u, v] = pixels_[static_cast<std::size_t>(ray.index)];
    if (std::sqrt(ray.squared_distance) > PitchAt(u, v)) continue;  // beside the picture
    // The point lies on the surface or at its edge if it is between the depths of the pixel and its
    // neighbours.
    double nearest = 0, farthest = 0;
    for (int y = v - 1; y <= v + 1; ++y) {
      for (int x = u - 1; x <= u + 1; ++x) {
        if (!view_.depth.Contains(x, y) || !(view_.depth(x, y) > 0)) continue;
        const double z = view_.depth(x, y);
        nearest = nearest > 0 ? std::min(nearest, z) : z;
        farthest = std::max(farthest, z);
      }
    }
    MeasuredRay measured;
    if (farthest > 0) {
      measured.depth = std::clamp(p.z(), nearest, farthest);
      measured.off = std::abs(measured.depth - p.z());
    }
    const double sigma = std::hypot(sigma_m, other.view_.errors.Sigma(point.p.z()));
    const CauseShares share = volalign::Explain({p.z(), sigma}, measured, view_.errors);
    for (std::size_t k = 0; k < kCauses; ++k) causes[k] += point.cells * share[k];
  }
  return causes;
}

CauseShares ExplainPair(const MeasuredView& a, const MeasuredView& b, const Pose& a_from_b,
                        double sigma_m) {
  CauseShares both = a.Explain(b, a_from_b, sigma_m);
  const CauseShares back = b.Explain(a, a_from_b.inverse(), sigma_m);
  for (std::size_t k = 0; k < kCauses; ++k) both[k] = (both[k] + back[k]) / 2;
  return both;
}

double LogOddsOfPairs(const CauseShares& causes) {
  return kNotFloating.LogOdds(causes[0] + causes[1], causes[2]);
}

}  // namespace volalign
