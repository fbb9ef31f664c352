#include "core/geometry/metrics.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel_for.h"
#include "core/base/statistics.h"
#include "core/geometry/kd_tree.h"

namespace volalign {

double MeanIou(const LabelImage& predicted, const LabelImage& truth, const DepthImage& depth,
               const MiouOptions& options) {
  if (predicted.width() != truth.width() || predicted.height() != truth.height() ||
      (!depth.empty() && (depth.width() != truth.width() || depth.height() != truth.height()))) {
    throw Error("MeanIou: the label maps and the depth have different sizes");
  }
  const auto classes = static_cast<std::size_t>(options.num_classes);
  std::vector<std::int64_t> both(classes), in_predicted(classes), in_truth(classes);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (!depth.empty() && !(depth[i] > 0)) continue;
    const std::size_t p = predicted[i], t = truth[i];
    if (p >= classes || t >= classes) {
      throw Error("MeanIou: label " + std::to_string(std::max(p, t)) + " violates label < " +
                  std::to_string(classes));
    }
    ++in_predicted[p];
    ++in_truth[t];
    if (p == t) ++both[p];
  }
  double sum = 0;
  int counted = 0;
  for (std::size_t k = 0; k < classes; ++k) {
    const std::int64_t either = in_predicted[k] + in_truth[k] - both[k];
    if (either == 0) {
      if (!options.absent_counts_as_one) continue;
      sum += 1;
    } else {
      sum += static_cast<double>(both[k]) / static_cast<double>(either);
    }
    ++counted;
  }
  return counted == 0 ? 1.0 : sum / counted;
}

double RmsDistance(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b,
                   int threads) {
  if (a.empty() || b.empty()) throw Error("RmsDistance: a point set is empty");
  constexpr std::size_t kPointsOfTask = 4096;  // number of points that one thread takes at a time
  const KdTree tree(b);
  std::vector<double> sums(a.size() / kPointsOfTask + 1, 0);
  ParallelFor(sums.size(), threads, [&](std::size_t task) {
    const std::size_t end = std::min(a.size(), (task + 1) * kPointsOfTask);
    for (std::size_t i = task * kPointsOfTask; i < end; ++i)
      sums[task] += tree.Nearest(a[i]).squared_distance;
  });
  return std::sqrt(std::accumulate(sums.begin(), sums.end(), 0.0) / static_cast<double>(a.size()));
}

SetDistances CompareSets(const std::vector<Eigen::Vector3d>& a,
                         const std::vector<Eigen::Vector3d>& b, int threads) {
  SetDistances distances;
  distances.d1 = RmsDistance(a, b, threads);
  distances.d2 = std::max(distances.d1, RmsDistance(b, a, threads));
  return distances;
}

Summary Summarise(const std::vector<double>& values) {
  Summary summary;
  if (values.empty()) return summary;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) summary.mean += v / n;
  double variance = 0;
  for (const double v : values) variance += (v - summary.mean) * (v - summary.mean) / n;
  summary.std = std::sqrt(variance);
  summary.rsd = summary.mean == 0 ? 0 : summary.std / summary.mean;
  summary.median = Quantile(values, 0.5);
  summary.p95 = Quantile(values, 0.95);
  return summary;
}

}  // namespace volalign
