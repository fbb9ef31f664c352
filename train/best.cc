#include "train/best.h"

#include <cmath>
#include <limits>

#include "core/error.h"

namespace volalign {

double ValueOf(BestMetric metric, const ValidationResult& result) {
  const auto of_poses = [&](double value) {
    return result.posed > 0 ? value : std::numeric_limits<double>::quiet_NaN();
  };
  switch (metric) {
    case BestMetric::kLossSeg:
      return result.loss_seg;
    case BestMetric::kMiou:
      return result.miou;
    case BestMetric::kMiouAuthors:
      return result.miou_authors;
    case BestMetric::kKeypointRmse:
      return of_poses(result.keypoint_rmse_m);
    case BestMetric::kTranslationError:
      return of_poses(result.median_translation_error_m);
    case BestMetric::kRotationError:
      return of_poses(result.median_rotation_error_deg);
  }
  throw Error("invalid BestMetric");
}

bool LargerIsBetter(BestMetric metric) {
  return metric == BestMetric::kMiou || metric == BestMetric::kMiouAuthors;
}

bool BestValidation::Note(BestMetric metric, const ValidationResult& result,
                          std::int64_t at_samples) {
  const double found = ValueOf(metric, result);
  const bool better = LargerIsBetter(metric) ? found > value : found < value;
  if (std::isfinite(found) && (samples < 0 || better)) {
    *this = {at_samples, found, 0};
    return true;
  }
  ++since;
  return false;
}

}  // namespace volalign
