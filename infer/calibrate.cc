#include "infer/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <thread>

#include "core/error.h"
#include "core/visibility.h"
#include "infer/sensor_view.h"

namespace volalign {

namespace {

constexpr double kInlierDistance = 0.03;  // design section 9
constexpr double kRmsDistance = 0.1;

/// Runs task(0), ..., task(count - 1) on `threads` threads and rethrows the first exception.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex mutex;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        task(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!failure) failure = std::current_exception();
      }
    }
  };
  std::vector<std::thread> helpers;
  const std::size_t wanted = std::min(count, static_cast<std::size_t>(threads));
  for (std::size_t t = 1; t < wanted; ++t) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
  if (failure) std::rethrow_exception(failure);
}

class Stopwatch {
 public:
  explicit Stopwatch(CalibrationResult* result) : result_(result) {}
  /// Adds the time since the last lap to a stage.
  void Lap(const std::string& stage) {
    const auto now = Clock::now();
    auto& timings = result_->timings_s;
    const auto known = std::find_if(timings.begin(), timings.end(),
                                    [&](const auto& timing) { return timing.first == stage; });
    if (known != timings.end()) {
      known->second += Seconds(now - lap_);
    } else {
      timings.emplace_back(stage, Seconds(now - lap_));
    }
    lap_ = now;
  }
  void Total() { result_->timings_s.emplace_back("total", Seconds(Clock::now() - start_)); }

 private:
  using Clock = std::chrono::steady_clock;
  static double Seconds(Clock::duration d) { return std::chrono::duration<double>(d).count(); }
  CalibrationResult* result_;
  Clock::time_point start_ = Clock::now(), lap_ = start_;
};

/// One sensor on its way through the stages.
struct Work {
  SensorView view;
  InitialPose initial;
  std::unique_ptr<RefineView> refine_view;
  Pose start = Pose::Identity();  // initial pose, refined alone
  double start_offset = 0;        // of the depth, m
  bool placed = false;
};

class Calibration {
 public:
  Calibration(const std::vector<SensorFrame>& frames, const Structure& structure,
              Segmenter& segmenter, const CalibrateOptions& options)
      : frames_(frames),
        structure_(structure),
        segmenter_(segmenter),
        options_(options),
        work_(frames.size()) {
    result_.sensors.resize(frames.size());
    std::set<std::string> names;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (!names.insert(frames[i].name).second) {
        throw DataError(
            fmt::format("two sensors are named \"{}\"; names must be unique", frames[i].name));
      }
      result_.sensors[i].name = frames[i].name;
    }
  }

  CalibrationResult Run() {
    Stopwatch watch(&result_);
    ParallelFor(frames_.size(), options_.threads, [&](std::size_t i) {
      work_[i].view = MakeSensorView(frames_[i].depth, frames_[i].intrinsics);
    });
    watch.Lap("rays");
    Segment(&watch);
    ParallelFor(frames_.size(), options_.threads, [&](std::size_t i) { Place(i); });
    watch.Lap("placement");
    RefineTogether();
    watch.Lap("refinement");
    Measure();
    watch.Lap("metrics");
    watch.Total();
    return std::move(result_);
  }

 private:
  double ValidShare(std::size_t i) const {
    const DepthImage& depth = work_[i].view.depth;
    const auto valid = std::count_if(depth.begin(), depth.end(), [](float z) { return z > 0; });
    return depth.empty() ? 0 : static_cast<double>(valid) / static_cast<double>(depth.size());
  }

  /// One sensor's frame as the network sees it after `turns`, and the pose that follows.
  struct Trial {
    std::size_t sensor = 0;
    int turns = 0;
    SegmentationResult segmentation;
    InitialPose initial;
    int floor = 0;  // FloorEvidence::balance at the pose
    double score() const { return initial.found ? initial.agreement.score() : 0; }
    /// Beyond doubt: the labels fit the structure, and it stands on a floor. Upside down it would
    /// not (infer/agreement.h, FindFloor).
    bool decided() const {
      constexpr double kDecided = 0.6;
      return initial.found && floor > 0 && score() >= kDecided;
    }
  };

  /// Segments and poses the trials from `begin` on, in as few forward passes as sizes allow.
  void Try(std::vector<Trial>* trials, std::size_t begin, Stopwatch* watch) {
    std::vector<SegmentationRequest> requests;
    for (std::size_t t = begin; t < trials->size(); ++t) {
      const Trial& trial = (*trials)[t];
      requests.push_back(
          {&work_[trial.sensor].view.depth, &frames_[trial.sensor].intrinsics, trial.turns});
    }
    if (requests.empty()) return;
    std::vector<SegmentationResult> results = segmenter_.Segment(requests);
    for (std::size_t t = begin; t < trials->size(); ++t)
      (*trials)[t].segmentation = std::move(results[t - begin]);
    watch->Lap("segmentation");
    ParallelFor(trials->size() - begin, options_.threads, [&](std::size_t k) {
      Trial& trial = (*trials)[begin + k];
      const SensorView& view = work_[trial.sensor].view;
      trial.initial = EstimateInitialPose(view, trial.segmentation, structure_, options_.initial);
      if (trial.initial.found) {
        trial.floor = FindFloor(view, structure_, trial.initial.structure_from_sensor).balance();
      }
    });
    watch->Lap("initial_pose");
  }

  /// Labels and initial pose of every sensor. `auto` takes the network's own orientation where that
  /// decides, then, sensors of a rig being mounted alike, the turn of the first sensor that it did
  /// not, and tries all four only where neither does: the turn whose labels agree best with a pose
  /// that stands on the floor.
  void Segment(Stopwatch* watch) {
    std::vector<Trial> trials;
    const auto add = [&](std::size_t i, int turns) {
      Trial trial;
      trial.sensor = i;
      trial.turns = turns;
      trials.push_back(std::move(trial));
    };
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (ValidShare(i) < options_.verdict.min_valid_share) {
        result_.sensors[i].segmentation = {
            LabelImage(work_[i].view.width(), work_[i].view.height()),
            Image<float>(work_[i].view.width(), work_[i].view.height())};
      } else {
        add(i, frames_[i].quarter_turns == kAutoTurns ? 0 : frames_[i].quarter_turns);
      }
    }
    Try(&trials, 0, watch);
    std::vector<std::size_t> open;
    for (const Trial& trial : trials) {
      if (frames_[trial.sensor].quarter_turns == kAutoTurns && !trial.decided())
        open.push_back(trial.sensor);
    }
    int usual = 0;
    if (!open.empty()) {
      const std::size_t begin = trials.size();
      for (int turns = 1; turns < 4; ++turns) add(open.front(), turns);
      Try(&trials, begin, watch);
      for (std::size_t t = begin; t < trials.size(); ++t) {
        if (trials[t].decided()) usual = trials[t].turns;
      }
      open.erase(open.begin());
    }
    if (usual != 0) {
      const std::size_t begin = trials.size();
      for (const std::size_t i : open) add(i, usual);
      Try(&trials, begin, watch);
      open.clear();
      for (std::size_t t = begin; t < trials.size(); ++t) {
        if (!trials[t].decided()) open.push_back(trials[t].sensor);
      }
    }
    const std::size_t begin = trials.size();
    for (const std::size_t i : open) {
      for (int turns = 1; turns < 4; ++turns) {
        if (turns != usual) add(i, turns);
      }
    }
    Try(&trials, begin, watch);
    TakeBest(&trials);
  }

  /// Turns that explain a view about as well as the best one compete by how the structure stands on
  /// the floor.
  void TakeBest(std::vector<Trial>* trials) {
    std::vector<double> best(frames_.size(), 0);
    for (const Trial& trial : *trials)
      best[trial.sensor] = std::max(best[trial.sensor], trial.score());
    constexpr double kRival = 0.5;
    std::vector<const Trial*> chosen(frames_.size(), nullptr);
    for (const Trial& trial : *trials) {
      const std::size_t i = trial.sensor;
      if (trial.score() < kRival * best[i]) continue;
      if (!chosen[i] || trial.floor > chosen[i]->floor ||
          (trial.floor == chosen[i]->floor && trial.score() > chosen[i]->score())) {
        chosen[i] = &trial;
      }
    }
    for (Trial& trial : *trials) {
      if (chosen[trial.sensor] != &trial) continue;
      result_.sensors[trial.sensor].quarter_turns = trial.turns;
      result_.sensors[trial.sensor].segmentation = std::move(trial.segmentation);
      work_[trial.sensor].initial = std::move(trial.initial);
    }
  }

  void Fail(std::size_t i, const char* code, std::string reason, const char* hint) {
    SensorResult& sensor = result_.sensors[i];
    sensor.status = SensorStatus::kFailed;
    sensor.code = code;
    sensor.reason = std::move(reason);
    sensor.hint = hint;
  }

  RefineSensor Refinable(std::size_t i) const {
    const auto& without = options_.refine.without_structure;
    return {work_[i].refine_view.get(), work_[i].initial.structure_from_sensor, work_[i].start,
            std::find(without.begin(), without.end(), frames_[i].name) == without.end(),
            work_[i].start_offset};
  }

  /// Refines a sensor alone and decides, by what its view then explains, whether it sees the
  /// structure.
  void Place(std::size_t i) {
    Work& work = work_[i];
    SensorResult& sensor = result_.sensors[i];
    const double valid = ValidShare(i);
    if (valid < options_.verdict.min_valid_share) {
      return Fail(i, "no_depth", fmt::format("{:.1f} % of the pixels have depth", 100 * valid),
                  "check the depth file, its depth_scale and the sensor's lens cap");
    }
    constexpr char kLookHint[] =
        "turn the sensor so that it sees most of the structure, from 1.5 to 3.5 m";
    if (!work.initial.found) {
      // One or two sides on which the network is sure are a structure seen too narrowly; less is
      // none.
      double area = 0;
      for (const SideEvidence& patch : work.initial.evidence)
        area += patch.mean_confidence > 0.8 ? patch.area : 0;
      constexpr double kSideArea = 0.05;  // m^2: half of the smallest side
      if (area < kSideArea) {
        return Fail(i, "no_structure", "no side of the structure was found", kLookHint);
      }
      return Fail(i, "degenerate_sides",
                  fmt::format("{} found; that fixes no pose", Sides(work.initial.evidence.size())),
                  kLookHint);
    }
    RefineView::Options view_options;
    view_options.min_confidence = options_.initial.evidence.min_confidence;
    view_options.max_side_points = options_.refine.max_side_points;
    view_options.max_edge_points = options_.refine.max_edge_points;
    work.refine_view =
        std::make_unique<RefineView>(work.view, sensor.segmentation, structure_, view_options);
    work.start = work.initial.structure_from_sensor;
    RefineSensor alone = Refinable(i);
    double alone_sigma_m = 0;
    if (alone.use_structure_terms) {
      RefineOptions refine = options_.refine;
      refine.max_overlap_points = 0;
      refine.threads = 1;
      const RefinedSensor refined = Refine(structure_, {alone}, refine).sensors.front();
      work.start = refined.structure_from_sensor;
      work.start_offset = refined.depth_offset;
      alone_sigma_m = std::sqrt(refined.covariance.diagonal().head<3>().maxCoeff());
    }
    const SensorView corrected = WithOffset(work.view, work.start_offset);
    const Agreement agreement =
        CompareWithView(corrected, sensor.segmentation, structure_, work.start,
                        options_.initial.evidence.min_confidence, kInlierDistance);
    sensor.miou = agreement.miou;
    sensor.label_iou = agreement.score();
    sensor.explained_share = agreement.explained_share();
    const std::vector<int> labels = ConfirmedLabels(i, work.start);
    for (const int label : labels) sensor.sides.push_back(structure_.SideOfLabel(label).name);

    const VerdictOptions& limits = options_.verdict;
    const bool seen = agreement.explained_share() >= limits.min_explained_share &&
                      agreement.see_through_share() <= limits.max_see_through_share;
    const bool on_sides = agreement.inlier_share() >= limits.min_inlier_share;
    if (!seen || !on_sides) return FailVerification(i, agreement, seen);
    const KeypointKind kind =
        options_.initial.keypoints == "centre" ? KeypointKind::kCentre : KeypointKind::kExposed;
    if (!SidesFixPose(structure_, labels, kind)) {
      return Fail(
          i, "degenerate_sides",
          fmt::format(
              "{} found; their keypoints lie on a line and their planes leave a direction free",
              Sides(labels.size())),
          "move the sensor sideways or up, until it sees sides of more than one orientation");
    }
    if (agreement.score() < limits.min_label_iou) return FailVerification(i, agreement, seen);
    if (!(alone_sigma_m <= limits.max_sigma_translation_m)) {
      return Fail(i, "degenerate_sides",
                  fmt::format("{} found, which leave the sensor's position open to {:.2f} m",
                              Sides(labels.size()), alone_sigma_m),
                  kLookHint);
    }
    work.placed = true;
  }

  static std::string Sides(std::size_t count) {
    return fmt::format("{} side{}", count, count == 1 ? " was" : "s were");
  }

  void FailVerification(std::size_t i, const Agreement& agreement, bool seen) {
    double area = 0;
    std::size_t sure = 0;
    for (const SideEvidence& patch : work_[i].initial.evidence) {
      if (patch.mean_confidence < 0.8) continue;
      area += patch.area;
      ++sure;
    }
    const std::string facts = fmt::format(
        "at the best pose {:.0f} % of the labelled pixels lie on their sides, {:.0f} % of the "
        "structure's view is "
        "measured on it and {:.0f} % of that is seen through",
        100 * agreement.inlier_share(), 100 * agreement.explained_share(),
        100 * agreement.see_through_share());
    constexpr double kStructureArea =
        0.5;  // m^2: a structure seen from one corner shows over 1 m^2
    if (sure >= 4 && area > kStructureArea && (seen || agreement.inlier_share() > 0.3)) {
      return Fail(
          i, "inconsistent",
          "the sides that were found do not fit the structure together: " + facts,
          "check that the boxes are stacked as the structure file says, and the intrinsics and "
          "depth_scale");
    }
    Fail(i, "no_structure", "what looks like sides is not the structure: " + facts,
         "turn the sensor so that it sees most of the structure, from 1.5 to 3.5 m");
  }

  /// Labels of patches that lie, for the most part, on their side.
  std::vector<int> ConfirmedLabels(std::size_t i, const Pose& pose) const {
    const SensorView& view = work_[i].view;
    std::set<int> labels;
    for (const SideEvidence& patch : work_[i].initial.evidence) {
      const Side& side = structure_.SideOfLabel(patch.label);
      std::size_t on_side = 0;
      for (const int pixel : patch.pixels) {
        const Eigen::Vector3d p = pose * view.Point(pixel % view.width(), pixel / view.width());
        if ((side.ClosestPoint(p) - p).norm() <= kInlierDistance) ++on_side;
      }
      if (10 * on_side >= 6 * patch.pixels.size()) labels.insert(patch.label);
    }
    return std::vector<int>(labels.begin(), labels.end());
  }

  void RefineTogether() {
    std::vector<RefineSensor> sensors;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (!work_[i].placed) continue;
      sensors.push_back(Refinable(i));
      index.push_back(i);
    }
    const RefineResult refined = Refine(structure_, sensors, options_.refine);
    for (std::size_t j = 0; j < index.size(); ++j) {
      SensorResult& sensor = result_.sensors[index[j]];
      sensor.initial = sensors[j].initial;
      sensor.structure_from_sensor = refined.sensors[j].structure_from_sensor;
      sensor.refinement_accepted = refined.sensors[j].accepted;
      sensor.covariance = refined.sensors[j].covariance;
      sensor.depth_offset_m = refined.sensors[j].depth_offset;
    }
    for (const RefinedPair& pair : refined.pairs) {
      result_.pairs.push_back({frames_[index[static_cast<std::size_t>(pair.a)]].name,
                               frames_[index[static_cast<std::size_t>(pair.b)]].name, pair.overlap,
                               pair.rms});
    }
  }

  void Measure() {
    ParallelFor(frames_.size(), options_.threads, [&](std::size_t i) {
      if (work_[i].placed) Judge(i);
    });
    std::vector<Eigen::Vector3d> captured;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (!work_[i].placed) continue;
      const SensorResult& sensor = result_.sensors[i];
      const SensorView view = WithOffset(work_[i].view, sensor.depth_offset_m);
      for (int v = 0; v < view.height(); ++v) {
        for (int u = 0; u < view.width(); ++u) {
          if (sensor.segmentation.labels(u, v) == 0 || !(view.depth(u, v) > 0)) continue;
          captured.push_back(*sensor.structure_from_sensor * view.Point(u, v));
        }
      }
    }
    constexpr std::size_t kMost = 100000;
    const std::size_t step = captured.size() / kMost + 1;
    std::vector<Eigen::Vector3d> near;
    for (std::size_t j = 0; j < captured.size(); j += step) {
      if (DistanceToSurface(structure_, captured[j]).distance < kRmsDistance)
        near.push_back(captured[j]);
    }
    if (!near.empty()) result_.metrics = CompareSets(near, SampleExposedSurface(structure_, 0.005));
  }

  /// Residuals, errors and status of a placed sensor.
  void Judge(std::size_t i) {
    SensorResult& sensor = result_.sensors[i];
    const SensorView view = WithOffset(work_[i].view, sensor.depth_offset_m);
    const Pose& pose = *sensor.structure_from_sensor;
    const SurfaceFit fit = FitToSurface(view, sensor.segmentation.labels, structure_, pose);
    sensor.points = fit.points;
    sensor.rms_to_structure_m = fit.rms_m;
    sensor.inlier_share = fit.inlier_share;
    sensor.initial_rms_to_structure_m =
        FitToSurface(work_[i].view, sensor.segmentation.labels, structure_, sensor.initial).rms_m;
    if (frames_[i].ground_truth) {
      sensor.error = ComparePoses(pose, *frames_[i].ground_truth);
      sensor.initial_error = ComparePoses(sensor.initial, *frames_[i].ground_truth);
    }
    const VerdictOptions& limits = options_.verdict;
    const double sigma_m = sensor.sigma_translation_m().maxCoeff();
    const double sigma_deg = sensor.sigma_rotation_deg().maxCoeff();
    sensor.status = SensorStatus::kWeak;
    if (sensor.inlier_share < limits.weak_inlier_share) {
      sensor.code = "few_inliers";
      sensor.reason =
          fmt::format("{:.0f} % of the labelled pixels lie within 3 cm of the structure",
                      100 * sensor.inlier_share);
      sensor.hint = "look at pictures/ for what else was labelled, and clear it away";
    } else if (sensor.rms_to_structure_m > limits.weak_rms_m) {
      sensor.code = "large_residual";
      sensor.reason = fmt::format("points are {:.1f} mm RMS off the structure",
                                  1000 * sensor.rms_to_structure_m);
      sensor.hint = "check the boxes' dimensions and placement, the intrinsics and the depth_scale";
    } else if (sensor.label_iou < limits.weak_label_iou) {
      sensor.code = "labels_disagree";
      sensor.reason =
          fmt::format("labels as predicted and as seen from the pose overlap by {:.0f} %",
                      100 * sensor.label_iou);
      sensor.hint =
          "look at pictures/: something may hide the structure, or the sensor be too near or far";
    } else if (!(sigma_m <= limits.weak_sigma_translation_m) ||
               !(sigma_deg <= limits.weak_sigma_rotation_deg)) {
      sensor.code = "uncertain";
      sensor.reason = fmt::format("the pose is known to {:.1f} mm and {:.2f} deg only",
                                  1000 * sigma_m, sigma_deg);
      sensor.hint = "let it see more sides, or more of what its neighbours see";
    } else {
      sensor.status = SensorStatus::kOk;
    }
  }

  const std::vector<SensorFrame>& frames_;
  const Structure& structure_;
  Segmenter& segmenter_;
  const CalibrateOptions& options_;
  std::vector<Work> work_;
  CalibrationResult result_;
};

}  // namespace

const char* ToString(SensorStatus status) {
  switch (status) {
    case SensorStatus::kOk:
      return "ok";
    case SensorStatus::kWeak:
      return "weak";
    case SensorStatus::kFailed:
      break;
  }
  return "failed";
}

Eigen::Vector3d SensorResult::sigma_rotation_deg() const {
  return covariance.diagonal().tail<3>().cwiseSqrt() * 180 / M_PI;
}

SensorStatus CalibrationResult::verdict() const {
  SensorStatus worst = SensorStatus::kOk;
  for (const SensorResult& sensor : sensors) worst = std::max(worst, sensor.status);
  return worst;
}

int CalibrationResult::placed() const {
  return static_cast<int>(std::count_if(
      sensors.begin(), sensors.end(),
      [](const SensorResult& sensor) { return sensor.structure_from_sensor.has_value(); }));
}

SurfaceFit FitToSurface(const SensorView& view, const LabelImage& labels,
                        const Structure& structure, const Pose& structure_from_sensor) {
  SurfaceFit fit;
  double squares = 0;
  int near = 0, inliers = 0;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (labels(u, v) == 0 || !(view.depth(u, v) > 0)) continue;
      ++fit.points;
      const double distance =
          DistanceToSurface(structure, structure_from_sensor * view.Point(u, v)).distance;
      if (distance < kRmsDistance) {
        squares += distance * distance;
        ++near;
      }
      if (distance <= kInlierDistance) ++inliers;
    }
  }
  if (near > 0) fit.rms_m = std::sqrt(squares / near);
  if (fit.points > 0) fit.inlier_share = static_cast<double>(inliers) / fit.points;
  return fit;
}

CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  ValidateConfig(options);
  for (const std::string& name : options.refine.without_structure) {
    if (std::none_of(frames.begin(), frames.end(),
                     [&](const SensorFrame& f) { return f.name == name; })) {
      throw ConfigError(fmt::format(
          "refine.without_structure names \"{}\", which is no sensor of the capture", name));
    }
  }
  return Calibration(frames, structure, segmenter, options).Run();
}

}  // namespace volalign
