#include "infer/depth/explain_view.h"

#include <algorithm>
#include <cmath>

#include "core/geometry/visibility.h"
#include "infer/depth/share_odds.h"

namespace volalign {

namespace {

// From recorded frames, by tests/bench/cause_shares.py. The share of a structure's view that rays
// do not pass through. The share of labelled rays on the side that the label names. The share that
// is both, of the rays that are labelled or on the structure.
constexpr ShareOdds kNotBehind{{78, 0.40}, {5.6, 1.2}};
constexpr ShareOdds kNamedSo{{6.2, 0.89}, {0.375, 3.4}};
constexpr ShareOdds kInOutline{{42, 1.9}, {10.3, 8.2}};

double Share(double part, double rest) { return part + rest > 0 ? part / (part + rest) : 0; }

}  // namespace

double CellsOf(const SensorView& view, int u, int v) {
  const double squared = 1 + view.rays.at(u, v).cast<double>().squaredNorm();
  const double solid_angle = view.ray_areas(u, v) / (squared * std::sqrt(squared));
  return solid_angle / (view.errors.smooth_rad * view.errors.smooth_rad);
}

double LogOddsOfSurface(double on_it, double behind_it) {
  return kNotBehind.LogOdds(on_it, behind_it);
}

double ViewExplanation::behind_share() const {
  return Share(of(Cause::kBehind), of(Cause::kSurface));
}

double ViewExplanation::named_so_share() const { return Share(named_so, named_otherwise); }

double ViewExplanation::LogOddsByDepth() const {
  return LogOddsOfSurface(of(Cause::kSurface), of(Cause::kBehind));
}

double ViewExplanation::LogOddsByLabels() const {
  return kNamedSo.LogOdds(named_so, named_otherwise);
}

double ViewExplanation::LogOddsByOutline() const {
  if (!has_labels()) return 0;
  return kInOutline.LogOdds(
      labelled_on, of(Cause::kSurface) - labelled_on + named_so + named_otherwise - labelled_on);
}

ViewExplanation ExplainView(const SensorView& view, const SegmentationResult* segmentation,
                            const Structure& structure, const Pose& structure_from_sensor,
                            double sigma_m) {
  const ExpectedView expected = CastView(structure, view.rays, structure_from_sensor);
  ViewExplanation explanation;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const double depth = view.depth(u, v), expected_depth = expected.depth(u, v);
      const int label = segmentation ? segmentation->LabelAt(u, v) : 0;
      if (!(expected_depth > 0) && (label == 0 || !(depth > 0))) continue;
      const double cells = CellsOf(view, u, v);
      CauseShares share = {};
      if (expected_depth > 0) {
        const double gap = std::abs(depth - expected_depth);
        const double off = depth > 0
                               ? std::min(gap, DistanceToSurface(structure, structure_from_sensor *
                                                                                view.Point(u, v))
                                                   .distance)
                               : 0;
        share = Explain({expected_depth, sigma_m}, {depth, off}, view.errors);
        for (std::size_t k = 0; k < kCauses; ++k) explanation.causes[k] += cells * share[k];
      }
      if (label == 0 || !(depth > 0)) continue;
      const double so = label == expected.labels(u, v) ? share[0] : 0;
      explanation.named_so += cells * so;
      explanation.named_otherwise += cells * (1 - so);
      explanation.labelled_on += cells * share[0];
    }
  }
  return explanation;
}

}  // namespace volalign
