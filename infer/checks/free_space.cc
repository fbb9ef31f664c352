#include "infer/checks/free_space.h"

#include <cmath>
#include <memory>

#include "core/base/odds.h"
#include "core/base/parallel_for.h"
#include "infer/depth/measured_view.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// The causes between each two sensors, in independent cells.
class Pairs {
 public:
  Pairs(const std::vector<const SensorView*>& views, const std::vector<Pose>& poses,
        const Structure& structure, int threads)
      : size_(views.size()), causes_(size_ * size_) {
    std::vector<std::unique_ptr<MeasuredView>> measured(size_);
    ParallelFor(size_, threads, [&](std::size_t i) {
      if (!views[i]) return;
      measured[i] = std::make_unique<MeasuredView>(*views[i], structure, std::vector{poses[i]});
    });
    ParallelFor(size_, threads, [&](std::size_t i) {
      for (std::size_t j = 0; measured[i] && j < i; ++j) {
        if (!measured[j]) continue;
        causes_[i * size_ + j] = causes_[j * size_ + i] =
            ExplainPair(*measured[i], *measured[j], poses[i].inverse() * poses[j], kRoughPose);
      }
    });
  }

  const CauseShares& Of(std::size_t i, std::size_t j) const { return causes_[i * size_ + j]; }

  /// Log odds by all pairs of a sensor with those that are not `out`.
  double LogOdds(std::size_t i, const std::vector<char>& out) const {
    CauseShares sum = {};
    for (std::size_t j = 0; j < size_; ++j) {
      if (out[j]) continue;
      for (std::size_t cause = 0; cause < kCauses; ++cause) sum[cause] += Of(i, j)[cause];
    }
    return LogOddsOfPairs(sum);
  }

  /// Do the others show that the first of two sensors, not the second, is elsewhere?
  bool Decide(std::size_t first, std::size_t second, std::vector<char> out) const {
    out[first] = out[second] = 1;
    return LogOdds(second, out) - LogOdds(first, out) > std::log(kModelOdds);
  }

  /// The sensor that shows most clearly that this one is elsewhere.
  FreeSpaceViolation Clearest(std::size_t i, const std::vector<char>& out) const {
    FreeSpaceViolation clearest;
    clearest.other = size_;
    double least = 0;
    for (std::size_t j = 0; j < size_; ++j) {
      const double log_odds = LogOddsOfPairs(Of(i, j));
      if (out[j] || j == i || (clearest.other < size_ && log_odds >= least)) continue;
      least = log_odds;
      const CauseShares& of = Of(i, j);
      const double seen = of[0] + of[1] + of[2];
      clearest.other = j;
      clearest.share = seen > 0 ? of[2] / seen : 0;
    }
    clearest.log_odds = LogOdds(i, out);
    return clearest;
  }

 private:
  std::size_t size_;
  std::vector<CauseShares> causes_;
};

}  // namespace

std::vector<std::optional<FreeSpaceViolation>> FindFreeSpaceViolations(
    const std::vector<const SensorView*>& views, const std::vector<Pose>& poses,
    const Structure& structure, double refuting_odds, int threads) {
  const Pairs pairs(views, poses, structure, threads);
  std::vector<std::optional<FreeSpaceViolation>> found(views.size());
  std::vector<char> out(views.size(), 0);
  for (std::size_t left = views.size(); left > 1; --left) {
    double least = -std::log(refuting_odds);
    std::vector<std::size_t> worst;  // two where one is as doubtful as the other
    for (std::size_t i = 0; i < views.size(); ++i) {
      if (out[i]) continue;
      const double log_odds = pairs.LogOdds(i, out);
      if (log_odds < least) {
        worst = {i};
        least = log_odds;
      } else if (log_odds == least && !worst.empty()) {
        worst.push_back(i);
      }
    }
    if (worst.empty()) break;
    for (const std::size_t i : worst) found[i] = pairs.Clearest(i, out);
    if (worst.size() == 1 && !pairs.Decide(worst.front(), found[worst.front()]->other, out)) {
      worst.push_back(found[worst.front()]->other);
      found[worst.back()] = pairs.Clearest(worst.back(), out);
    }
    for (const std::size_t i : worst) out[i] = 1;
  }
  return found;
}

}  // namespace volalign
