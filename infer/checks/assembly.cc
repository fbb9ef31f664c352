#include "infer/checks/assembly.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "core/base/lists.h"
#include "core/base/odds.h"
#include "core/base/parallel_for.h"
#include "core/geometry/stack_faults.h"
#include "infer/initial/geometry_search.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Views in which every arrangement is searched for; the others get the best arrangements alone.
constexpr std::size_t kAskedFirst = 3;
/// m: how far boxes are searched for beside their places, above and below them, and the step.
constexpr double kFarthestBeside = 0.25, kFarthestUp = 0.6, kSeekStep = kFarthestOff / 2;

using Indices = std::vector<std::size_t>;
using Fit = std::optional<GeometricPose>;

double Support(const Fit& fit) { return fit ? std::max(0.0, fit->shape.LogOdds()) : 0; }

/// An arrangement, and where the views show it best.
struct StackHypothesis {
  Arrangement arrangement;
  std::vector<Fit> fits;  // of each view
  bool sought = false;    // some boxes were moved to where the views show most of them

  double LogOdds() const {
    double sum = 0;
    for (const Fit& fit : fits) sum += Support(fit);
    return sum;
  }
  /// A moved box suits the views better by itself.
  double Worth() const { return LogOdds() - (sought ? std::log(kDecisiveOdds) : 0); }
  double Gain() const {
    double sum = 0;
    for (const Fit& fit : fits) sum += fit ? std::max(0.0, fit->shape.Gain()) : 0;
    return sum;
  }
  double Rank() const { return LogOdds() + Gain(); }
  /// Share of the points where the boxes are that lie on them; a view without their shape explains
  /// none.
  double Share() const {
    double explained = 0, measured = 0;
    for (const Fit& fit : fits) {
      if (!fit) continue;
      explained += Support(fit) > 0 ? fit->shape.explained : 0;
      measured += fit->shape.explained + fit->shape.contradicted();
    }
    return measured > 0 ? explained / measured : 0;
  }
  Indices SeenBy() const {
    Indices seen;
    for (std::size_t i = 0; i < fits.size(); ++i) {
      if (Support(fits[i]) > 0) seen.push_back(i);
    }
    return seen;
  }
};

class Inspection {
 public:
  Inspection(const std::vector<const SensorView*>& views, const Structure& structure, int threads)
      : structure_(structure), threads_(threads), views_(views.size()) {
    ParallelFor(views.size(), threads, [&](std::size_t i) {
      if (views[i]) views_[i] = LookAround(*views[i], structure);
    });
  }

  /// The described one first, then those that explain most.
  std::vector<StackHypothesis> Try() const {
    std::vector<StackHypothesis> all;
    for (Arrangement& arrangement : Arrangements(structure_))
      all.push_back({std::move(arrangement), std::vector<Fit>(views_.size())});
    std::vector<StackHypothesis> tried(all.begin(), all.begin() + 1);
    all.erase(all.begin());
    Ask(All(), &tried);

    // Views that show most of the boxes, in whichever order, come first.
    Indices views = All();
    const auto explained = [&](std::size_t i) {
      const Fit& fit = tried.front().fits[i];
      return fit ? fit->shape.explained : 0;
    };
    SortLargestFirst(&views, explained);
    const auto rest =
        views.begin() + static_cast<std::ptrdiff_t>(std::min(kAskedFirst, views.size()));
    Ask(Indices(views.begin(), rest), &all);
    const auto is_mirrored = [](const StackHypothesis& each) {
      return each.arrangement.code == SensorCode::kAssemblyMirrored;
    };
    KeepLargest(kBeam, &all, [&](const StackHypothesis& each) {
      return is_mirrored(each) ? std::numeric_limits<double>::infinity() : each.Gain();
    });
    Ask(Indices(rest, views.end()), &all);

    std::vector<StackHypothesis> moved = Moved(Indices(views.begin(), rest));
    for (const StackHypothesis& each : all) {
      if (each.arrangement.turn_deg == 180) continue;  // a place beside is among the displaced
      // A box that stands otherwise may also stand a little beside.
      StackHypothesis displaced = each;
      displaced.sought = true;
      for (const std::size_t box : each.arrangement.moved) {
        Structure& structure = displaced.arrangement.structure;
        structure = Displaced(structure, {box}, Seek(structure, {box})).structure;
      }
      moved.push_back(std::move(displaced));
    }
    Ask(All(), &moved);
    for (std::vector<StackHypothesis>* more : {&all, &moved})
      std::move(more->begin(), more->end(), std::back_inserter(tried));
    return tried;
  }

 private:
  Indices All() const {
    Indices all(views_.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    return all;
  }

  Fit Find(std::size_t view, const Structure& structure) const {
    if (!views_[view]) return std::nullopt;
    return FindBestOnFloors(*views_[view], structure);
  }

  void Ask(const Indices& views, std::vector<StackHypothesis>* hypotheses) const {
    ParallelFor(views.size() * hypotheses->size(), threads_, [&](std::size_t k) {
      StackHypothesis& of = (*hypotheses)[k / views.size()];
      const std::size_t view = views[k % views.size()];
      of.fits[view] = Find(view, of.arrangement.structure);
    });
  }

  /// Poses by the boxes that are not `moved`; by all boxes, if a moved one carries the stack on the
  /// floor.
  std::vector<Fit> PosesWithout(const Structure& structure, const Indices& moved) const {
    std::vector<Box> boxes;
    for (std::size_t i = 0; i < structure.boxes().size(); ++i) {
      if (std::find(moved.begin(), moved.end(), i) == moved.end())
        boxes.push_back(structure.boxes()[i]);
    }
    Structure capture = structure;
    if (!boxes.empty()) capture = Structure::FromBoxes(structure.name(), std::move(boxes));
    const bool on_floor = capture.FloorHeight() < structure.FloorHeight() + kSamePlace;
    std::vector<Fit> poses(views_.size());
    ParallelFor(views_.size(), threads_,
                [&](std::size_t i) { poses[i] = Find(i, on_floor ? capture : structure); });
    return poses;
  }

  /// The offset from their places, m, at which the views show most of boxes that stand elsewhere.
  Eigen::Vector3d Seek(const Structure& structure, const Indices& moved) const {
    const std::vector<Fit> poses = PosesWithout(structure, moved);
    const auto gain_at = [&](const Eigen::Vector3d& offset) {
      const Structure there = Displaced(structure, moved, offset).structure;
      double gain = 0;
      for (std::size_t i = 0; i < views_.size(); ++i) {
        if (poses[i])
          gain +=
              MeasureShape(views_[i]->first_look, there, poses[i]->structure_from_sensor).Gain();
      }
      return gain;
    };
    Eigen::Vector3d best = Eigen::Vector3d::Zero();
    for (const double step : {kSeekStep, kSeekStep, kSeekStep / 2, kSeekStep / 4}) {
      for (const int axis : {0, 2}) {
        const double reach = step < kSeekStep ? step : kFarthestBeside;
        const int steps = static_cast<int>(std::lround(reach / step));
        std::vector<double> gains(static_cast<std::size_t>(2 * steps + 1));
        const auto offset = [&](std::size_t k) {
          Eigen::Vector3d there = best;
          there[axis] += (static_cast<double>(k) - steps) * step;
          return there;
        };
        ParallelFor(gains.size(), threads_, [&](std::size_t k) { gains[k] = gain_at(offset(k)); });
        const auto most = std::max_element(gains.begin(), gains.end());
        if (*most > gains[static_cast<std::size_t>(steps)])
          best = offset(static_cast<std::size_t>(most - gains.begin()));
      }
    }
    return best;
  }

  /// These boxes elsewhere, not yet searched for in any view.
  StackHypothesis With(const Indices& moved, const Eigen::Vector3d& offset) const {
    return {Displaced(structure_, moved, offset), std::vector<Fit>(views_.size()), true};
  }

  /// Each box, alone and with the boxes on it, beside its place; and with them above or below it,
  /// where `asked` show most.
  std::vector<StackHypothesis> Moved(const Indices& asked) const {
    std::vector<StackHypothesis> list;
    if (!structure_.IsOfBoxes()) return list;  // nobody stacks the parts of a mesh
    for (std::size_t box = 0; box < structure_.boxes().size(); ++box) {
      Indices with_above = BoxesOn(structure_.boxes(), box);
      with_above.insert(with_above.begin(), box);
      std::vector<Indices> sets;
      if (with_above.size() > 1) sets.push_back({box});
      if (with_above.size() < structure_.boxes().size()) sets.push_back(with_above);
      for (const Indices& moved : sets) {
        const Eigen::Vector3d offset = Seek(structure_, moved);
        // Less may be sizes, or the lens.
        if (offset.norm() >= 2 * kRoughPose) list.push_back(With(moved, offset));
      }
      list.push_back(Raised(with_above, asked));
    }
    return list;
  }

  /// Boxes above or below their place, where `asked` show most.
  StackHypothesis Raised(const Indices& moved, const Indices& asked) const {
    const bool all = moved.size() == structure_.boxes().size();
    std::vector<double> heights;
    for (double up = all ? 0 : -kFarthestUp / 2; up < kFarthestUp; up += kSeekStep) {
      if (std::abs(up) > 2 * kRoughPose) heights.push_back(up);  // less may be sizes
    }
    double best_up = 0, step = kSeekStep;
    std::optional<StackHypothesis> best;
    for (int round = 1; round <= kRounds; ++round) {
      std::vector<StackHypothesis> tried;
      for (const double up : heights) tried.push_back(With(moved, {0, up, 0}));
      Ask(asked, &tried);
      for (std::size_t k = 0; k < tried.size(); ++k) {
        if (best && !(tried[k].Rank() > best->Rank())) continue;
        best = tried[k];
        best_up = heights[k];
      }
      step /= 2;
      heights = {best_up - step, best_up + step};
    }
    return *std::move(best);
  }

  const Structure& structure_;
  int threads_;
  std::vector<std::optional<SurfaceInRoom>> views_;
};

/// The arrangement of the best hypothesis. Its sentence also names those that are as probable to
/// within `margin`. A stack without its highest box may be the one without its lowest, seen from
/// the next side.
Arrangement WithEquals(const std::vector<StackHypothesis>& tried, const StackHypothesis& best,
                       double margin) {
  Arrangement result = best.arrangement;
  std::vector<const Arrangement*> named{&best.arrangement};
  for (std::size_t k = 1; k < tried.size(); ++k) {
    const Arrangement& other = tried[k].arrangement;
    if (tried[k].Worth() < best.Worth() - margin || named.size() == kAskedFirst) continue;
    // One and three quarter turns, each with the box a little beside, are one.
    const bool known = std::any_of(named.begin(), named.end(), [&](const Arrangement* each) {
      return each->sentence == other.sentence ||
             (each->box == other.box && each->turn_deg % 180 == 90 && other.turn_deg % 180 == 90);
    });
    if (known) continue;
    named.push_back(&other);
    result.sentence += " or " + other.sentence;
  }
  return result;
}

/// The views that the mirror image explains better than the described stack, and the log odds of
/// all views if these are mirrored.
struct MirrorImages {
  Indices frames;
  double log_odds = 0;
};

MirrorImages FindMirrorImages(const std::vector<StackHypothesis>& tried) {
  const StackHypothesis& described = tried.front();
  MirrorImages mirrored;
  bool others_fit = false;
  for (std::size_t i = 0; i < described.fits.size(); ++i) {
    double image = 0;
    for (const StackHypothesis& each : tried) {
      if (each.arrangement.code == SensorCode::kAssemblyMirrored)
        image = std::max(image, Support(each.fits[i]));
    }
    const double as_described = Support(described.fits[i]);
    const bool is_mirrored = image > as_described + std::log(kModelOdds);
    if (is_mirrored) mirrored.frames.push_back(i);
    others_fit = others_fit || (!is_mirrored && as_described > 0);
    mirrored.log_odds += is_mirrored ? image : as_described;
  }
  if (!others_fit) mirrored.frames.clear();
  return mirrored;
}

}  // namespace

AssemblyReport InspectAssembly(const std::vector<const SensorView*>& views,
                               const Structure& structure, int threads) {
  const std::vector<StackHypothesis> tried = Inspection(views, structure, threads).Try();
  const StackHypothesis& described = tried.front();
  const double decides = std::log(kDecisiveOdds);
  auto most_probable = std::max_element(
      tried.begin(), tried.end(),
      [](const StackHypothesis& a, const StackHypothesis& b) { return a.Worth() < b.Worth(); });
  // The mirror image comes before others that are as probable: one slip explains all frames.
  const double enough = most_probable->Worth() - decides;
  const auto mirror_image =
      std::find_if(tried.begin(), tried.end(), [&](const StackHypothesis& each) {
        return each.arrangement.code == SensorCode::kAssemblyMirrored && each.Worth() > enough;
      });
  if (mirror_image != tried.end()) most_probable = mirror_image;
  const StackHypothesis& best = *most_probable;
  AssemblyReport report;
  report.arrangement = described.arrangement;
  report.described_share = report.share = described.Share();
  report.seen_by = described.SeenBy();
  if (MirrorImages mirrored = FindMirrorImages(tried);
      !mirrored.frames.empty() &&
      best.Worth() <
          mirrored.log_odds + decides * (2 - static_cast<double>(mirrored.frames.size()))) {
    report.mirrored_frames = std::move(mirrored.frames);
    return report;
  }
  const double needed = decides + std::log(static_cast<double>(tried.size()));
  if (best.Worth() > described.Worth() + needed && best.SeenBy().size() >= report.seen_by.size()) {
    report.arrangement = WithEquals(tried, best, decides);
    report.share = best.Share();
    report.seen_by = best.SeenBy();
  }
  return report;
}

}  // namespace volalign
