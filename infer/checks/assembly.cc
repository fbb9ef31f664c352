#include "infer/checks/assembly.h"

#include <algorithm>
#include <utility>

#include "core/parallel_for.h"
#include "infer/pose/agreement.h"
#include "infer/pose/floor.h"

namespace volalign {

namespace {

/// Arrangements, the best ones, that are tried with the labels of a stack that is turned by
/// quarters.
constexpr std::size_t kTurnedArrangements = 8;
/// Overlap of a sensor's view from which on no turned labels are tried for it.
constexpr double kGoodOverlap = 0.9;

/// A view of about kCoarseRays rays.
struct CoarseView {
  SensorView view;
  SegmentationResult segmentation;
  const InitialPose* described_pose = nullptr;
  int labelled = 0;  // pixels with a side label and depth
  double table_height_m = 0;
};

CoarseView MakeCoarse(const AssemblySensor& sensor, double table_height_m) {
  const int stride = StrideForRays(sensor.view->depth.size(), kCoarseRays);
  CoarseView coarse{Decimate(*sensor.view, stride), Decimate(*sensor.segmentation, stride),
                    sensor.initial, 0, table_height_m};
  for (std::size_t i = 0; i < coarse.view.depth.size(); ++i)
    coarse.labelled += coarse.segmentation.labels[i] > 0 && coarse.view.depth[i] > 0 ? 1 : 0;
  return coarse;
}

std::vector<CoarseView> MostLabelled(const std::vector<AssemblySensor>& sensors,
                                     std::size_t max_sensors, double table_height_m) {
  std::vector<CoarseView> views;
  views.reserve(sensors.size());
  for (const AssemblySensor& sensor : sensors) views.push_back(MakeCoarse(sensor, table_height_m));
  std::stable_sort(views.begin(), views.end(), [](const CoarseView& a, const CoarseView& b) {
    return a.labelled > b.labelled;
  });
  if (views.size() > max_sensors) views.resize(max_sensors);
  return views;
}

/// The overlap at a pose; that of a structure which is not seen at all where there is no pose, or
/// where the pose is upside down.
DepthOverlap OverlapAt(const CoarseView& coarse, const Structure& structure,
                       const InitialPose& pose, double min_confidence) {
  if (pose.found &&
      FindFloor(coarse.view, structure, pose.structure_from_sensor, coarse.table_height_m)
              .balance() >= 0) {
    return MeasureOverlap(coarse.view, coarse.segmentation, structure, pose.structure_from_sensor,
                          min_confidence);
  }
  return {0, coarse.labelled};
}

DepthOverlap EstimatedOverlap(const CoarseView& coarse, const Structure& structure,
                              const InitialPoseOptions& initial) {
  const InitialPose pose =
      EstimateInitialPose(coarse.view, coarse.segmentation, structure, initial);
  return OverlapAt(coarse, structure, pose, initial.evidence.min_confidence);
}

DepthOverlap DescribedOverlap(const std::vector<CoarseView>& views, const Structure& structure,
                              double min_confidence) {
  DepthOverlap sum;
  for (const CoarseView& view : views) {
    const DepthOverlap part = OverlapAt(view, structure, *view.described_pose, min_confidence);
    sum.both += part.both;
    sum.either += part.either;
  }
  return sum;
}

/// Overlaps of every arrangement with every view.
struct OverlapTable {
  std::size_t views = 0;
  std::vector<DepthOverlap> cells;  // row by row: arrangement * views + view

  /// Of an arrangement with all views together.
  double ratio(std::size_t arrangement) const {
    DepthOverlap sum;
    for (std::size_t view = 0; view < views; ++view) {
      sum.both += cells[arrangement * views + view].both;
      sum.either += cells[arrangement * views + view].either;
    }
    return sum.ratio();
  }
  std::size_t arrangements() const { return cells.size() / views; }
};

OverlapTable TryArrangements(const std::vector<Arrangement>& arrangements,
                             const std::vector<CoarseView>& views,
                             const InitialPoseOptions& initial, int threads) {
  OverlapTable table{views.size(), std::vector<DepthOverlap>(arrangements.size() * views.size())};
  ParallelFor(table.cells.size(), threads, [&](std::size_t k) {
    table.cells[k] = EstimatedOverlap(views[k % views.size()],
                                      arrangements[k / views.size()].structure, initial);
  });
  return table;
}

/// A network that knows one stack may take a side of another one for its neighbour: its labels are
/// a quarter turn off. The described arrangement and the best others also get poses with such
/// labels, and each view's best overlap counts.
void TryTurnedLabels(const std::vector<Arrangement>& arrangements,
                     const std::vector<CoarseView>& views, const InitialPoseOptions& initial,
                     int threads, OverlapTable* table) {
  std::vector<double> ratios;
  for (std::size_t k = 0; k < table->arrangements(); ++k) ratios.push_back(table->ratio(k));
  std::vector<std::size_t> tried(arrangements.size() - 1);
  for (std::size_t k = 0; k < tried.size(); ++k) tried[k] = k + 1;
  std::stable_sort(tried.begin(), tried.end(),
                   [&](std::size_t a, std::size_t b) { return ratios[a] > ratios[b]; });
  if (tried.size() > kTurnedArrangements) tried.resize(kTurnedArrangements);
  tried.push_back(0);
  ParallelFor(tried.size() * views.size(), threads, [&](std::size_t k) {
    const std::size_t which = tried[k / views.size()], view = k % views.size();
    DepthOverlap& best = table->cells[which * views.size() + view];
    Structure turned = arrangements[which].structure;
    for (int quarter = 1; quarter < 4 && best.ratio() < kGoodOverlap; ++quarter) {
      turned = QuarterTurned(turned);
      const DepthOverlap other = EstimatedOverlap(views[view], turned, initial);
      if (other.ratio() > best.ratio()) best = other;
    }
  });
}

/// The best arrangement but the described one; 0 where there is no other.
std::size_t BestOther(const OverlapTable& table) {
  std::size_t best = 0;
  for (std::size_t k = 1; k < table.arrangements(); ++k) {
    if (best == 0 || table.ratio(k) > table.ratio(best)) best = k;
  }
  return best;
}

/// The best overlap of a view with a stack, labels that are quarter turns off included.
DepthOverlap BestTurned(const CoarseView& view, Structure structure,
                        const InitialPoseOptions& initial) {
  DepthOverlap best = EstimatedOverlap(view, structure, initial);
  for (int quarter = 1; quarter < 4 && best.ratio() < kGoodOverlap; ++quarter) {
    structure = QuarterTurned(structure);
    const DepthOverlap other = EstimatedOverlap(view, structure, initial);
    if (other.ratio() > best.ratio()) best = other;
  }
  return best;
}

/// What one view says of being a mirror image.
struct MirrorEvidence {
  DepthOverlap described, mirrored;
  bool fits = false;            ///< the stack as described
  bool looks_mirrored = false;  ///< the mirror image fits clearly better
};

MirrorEvidence AskForMirrorImage(const CoarseView& view,
                                 const std::vector<Arrangement>& arrangements,
                                 const InitialPoseOptions& initial,
                                 const AssemblyOptions& options) {
  MirrorEvidence evidence;
  const Structure& described = arrangements.front().structure;
  evidence.described =
      OverlapAt(view, described, *view.described_pose, initial.evidence.min_confidence);
  evidence.fits = evidence.described.ratio() >= options.suspicious_frame_overlap;
  if (evidence.fits) return evidence;
  for (const Arrangement& other : arrangements) {
    if (other.code != SensorCode::kAssemblyMirrored) continue;
    const DepthOverlap overlap = BestTurned(view, other.structure, initial);
    if (overlap.ratio() > evidence.mirrored.ratio()) evidence.mirrored = overlap;
  }
  const auto mirrored_is_better = [&] {
    return evidence.mirrored.ratio() >= options.min_overlap &&
           evidence.mirrored.ratio() >= evidence.described.ratio() + options.margin;
  };
  if (!mirrored_is_better()) return evidence;
  const DepthOverlap again = BestTurned(view, described, initial);
  if (again.ratio() > evidence.described.ratio()) evidence.described = again;
  evidence.looks_mirrored = mirrored_is_better();
  return evidence;
}

/// The overlap of all views where those that look mirrored are.
double RatioWithMirrored(const std::vector<MirrorEvidence>& evidence) {
  DepthOverlap sum;
  for (const MirrorEvidence& of : evidence) {
    const DepthOverlap& part = of.looks_mirrored ? of.mirrored : of.described;
    sum.both += part.both;
    sum.either += part.either;
  }
  return sum.ratio();
}

/// An arrangement whose sentence also names the others that look the same: a stack without its
/// highest box may be the one without its lowest, seen from the next side.
Arrangement WithEquals(const std::vector<Arrangement>& arrangements, std::size_t which) {
  Arrangement result = arrangements[which];
  for (std::size_t k = 1; k < arrangements.size(); ++k) {
    if (k == which || arrangements[k].sentence == arrangements[which].sentence) continue;
    if (SameUpToQuarterTurns(result.structure, arrangements[k].structure))
      result.sentence += " or " + arrangements[k].sentence;
  }
  return result;
}

OverlapTable TryAllArrangements(const std::vector<Arrangement>& arrangements,
                                const std::vector<CoarseView>& views,
                                const InitialPoseOptions& initial, int threads) {
  OverlapTable table = TryArrangements(arrangements, views, initial, threads);
  TryTurnedLabels(arrangements, views, initial, threads, &table);
  return table;
}

/// The sensors whose frames alone are mirrored, see InspectAssembly.
std::vector<std::size_t> FindMirroredFrames(const std::vector<AssemblySensor>& sensors,
                                            const Structure& structure,
                                            const InitialPoseOptions& initial,
                                            const AssemblyOptions& options, int threads,
                                            std::size_t max_sensors) {
  const std::vector<Arrangement> arrangements = Arrangements(structure);
  std::vector<MirrorEvidence> evidence(sensors.size());
  ParallelFor(sensors.size(), threads, [&](std::size_t i) {
    evidence[i] = AskForMirrorImage(MakeCoarse(sensors[i], initial.table_height_m), arrangements,
                                    initial, options);
  });
  std::vector<std::size_t> mirrored;
  bool others_fit = false;
  for (std::size_t i = 0; i < evidence.size(); ++i) {
    if (evidence[i].looks_mirrored) mirrored.push_back(i);
    others_fit = others_fit || evidence[i].fits;
  }
  if (mirrored.empty() || !others_fit) return {};
  // A single box that stands otherwise may be seen by some sensors only.
  const OverlapTable table = TryAllArrangements(
      arrangements, MostLabelled(sensors, max_sensors, initial.table_height_m), initial, threads);
  const std::size_t best = BestOther(table);
  const bool explains_all =
      best > 0 && table.ratio(best) >= RatioWithMirrored(evidence) - options.margin / 2;
  return explains_all ? std::vector<std::size_t>() : mirrored;
}

}  // namespace

AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads,
                               std::size_t max_sensors) {
  std::vector<AssemblySensor> asked = sensors;
  std::vector<std::size_t> mirrored =
      FindMirroredFrames(sensors, structure, initial, options, threads, max_sensors);
  for (auto i = mirrored.rbegin(); i != mirrored.rend(); ++i)
    asked.erase(asked.begin() + static_cast<std::ptrdiff_t>(*i));
  const std::vector<CoarseView> views = MostLabelled(asked, max_sensors, initial.table_height_m);
  const double described =
      DescribedOverlap(views, structure, initial.evidence.min_confidence).ratio();
  AssemblyReport report;
  report.mirrored_frames = std::move(mirrored);
  report.arrangement.sentence = "the boxes stand as described";
  report.arrangement.structure = structure;
  report.described_overlap = report.overlap = described;
  if (views.empty() || described >= options.suspicious_overlap) return report;

  const std::vector<Arrangement> arrangements = Arrangements(structure);
  const OverlapTable table = TryAllArrangements(arrangements, views, initial, threads);
  // The pose search on fewer pixels may do better or worse than on all of them: the best counts.
  report.described_overlap = report.overlap = std::max(described, table.ratio(0));
  const std::size_t best = BestOther(table);
  if (best > 0 && table.ratio(best) >= options.min_overlap &&
      table.ratio(best) >= report.described_overlap + options.margin) {
    report.overlap = table.ratio(best);
    report.arrangement = WithEquals(arrangements, best);
  }
  return report;
}

}  // namespace volalign
