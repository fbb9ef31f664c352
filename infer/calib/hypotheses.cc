#include "infer/calib/hypotheses.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/base/image.h"
#include "core/base/parallel_for.h"
#include "core/base/statistics.h"
#include "core/geometry/camera.h"
#include "infer/checks/depth_checks.h"
#include "infer/initial/geometry_search.h"
#include "infer/lens/sensor_lens.h"
#include "infer/view/alike.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

/// Largest factor between sizes at which the search still finds a stack.
constexpr double kScaleStep = 1.05;
/// Most frames in which a scale is searched for, and most exchanges.
constexpr std::size_t kMostSearched = 2, kMostExchanges = 3;
/// Error of a focal length, relative, from which on a pose is decimetres off.
constexpr double kFarOffIntrinsics = 0.08;
/// m: least median depth of a frame that shows a structure in a room.
constexpr double kNearestMedian = 0.5;
/// Units of cameras and data sets, m. A scale within kUsually of one of them is rounded to it.
constexpr double kUsualUnits[] = {1, 0.01, 0.001, 0.0005, 0.00025, 0.0002, 0.000125, 0.0001};
constexpr double kUsually = kScaleStep - 1;

const SensorFrame* FindFrame(const Capture& capture, const std::string& name) {
  const auto found = std::find_if(capture.frames.begin(), capture.frames.end(),
                                  [&](const SensorFrame& frame) { return frame.name == name; });
  return found == capture.frames.end() ? nullptr : &*found;
}

// Depths in another unit.

Capture WithScale(Capture capture, const std::set<std::string>& sensors, double factor) {
  const auto scale = [&](Image<float>* image) {
    for (float& z : *image) z = static_cast<float>(factor * static_cast<double>(z));
  };
  for (SensorFrame& frame : capture.frames) {
    if (sensors.count(frame.name) == 0) continue;
    scale(&frame.depth);
    scale(&frame.depth_sigma);
    frame.depth_scale *= factor;
  }
  return capture;
}

/// The factor on depths with which at least half of the views show the structure's shape.
std::optional<double> FindDepthFactor(const std::vector<SensorView>& views,
                                      const Structure& structure, const CalibrateOptions& options) {
  std::vector<double> medians;
  for (const SensorView& view : views) medians.push_back(Quantile(MeasuredDepths(view.depth), 0.5));
  const double middle = Quantile(medians, 0.5);
  if (!(middle > 0)) return std::nullopt;
  std::vector<double> factors;
  for (double factor = kNearestMedian / middle; factor * middle < kFarthest; factor *= kScaleStep)
    factors.push_back(factor);
  std::vector<std::pair<std::size_t, double>> found(factors.size());  // views, their log odds
  ParallelFor(factors.size(), options.threads, [&](std::size_t k) {
    for (const SensorView& view : views) {
      const std::optional<GeometricPose> pose =
          FindBestOnFloors(LookAround(Corrected(view, factors[k], 0), structure), structure);
      if (!pose || !HasShape(pose->shape)) continue;
      ++found[k].first;
      found[k].second += pose->shape.LogOdds();
    }
  });
  const auto best = std::max_element(found.begin(), found.end());
  if (best == found.end() || 2 * best->first < views.size() || best->first == 0)
    return std::nullopt;
  return factors[static_cast<std::size_t>(best - found.begin())];
}

/// The first capture's part of a result.
const StackResult& First(const CalibrationResult& result) {
  if (result.captures.empty()) return result;
  return result.captures.front();
}

/// Sensors of one depth_scale that may be in another unit, with their frames.
struct Suspects {
  double depth_scale = 0;
  std::set<std::string> names;
  std::vector<SensorView> views;
};

bool MayBeOfAnotherUnit(const SensorOutcome& sensor, bool nothing_placed) {
  return sensor.code == SensorCode::kWrongUnits ||
         (nothing_placed && sensor.status == SensorStatus::kFailed &&
          sensor.code != SensorCode::kNoDepth && sensor.code != SensorCode::kDuplicateDepth &&
          sensor.code != SensorCode::kIntrinsicsSuspect);
}

std::vector<Suspects> FindSuspects(const Capture& first, const CalibrationResult& result) {
  std::vector<Suspects> list;
  for (const FrameResult& sensor : First(result).sensors) {
    const SensorFrame* frame = FindFrame(first, sensor.name);
    if (!frame || !MayBeOfAnotherUnit(sensor, result.placed() == 0)) continue;
    auto of_scale = std::find_if(list.begin(), list.end(), [&](const Suspects& suspects) {
      return suspects.depth_scale == frame->depth_scale;
    });
    if (of_scale == list.end())
      of_scale = list.insert(list.end(), Suspects{frame->depth_scale, {}, {}});
    of_scale->names.insert(sensor.name);
    if (of_scale->views.size() < kMostSearched) of_scale->views.push_back(sensor.view);
  }
  return list;
}

/// The depth_scale with which at least half of the suspects are placed, if there is one.
std::optional<double> FindDepthScale(const Suspects& suspects, const Capture& first,
                                     const Structure& structure, const CalibrateOptions& options,
                                     const Recalibrate& recalibrate) {
  const std::optional<double> factor = FindDepthFactor(suspects.views, structure, options);
  if (!factor) return std::nullopt;
  double scale = suspects.depth_scale * *factor;
  const CalibrationResult scaled = recalibrate(WithScale(first, suspects.names, *factor));
  const auto placed =
      std::count_if(scaled.sensors.begin(), scaled.sensors.end(), [&](const FrameResult& sensor) {
        return suspects.names.count(sensor.name) > 0 && sensor.structure_from_sensor;
      });
  if (2 * static_cast<std::size_t>(placed) < suspects.names.size()) return std::nullopt;
  // Boxes that come out too large were measured with too large a scale.
  scale /= scaled.size_scale;
  for (const double usual : kUsualUnits) {
    if (std::abs(scale / usual - 1) < kUsually) scale = usual;
  }
  return scale;
}

void TryScales(const Capture& first, const Structure& structure, const CalibrateOptions& options,
               const Recalibrate& recalibrate, CalibrationResult* result) {
  for (const Suspects& suspects : FindSuspects(first, *result)) {
    const std::optional<double> scale =
        FindDepthScale(suspects, first, structure, options, recalibrate);
    if (!scale || std::abs(*scale / suspects.depth_scale - 1) < kUsually) continue;
    const std::string hint =
        fmt::format("set depth_scale to {:.3g}; it is {:g}", *scale, suspects.depth_scale);
    result->findings.push_back(
        {RigCode::kDepthScale,
         {suspects.names.begin(), suspects.names.end()},
         fmt::format("the structure is found if depths are {:.3g} times as large",
                     *scale / suspects.depth_scale),
         hint});
    for (FrameResult& sensor : result->sensors) {
      if (suspects.names.count(sensor.name) > 0) sensor.hint = hint;
    }
  }
}

// Exchanged depth files.

using Names = std::pair<std::string, std::string>;

/// Can the depth maps of these sensors be confused, and does it make a difference? One sensor's
/// intrinsics differ by a pixel or two from one calibration to the next.
bool CanBeExchanged(const Capture& capture, const Names& names) {
  const SensorFrame *a = FindFrame(capture, names.first), *b = FindFrame(capture, names.second);
  return a && b && a->depth.width() == b->depth.width() && a->depth.height() == b->depth.height() &&
         (a->sensor != b->sensor || LargestShift(a->intrinsics, b->intrinsics) > kClearly);
}

Capture Exchanged(Capture capture, const Names& names) {
  SensorFrame* frames[] = {nullptr, nullptr};
  for (SensorFrame& frame : capture.frames) {
    if (frame.name == names.first) frames[0] = &frame;
    if (frame.name == names.second) frames[1] = &frame;
  }
  std::swap(frames[0]->depth, frames[1]->depth);
  std::swap(frames[0]->depth_sigma, frames[1]->depth_sigma);
  return capture;
}

/// m^2: mean square distance between two sensors' points, over all pairs or those of a sensor.
double MeanSquare(const CalibrationResult& result, const std::string& sensor = "") {
  double sum = 0, count = 0;
  for (const PairResult& pair : result.pairs) {
    if (!pair.overlaps() || (!sensor.empty() && pair.a != sensor && pair.b != sensor)) continue;
    sum += pair.rms_m * pair.rms_m;
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

/// Number of doubts: pairs that are apart, depths with errors that their kinds do not have, and
/// sensors that disagree or have suspect intrinsics.
std::size_t CountDoubts(const CalibrationResult& result) {
  std::size_t doubts = 0;
  for (const RigFinding& finding : result.findings)
    doubts += finding.code == RigCode::kPairApart || finding.code == RigCode::kDepthOff ? 1 : 0;
  for (const FrameResult& sensor : result.sensors) {
    for (const SensorCode code :
         {SensorCode::kIntrinsicsSuspect, SensorCode::kLensSuspect, SensorCode::kDisagrees})
      doubts += sensor.code == code ? 1 : 0;
  }
  return doubts;
}

/// The exchanges to try; the two sensors farthest from the others come first.
std::vector<Names> ExchangesToTry(const Capture& capture, const CalibrationResult& result) {
  std::vector<std::pair<double, Names>> ranked;
  for (const FrameResult& a : result.sensors) {
    for (const FrameResult& b : result.sensors) {
      const Names names(a.name, b.name);
      if (&a < &b && CanBeExchanged(capture, names))
        ranked.emplace_back(-MeanSquare(result, a.name) - MeanSquare(result, b.name), names);
    }
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<Names> first;
  for (std::size_t k = 0; k < std::min(kMostExchanges, ranked.size()); ++k)
    first.push_back(ranked[k].second);
  return first;
}

void TryExchanges(const Capture& first, const Recalibrate& recalibrate, CalibrationResult* result) {
  const std::size_t doubts = CountDoubts(*result);
  const double given = MeanSquare(*result);
  if (doubts == 0) return;
  for (const Names& names : ExchangesToTry(first, *result)) {
    const CalibrationResult exchanged = recalibrate(Exchanged(first, names));
    const double square = MeanSquare(exchanged);
    if (exchanged.placed() < First(*result).placed() || CountDoubts(exchanged) >= doubts ||
        !(square < given / 2))
      continue;
    const auto& [a, b] = names;
    result->findings.insert(
        result->findings.begin(),
        {RigCode::kFilesExchanged,
         {a, b},
         fmt::format("the depth files of {} and {} seem to be exchanged: points of two sensors "
                     "are {:.1f} mm RMS apart if they are exchanged back, and {:.1f} mm as given",
                     a, b, 1000 * std::sqrt(square), 1000 * std::sqrt(given)),
         "exchange the two depth files, or the intrinsics of the two sensors, in the capture"});
    return;
  }
}

// Intrinsics that the stated kind does not have.

void SuspectIntrinsics(const Capture& first, FrameResult* sensor) {
  const SensorFrame* frame = FindFrame(first, sensor->name);
  if (!frame || sensor->code == SensorCode::kWrongUnits || sensor->code == SensorCode::kNoDepth)
    return;
  const Intrinsics& given = frame->intrinsics;
  if (const std::optional<Intrinsics> other = OfAnotherSize(frame->sensor, given)) {
    if (sensor->status == SensorStatus::kOk) sensor->status = SensorStatus::kWeak;
    static_cast<Finding&>(*sensor) = {
        SensorCode::kIntrinsicsSuspect,
        fmt::format("its intrinsics are those of {} at about {}x{}, and its frames are {}x{}",
                    frame->sensor, other->width, other->height, given.width, given.height),
        "if frames were cropped, subtract from cx and cy what was cut off at the left and at the "
        "top. If they were resized, scale fx, fy, cx and cy"};
    return;
  }
  const std::optional<Intrinsics> typical =
      TypicalIntrinsics(frame->sensor, given.width, given.height);
  if (sensor->status == SensorStatus::kOk || !typical ||
      std::abs(std::log(given.fx / typical->fx)) < kFarOffIntrinsics)
    return;
  static_cast<Finding&>(*sensor) = {
      SensorCode::kIntrinsicsSuspect,
      fmt::format("its fx is {:.0f} px, and a {} has about {:.0f} at {}x{}", given.fx,
                  frame->sensor, typical->fx, given.width, given.height),
      "give the intrinsics of this resolution. Scale those of another resolution by the ratio of "
      "the widths"};
}

// Frames that were spoilt before they came here.

/// Share of the measured pixels whose measured neighbours all lie on other surfaces.
double LonelyShare(const SensorView& view) {
  const DepthImage& depth = view.depth;
  double lonely = 0, measured = 0;
  view.VisitMeasured(1, [&](int u, int v) {
    bool any = false, same = false;
    for (const auto& [du, dv] : kBeside) {
      if (!depth.Contains(u + du, v + dv) || !(depth(u + du, v + dv) > 0)) continue;
      any = true;
      same = same || std::abs(depth(u + du, v + dv) - depth(u, v)) < DepthJump(depth(u, v));
    }
    lonely += any && !same ? 1 : 0;
    ++measured;
  });
  return measured > 0 ? lonely / measured : 0;
}

/// Does depth go on behind nearly every edge without a missing pixel? Sensors miss some there, in
/// their shadow or where a pixel sees both; filters fill them.
bool IsFilled(const DepthImage& depth) {
  double jumps = 0, gaps = 0;
  for (int v = 0; v < depth.height(); ++v) {
    int last = -1;
    for (int u = 0; u < depth.width(); ++u) {
      if (!(depth(u, v) > 0)) continue;
      if (last >= 0 && std::abs(depth(u, v) - depth(last, v)) > DepthJump(depth(u, v))) {
        ++jumps;
        gaps += u - last > 1 ? 1 : 0;
      }
      last = u;
    }
  }
  return jumps > depth.height() && gaps < kNotable / 2 * jumps;
}

void SuspectSpoilt(FrameResult* sensor) {
  if (sensor->status == SensorStatus::kOk) return;
  const double share = LonelyShare(sensor->view);
  if (share < kNotable && IsFilled(sensor->view.depth))
    sensor->hint =
        "record frames without filters that fill holes: no depth is missing next to edges. Then " +
        sensor->hint;
  if (share < kNotable) return;
  sensor->hint = fmt::format(
      "give frames as the sensor has them, not means over missing depths, and check their byte "
      "order: {:.0f} % of its pixels are far from what their neighbours measure",
      100 * share);
}

/// If most sensors have wrong intrinsics, the others' doubts have the same cause.
void DoubtTheRest(CalibrationResult* result) {
  const auto is_suspect = [](const FrameResult& sensor) {
    return sensor.code == SensorCode::kIntrinsicsSuspect;
  };
  std::vector<FrameResult>& sensors = result->sensors;
  const auto suspects = std::count_if(sensors.begin(), sensors.end(), is_suspect);
  if (2 * static_cast<std::size_t>(suspects) <= sensors.size()) return;
  for (FrameResult& sensor : sensors) {
    if (!sensor.structure_from_sensor || is_suspect(sensor)) continue;
    const std::string own = sensor.reason.empty() ? "" : "; " + sensor.reason;
    sensor.status = SensorStatus::kWeak;
    static_cast<Finding&>(sensor) = {
        SensorCode::kIntrinsicsSuspect,
        fmt::format("{} of {} sensors of this rig have other intrinsics than given{}", suspects,
                    sensors.size(), own),
        "check the intrinsics of all sensors, and whether their frames were cropped or resized"};
  }
}

}  // namespace

void TryHypotheses(const Capture& first, const Structure& structure,
                   const CalibrateOptions& options, const Recalibrate& recalibrate,
                   CalibrationResult* result) {
  for (FrameResult& sensor : result->sensors) {
    SuspectSpoilt(&sensor);
    SuspectIntrinsics(first, &sensor);
  }
  DoubtTheRest(result);
  TryExchanges(first, recalibrate, result);
  TryScales(first, structure, options, recalibrate, result);
}

}  // namespace volalign
