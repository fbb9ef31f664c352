#include "infer/refine/find_lenses.h"

#include <cmath>
#include <cstddef>
#include <utility>

#include "core/parallel_for.h"

namespace volalign {

namespace {

constexpr int kMostRounds = 4;    // of planes found anew
constexpr double kMovedPx = 0.3;  // shift of the picture that is worth another one

std::vector<SensorPlanes> OfLens(const std::vector<SensorPlanes>& planes, const LensSet& lenses,
                                 std::size_t lens) {
  std::vector<SensorPlanes> of;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (lenses.of_frame[i] == static_cast<int>(lens)) of.push_back(planes[i]);
  }
  return of;
}

/// Brings every lens to where its planes are flattest. Returns how far, px, a picture moved.
double Straighten(const std::vector<SensorPlanes>& planes, int threads, LensSet* lenses) {
  const LensSet before = *lenses;
  ParallelFor(lenses->lenses.size(), threads, [&](std::size_t lens) {
    SensorLens& of = lenses->lenses[lens];
    const LensEstimate estimate = StraightenPlanes(OfLens(planes, *lenses, lens), of.prior_sigmas);
    const bool believed = LogBayesFactor(estimate, of.prior_sigmas) > kBelievedLens;
    of.change = believed ? estimate.change : LensChange::Zero();
  });
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
    planes[i] = {lenses.assumed[i], lenses.Of(i).change, FindLargePlanes(views[i])};
  });
  return planes;
}

void MeasureLenses(const std::vector<SensorPlanes>& planes, int threads, LensSet* lenses) {
  ParallelFor(lenses->lenses.size(), threads, [&](std::size_t lens) {
    SensorLens& of = lenses->lenses[lens];
    of.evidence = LensEvidence();
    of.evidence = PlaneEvidence(OfLens(planes, *lenses, lens), of.change);
  });
}

LensSet FindLenses(const std::vector<SensorFrame>& frames, LensSet lenses, int threads) {
  for (int round = 0; round < kMostRounds; ++round) {
    const std::vector<SensorPlanes> planes =
        FindPlanes(MakeSensorViews(SeenThrough(frames, lenses), threads), lenses, threads);
    if (Straighten(planes, threads, &lenses) < kMovedPx || round + 1 == kMostRounds) {
      MeasureLenses(planes, threads, &lenses);
      break;
    }
  }
  return lenses;
}

}  // namespace volalign
