#include "infer/refine/find_lenses.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "core/parallel_for.h"

namespace volalign {

namespace {

constexpr int kMostRounds = 4;    // of planes found anew
constexpr double kMovedPx = 0.3;  // shift of the picture that is worth another one
/// Standard deviations of its prior that a lens may change by. Beyond it, what was said about it is
/// wrong, and what is between that and what planes say is no lens at all.
constexpr double kContradicted = 5;

/// The frames that look through one lens.
struct LensFrames {
  std::vector<std::size_t> indices;
  std::vector<SensorPlanes> planes;
  std::vector<Intrinsics> assumed;
};

LensFrames FramesOf(const std::vector<SensorPlanes>& planes, const LensSet& lenses,
                    std::size_t lens) {
  LensFrames frames;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (lenses.of_frame[i] != static_cast<int>(lens)) continue;
    frames.indices.push_back(i);
    frames.planes.push_back(planes[i]);
    frames.assumed.push_back(lenses.assumed[i]);
  }
  return frames;
}

/// A lens of which nothing is known: of a pinhole, changed as planes ask for, and the typical
/// lenses, that under which the planes are most probable is assumed.
void ChooseAssumed(const LensFrames& frames, const Straightness& straightness, LensSet* lenses,
                   SensorLens* lens) {
  double best =
      straightness.Straighten(frames.assumed, lens->prior_sigmas, lens->change).log_evidence;
  for (LensPrior& typical : TypicalLenses()) {
    std::vector<Intrinsics> assumed = frames.assumed;
    for (Intrinsics& intrinsics : assumed) intrinsics.distortion = typical.distortion;
    // Its focal length is as little known as before.
    typical.sigmas[0] = lens->prior_sigmas[0];
    const double evidence =
        straightness.Straighten(assumed, typical.sigmas, LensChange::Zero()).log_evidence;
    if (evidence < best + kBelievedLens) continue;
    best = evidence;
    for (std::size_t k = 0; k < assumed.size(); ++k)
      lenses->assumed[frames.indices[k]] = assumed[k];
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

/// Brings a lens to where its planes are flattest, where that is to be believed.
void FindLens(const std::vector<SensorPlanes>& planes, std::size_t index, bool choose_assumed,
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

/// Finds every lens. Returns how far, px, a picture moved.
double FindEach(const std::vector<SensorPlanes>& planes, bool choose_assumed, int threads,
                LensSet* lenses) {
  const LensSet before = *lenses;
  ParallelFor(lenses->lenses.size(), threads,
              [&](std::size_t lens) { FindLens(planes, lens, choose_assumed, lenses); });
  double moved = 0;
  for (std::size_t i = 0; i < planes.size(); ++i)
    moved = std::max(moved, LargestShift(before.Effective(i), lenses->Effective(i)));
  return moved;
}

}  // namespace

std::vector<SensorFrame> SeenThrough(std::vector<SensorFrame> frames, const LensSet& lenses) {
  for (std::size_t i = 0; i < frames.size(); ++i) frames[i].intrinsics = lenses.Effective(i);
  return frames;
}

std::vector<SensorPlanes> FindPlanes(const std::vector<SensorView>& views, const LensSet& lenses,
                                     int threads) {
  std::vector<SensorPlanes> planes(views.size());
  ParallelFor(views.size(), threads, [&](std::size_t i) {
    planes[i].intrinsics = lenses.Effective(i);
    if (!lenses.repeats[i]) planes[i].planes = FindLargePlanes(views[i]);
  });
  return planes;
}

void MeasureLenses(const std::vector<SensorPlanes>& planes, int threads, LensSet* lenses) {
  ParallelFor(lenses->lenses.size(), threads, [&](std::size_t index) {
    SensorLens& lens = lenses->lenses[index];
    if (lens.contradicted) return;
    const LensFrames frames = FramesOf(planes, *lenses, index);
    lens.evidence = Straightness(frames.planes).EvidenceAt(frames.assumed, lens.change);
  });
}

LensSet FindLenses(const std::vector<SensorFrame>& frames, LensSet lenses, int threads) {
  for (int round = 0; round < kMostRounds; ++round) {
    const std::vector<SensorPlanes> planes =
        FindPlanes(MakeSensorViews(SeenThrough(frames, lenses), threads), lenses, threads);
    if (FindEach(planes, round == 0, threads, &lenses) < kMovedPx) break;
  }
  return lenses;
}

}  // namespace volalign
