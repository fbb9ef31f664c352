#include "infer/lens/find_lenses.h"

#include <cstddef>

#include "core/base/parallel_for.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr double kMovedPx = 0.3;  // shift of the picture that is worth another round
/// Largest change of a lens in standard deviations of its prior. Beyond it, the given lens is
/// wrong. A compromise between it and the planes is no real lens.
constexpr double kContradicted = 5;

/// The frames that look through one lens.
struct LensFrames {
  std::vector<FrameId> ids;
  std::vector<SensorPlanes> planes;
  std::vector<Intrinsics> assumed;
};

LensFrames FramesOf(const PerFrame<SensorPlanes>& planes, const LensSet& lenses, std::size_t lens) {
  LensFrames frames;
  for (const FrameId id : planes.Ids()) {
    if (lenses.of_frame[id] != lens) continue;
    frames.ids.push_back(id);
    frames.planes.push_back(planes[id]);
    frames.assumed.push_back(lenses.assumed[id]);
  }
  return frames;
}

/// Chooses the assumed lens if nothing is known of it: the changed pinhole, or the typical lens
/// under which the planes are most probable.
void ChooseAssumed(const LensFrames& frames, const Straightness& straightness, LensSet* lenses,
                   SensorLens* lens) {
  double best =
      straightness.Straighten(frames.assumed, lens->prior_sigmas, lens->change).log_evidence;
  for (LensPrior& typical : TypicalLenses()) {
    std::vector<Intrinsics> assumed = frames.assumed;
    for (Intrinsics& intrinsics : assumed) intrinsics.distortion = typical.distortion;
    // Its focal length is as uncertain as before.
    typical.sigmas[0] = lens->prior_sigmas[0];
    const double evidence =
        straightness.Straighten(assumed, typical.sigmas, LensChange::Zero()).log_evidence;
    if (evidence < best + kBelievedLens) continue;
    best = evidence;
    for (std::size_t k = 0; k < assumed.size(); ++k) lenses->assumed[frames.ids[k]] = assumed[k];
    lens->prior_sigmas = typical.sigmas;
    lens->change = LensChange::Zero();
    lens->source = typical.source;
    lens->unknown = false;
  }
}

bool IsContradicted(const LensEstimate& estimate, const SensorLens& lens) {
  return !lens.unknown &&
         (estimate.change.array().abs() > kContradicted * lens.prior_sigmas.array()).any();
}

/// Changes a lens so that its planes are flattest, if the change is probable enough.
void FindLens(const PerFrame<SensorPlanes>& planes, std::size_t index, bool choose_assumed,
              LensSet* lenses) {
  SensorLens& lens = lenses->lenses[index];
  LensFrames frames = FramesOf(planes, *lenses, index);
  const Straightness straightness(frames.planes);
  if (choose_assumed && lens.unknown) {
    ChooseAssumed(frames, straightness, lenses, &lens);
    frames = FramesOf(planes, *lenses, index);
  }
  const LensEstimate estimate =
      straightness.Straighten(frames.assumed, lens.prior_sigmas, lens.change);
  const bool believed = LogBayesFactor(estimate, lens.prior_sigmas) > kBelievedLens;
  lens.contradicted = IsContradicted(estimate, lens);
  if (lens.unknown && !believed)
    lens.prior_sigmas = lens.prior_sigmas.cwiseMin(SigmasWithoutBend()).eval();
  lens.change = believed && !lens.contradicted ? estimate.change : LensChange::Zero();
  lens.evidence =
      lens.contradicted ? LensEvidence() : straightness.EvidenceAt(frames.assumed, lens.change);
}

}  // namespace

PerFrame<SensorPlanes> FindPlanes(const PerFrame<SensorView>& views, const LensSet& lenses,
                                  int threads) {
  return MapFrames(views, threads, [&](FrameId id) {
    return SensorPlanes{lenses.Effective(id),
                        lenses.repeats[id] ? std::vector<LargePlane>() : FindLargePlanes(views[id]),
                        views[id].errors};
  });
}

FoundLenses FindLenses(const CaptureSet& input, LensSet lenses, int threads) {
  PerFrame<SensorView> views = LookThrough(input, lenses, threads);
  for (int round = 0; round < kRounds; ++round) {
    const PerFrame<SensorPlanes> planes = FindPlanes(views, lenses, threads);
    const LensSet before = lenses;
    ParallelFor(lenses.lenses.size(), threads,
                [&](std::size_t lens) { FindLens(planes, lens, round == 0, &lenses); });
    views = LookThrough(input, lenses, std::move(views), before, threads);
    if (LargestShift(before, lenses) < kMovedPx) break;
  }
  return {std::move(lenses), std::move(views)};
}

}  // namespace volalign
