#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/base/image.h"

namespace volalign {

struct MiouOptions {
  int num_classes = 0;
  /// false: over the classes present in either map (`miou`). Else over all classes, where one that
  /// is absent from both maps counts as 1. The code of the paper's authors does so
  /// (`miou_authors`).
  bool absent_counts_as_one = false;
};

/// Mean intersection over union of one image, including background, over the pixels with depth > 0
/// (all pixels if `depth` is empty). 1 if no pixel counts. Throws Error for unequal sizes or a
/// label >= num_classes.
double MeanIou(const LabelImage& predicted, const LabelImage& truth, const DepthImage& depth,
               const MiouOptions& options);

/// sqrt(mean over a in A of min over b in B |a - b|^2), the paper's dist(A, B) (Results, eq. RMS).
/// Throws Error if a set is empty. Nearest neighbours with nanoflann's kd-tree.
double RmsDistance(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b,
                   int threads = 1);

struct SetDistances {
  double d1 = 0;  ///< dist(A, B), m
  double d2 = 0;  ///< max(dist(A, B), dist(B, A)), m
};
SetDistances CompareSets(const std::vector<Eigen::Vector3d>& a,
                         const std::vector<Eigen::Vector3d>& b, int threads = 1);

/// Mean, standard deviation (population) and relative standard deviation, as in the paper's tables;
/// median and 95th percentile (core/base/statistics.h).
struct Summary {
  double mean = 0, std = 0, rsd = 0, median = 0, p95 = 0;
};
Summary Summarise(const std::vector<double>& values);

}  // namespace volalign
