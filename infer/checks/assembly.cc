#include "infer/checks/assembly.h"

#include <algorithm>
#include <utility>

#include "core/base/lists.h"
#include "core/base/parallel_for.h"
#include "infer/initial/agreement.h"
#include "infer/initial/floor.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Arrangements, the best ones, that are tried with the labels of a stack that is turned by
/// quarters.
constexpr std::size_t kTurnedArrangements = kBeam;
/// Sensors that are asked at most, those with the most labelled pixels.
constexpr std::size_t kMostAsked = kBeam;
/// Overlap of a sensor's view from which on no turned labels are tried for it.
constexpr double kGoodIou = 0.9;

/// A view of about kCoarseRays rays.
struct CoarseFrame {
  SensorView view;
  SegmentationResult segmentation;
  const InitialPose* described_pose = nullptr;
  int labelled = 0;  // pixels with a side label and depth
};

CoarseFrame MakeCoarse(const AssemblySensor& sensor) {
  const int stride = StrideForRays(sensor.view->depth.size(), kCoarseRays);
  CoarseFrame coarse{Decimate(*sensor.view, stride), Decimate(*sensor.segmentation, stride),
                     sensor.initial, 0};
  for (std::size_t i = 0; i < coarse.view.depth.size(); ++i)
    coarse.labelled += coarse.segmentation.labels[i] > 0 && coarse.view.depth[i] > 0 ? 1 : 0;
  return coarse;
}

std::vector<CoarseFrame> MostLabelled(const std::vector<AssemblySensor>& sensors) {
  std::vector<CoarseFrame> views;
  views.reserve(sensors.size());
  for (const AssemblySensor& sensor : sensors) views.push_back(MakeCoarse(sensor));
  KeepLargest(kMostAsked, &views, [](const CoarseFrame& view) { return view.labelled; });
  return views;
}

/// ShapeIou at a pose; that of a structure which is not seen at all where there is no pose, or
/// where the pose is upside down.
ShapeIou IouAt(const CoarseFrame& coarse, const Structure& structure, const InitialPose& pose,
               double min_confidence) {
  if (pose.found && FindFloor(coarse.view, structure, pose.structure_from_sensor).balance() >= 0) {
    return MeasureShapeIou(coarse.view, coarse.segmentation, structure, pose.structure_from_sensor,
                           min_confidence);
  }
  return {0, coarse.labelled};
}

ShapeIou EstimatedIou(const CoarseFrame& coarse, const Structure& structure,
                      const InitialPoseOptions& initial) {
  const InitialPose pose =
      EstimateInitialPose(coarse.view, coarse.segmentation, structure, initial);
  return IouAt(coarse, structure, pose, initial.patch.min_confidence);
}

/// The best ShapeIou of a view with a stack, labels that are quarter turns off included. `best`:
/// with labels that are not.
ShapeIou BestTurned(const CoarseFrame& view, Structure structure, const InitialPoseOptions& initial,
                    ShapeIou best) {
  for (int quarter = 1; quarter < 4 && best.ratio() < kGoodIou; ++quarter) {
    structure = QuarterTurned(structure);
    const ShapeIou other = EstimatedIou(view, structure, initial);
    if (other.ratio() > best.ratio()) best = other;
  }
  return best;
}

ShapeIou DescribedIou(const std::vector<CoarseFrame>& views, const Structure& structure,
                      double min_confidence) {
  ShapeIou sum;
  for (const CoarseFrame& view : views)
    sum += IouAt(view, structure, *view.described_pose, min_confidence);
  return sum;
}

/// Overlaps of every arrangement with every view.
struct IouTable {
  std::size_t views = 0;
  std::vector<ShapeIou> cells;  // row by row: arrangement * views + view

  /// Of an arrangement with all views together.
  double ratio(std::size_t arrangement) const {
    ShapeIou sum;
    for (std::size_t view = 0; view < views; ++view) sum += cells[arrangement * views + view];
    return sum.ratio();
  }
  std::size_t arrangements() const { return cells.size() / views; }
};

/// A network that knows one stack may take a side of another one for its neighbour: its labels are
/// a quarter turn off. The described arrangement and the best others also get poses with such
/// labels, and each view's best ShapeIou counts.
void TryTurnedLabels(const std::vector<Arrangement>& arrangements,
                     const std::vector<CoarseFrame>& views, const InitialPoseOptions& initial,
                     int threads, IouTable* table) {
  std::vector<double> ratios;
  for (std::size_t k = 0; k < table->arrangements(); ++k) ratios.push_back(table->ratio(k));
  std::vector<std::size_t> tried(arrangements.size() - 1);
  for (std::size_t k = 0; k < tried.size(); ++k) tried[k] = k + 1;
  KeepLargest(kTurnedArrangements, &tried, [&](std::size_t k) { return ratios[k]; });
  tried.push_back(0);
  ParallelFor(tried.size() * views.size(), threads, [&](std::size_t k) {
    const std::size_t which = tried[k / views.size()], view = k % views.size();
    ShapeIou& best = table->cells[which * views.size() + view];
    best = BestTurned(views[view], arrangements[which].structure, initial, best);
  });
}

IouTable TryArrangements(const std::vector<Arrangement>& arrangements,
                         const std::vector<CoarseFrame>& views, const InitialPoseOptions& initial,
                         int threads) {
  IouTable table{views.size(), std::vector<ShapeIou>(arrangements.size() * views.size())};
  ParallelFor(table.cells.size(), threads, [&](std::size_t k) {
    table.cells[k] =
        EstimatedIou(views[k % views.size()], arrangements[k / views.size()].structure, initial);
  });
  TryTurnedLabels(arrangements, views, initial, threads, &table);
  return table;
}

/// The best arrangement but the described one; 0 where there is no other.
std::size_t BestOther(const IouTable& table) {
  std::size_t best = 0;
  for (std::size_t k = 1; k < table.arrangements(); ++k) {
    if (best == 0 || table.ratio(k) > table.ratio(best)) best = k;
  }
  return best;
}

/// What one view says of being a mirror image.
struct MirrorFit {
  ShapeIou described, mirrored;
  bool fits = false;            ///< the stack as described
  bool looks_mirrored = false;  ///< the mirror image fits clearly better
};

MirrorFit AskForMirrorImage(const CoarseFrame& view, const std::vector<Arrangement>& arrangements,
                            const InitialPoseOptions& initial, const AssemblyOptions& options) {
  MirrorFit fit;
  const Structure& described = arrangements.front().structure;
  fit.described = IouAt(view, described, *view.described_pose, initial.patch.min_confidence);
  fit.fits = fit.described.ratio() >= options.suspicious_frame_shape_iou;
  if (fit.fits) return fit;
  for (const Arrangement& other : arrangements) {
    if (other.code != SensorCode::kAssemblyMirrored) continue;
    const ShapeIou iou =
        BestTurned(view, other.structure, initial, EstimatedIou(view, other.structure, initial));
    if (iou.ratio() > fit.mirrored.ratio()) fit.mirrored = iou;
  }
  const auto mirrored_is_better = [&] {
    return fit.mirrored.ratio() >= options.min_shape_iou &&
           fit.mirrored.ratio() >= fit.described.ratio() + options.margin;
  };
  if (!mirrored_is_better()) return fit;
  const ShapeIou again =
      BestTurned(view, described, initial, EstimatedIou(view, described, initial));
  if (again.ratio() > fit.described.ratio()) fit.described = again;
  fit.looks_mirrored = mirrored_is_better();
  return fit;
}

/// ShapeIou of all views where those that look mirrored are.
double RatioWithMirrored(const std::vector<MirrorFit>& fits) {
  ShapeIou sum;
  for (const MirrorFit& of : fits) sum += of.looks_mirrored ? of.mirrored : of.described;
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

/// The sensors whose frames alone are mirrored, see InspectAssembly.
std::vector<std::size_t> FindMirroredFrames(const std::vector<AssemblySensor>& sensors,
                                            const Structure& structure,
                                            const InitialPoseOptions& initial,
                                            const AssemblyOptions& options, int threads) {
  const std::vector<Arrangement> arrangements = Arrangements(structure);
  std::vector<MirrorFit> fits(sensors.size());
  ParallelFor(sensors.size(), threads, [&](std::size_t i) {
    fits[i] = AskForMirrorImage(MakeCoarse(sensors[i]), arrangements, initial, options);
  });
  std::vector<std::size_t> mirrored;
  bool others_fit = false;
  for (std::size_t i = 0; i < fits.size(); ++i) {
    if (fits[i].looks_mirrored) mirrored.push_back(i);
    others_fit = others_fit || fits[i].fits;
  }
  if (mirrored.empty() || !others_fit) return {};
  // A single box that stands otherwise may be seen by some sensors only.
  const IouTable table = TryArrangements(arrangements, MostLabelled(sensors), initial, threads);
  const std::size_t best = BestOther(table);
  const bool explains_all =
      best > 0 && table.ratio(best) >= RatioWithMirrored(fits) - options.margin / 2;
  return explains_all ? std::vector<std::size_t>() : mirrored;
}

}  // namespace

AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads) {
  std::vector<AssemblySensor> asked = sensors;
  std::vector<std::size_t> mirrored =
      FindMirroredFrames(sensors, structure, initial, options, threads);
  for (auto i = mirrored.rbegin(); i != mirrored.rend(); ++i)
    asked.erase(asked.begin() + static_cast<std::ptrdiff_t>(*i));
  const std::vector<CoarseFrame> views = MostLabelled(asked);
  const double described = DescribedIou(views, structure, initial.patch.min_confidence).ratio();
  AssemblyReport report;
  report.mirrored_frames = std::move(mirrored);
  report.arrangement.sentence = "the boxes stand as described";
  report.arrangement.structure = structure;
  report.described_shape_iou = report.shape_iou = described;
  if (views.empty() || described >= options.suspicious_shape_iou) return report;

  const std::vector<Arrangement> arrangements = Arrangements(structure);
  const IouTable table = TryArrangements(arrangements, views, initial, threads);
  // The pose search on fewer pixels may do better or worse than on all of them: the best counts.
  report.described_shape_iou = report.shape_iou = std::max(described, table.ratio(0));
  const std::size_t best = BestOther(table);
  if (best > 0 && table.ratio(best) >= options.min_shape_iou &&
      table.ratio(best) >= report.described_shape_iou + options.margin) {
    report.shape_iou = table.ratio(best);
    report.arrangement = WithEquals(arrangements, best);
  }
  return report;
}

}  // namespace volalign
