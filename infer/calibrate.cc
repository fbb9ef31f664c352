#include "infer/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <set>
#include <tuple>

#include "core/error.h"
#include "core/parallel_for.h"
#include "core/visibility.h"
#include "infer/checks/intrinsics_check.h"
#include "infer/pose/aliases.h"
#include "infer/pose/floor.h"
#include "infer/pose/pose_choice.h"
#include "infer/pose/relabel.h"
#include "infer/pose/sides_fix_pose.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

constexpr double kRelabelDistance = 0.04;  // m: real boxes stray by centimetres
constexpr double kInlierDistance = 0.03;   // design section 9
constexpr double kRmsDistance = 0.1;

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
  bool rejected = false;          // failed before its pose was looked at
  std::string same_depth_as;      // another sensor with the same depth map
  std::optional<BetterIntrinsics> better_intrinsics;
  bool placed = false;
  std::string other_pose;  // that explains the view about as well: how the structure stands there
};

class Calibration {
 public:
  Calibration(const std::vector<SensorFrame>& frames, const Structure& structure,
              Segmenter& segmenter, const CalibrateOptions& options)
      : frames_(frames),
        structure_(structure),
        segmenter_(segmenter),
        options_(options),
        aliases_(FindAliases(structure)),
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
    CheckDepths();
    watch.Lap("rays");
    Segment(&watch);
    InspectStack(&watch);
    ParallelFor(frames_.size(), options_.threads, [&](std::size_t i) { Place(i); });
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (result_.sensors[i].code == SensorCode::kDegenerateSides)
        result_.sensors[i].hint = MoveHint(i);
    }
    watch.Lap("placement");
    RefineTogether();
    watch.Lap("refinement");
    Measure();
    FindTwins();
    watch.Lap("metrics");
    watch.Total();
    for (std::size_t i = 0; i < frames_.size(); ++i)
      result_.sensors[i].view = std::move(work_[i].view);
    return std::move(result_);
  }

 private:
  double ValidShare(std::size_t i) const {
    const DepthImage& depth = work_[i].view.depth;
    const auto valid = std::count_if(depth.begin(), depth.end(), [](float z) { return z > 0; });
    return depth.empty() ? 0 : static_cast<double>(valid) / static_cast<double>(depth.size());
  }

  /// Rejects sensors whose depths cannot be a view of a structure: none, of another unit, or those
  /// of another sensor.
  void CheckDepths() {
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      const DepthImage& depth = work_[i].view.depth;
      const double valid = ValidShare(i);
      if (valid < options_.verdict.min_valid_share) {
        Fail(i, SensorCode::kNoDepth, fmt::format("{:.1f} % of the pixels have depth", 100 * valid),
             "check the depth file and the sensor's lens cap");
      } else if (const std::optional<std::string> problem = UnitProblem(depth)) {
        Fail(i, SensorCode::kWrongUnits, *problem, "correct depth_scale in the capture");
      } else {
        for (std::size_t j = 0; j < i; ++j) {
          if (work_[j].rejected || !(work_[j].view.depth == depth)) continue;
          work_[i].same_depth_as = frames_[j].name;
          work_[j].same_depth_as = frames_[i].name;
          Fail(i, SensorCode::kDuplicateDepth,
               fmt::format("its depth map is that of {}, pixel for pixel", frames_[j].name),
               "check the sensors' depth files: one of them is given twice");
          break;
        }
      }
      work_[i].rejected = result_.sensors[i].code != SensorCode::kNone;
      if (work_[i].rejected) {
        result_.sensors[i].segmentation = {LabelImage(depth.width(), depth.height()),
                                           Image<float>(depth.width(), depth.height())};
      }
    }
  }

  /// A sentence for depths that no room gives: most of them beyond 10 m, or nearly all nearer than
  /// 0.9 m, where no sensor sees a structure.
  static std::optional<std::string> UnitProblem(const DepthImage& depth) {
    std::vector<float> values;
    for (const float z : depth) {
      if (z > 0) values.push_back(z);
    }
    const auto quantile = [&](double q) {
      const auto at = static_cast<std::size_t>(q * static_cast<double>(values.size() - 1));
      std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at),
                       values.end());
      return static_cast<double>(values[at]);
    };
    constexpr double kFarthest = 10, kNearest = 0.9;
    const double median = quantile(0.5), high = quantile(0.95);
    if (median <= kFarthest && high >= kNearest) return std::nullopt;
    std::string text = fmt::format("half of its depths are {} {:.3g} m",
                                   median > kFarthest ? "beyond" : "under", median);
    const std::vector<double> factors =
        median > kFarthest ? std::vector<double>{0.1, 0.001} : std::vector<double>{10.0, 1000.0};
    for (const double factor : factors) {
      if (median * factor < 0.5 || median * factor > 8) continue;
      return text + fmt::format("; its depth_scale seems to be {} times too {}",
                                factor < 1 ? std::lround(1 / factor) : std::lround(factor),
                                factor < 1 ? "large" : "small");
    }
    return text + ", where no structure can be";
  }

  /// One sensor's frame as the network sees it after `turns`, and the pose that follows.
  struct Trial {
    std::size_t sensor = 0;
    int turns = 0;
    SegmentationResult segmentation;
    InitialPose initial;
    double floor_margin = 0;  // FloorMargin at the pose
    double score() const { return initial.found ? initial.agreement.score() : 0; }
    /// Beyond doubt: the labels fit the structure, and it stands on a floor. Upside down, or a box
    /// further, it would not.
    bool decided() const {
      constexpr double kDecided = 0.6;
      return initial.found && floor_margin >= kClearFloorMargin && score() >= kDecided;
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
        trial.floor_margin =
            FloorMargin(view, structure_, aliases_, trial.initial.structure_from_sensor);
      }
    });
    watch->Lap("initial_pose");
  }

  /// Labels and initial pose of every sensor. `auto` takes the network's own orientation where that
  /// decides, then, sensors of a rig being mounted alike, the turn of the first sensor that it did
  /// not, and tries all four only where neither does.
  void Segment(Stopwatch* watch) {
    std::vector<Trial> trials;
    const auto add = [&](std::size_t i, int turns) {
      Trial trial;
      trial.sensor = i;
      trial.turns = turns;
      trials.push_back(std::move(trial));
    };
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (!work_[i].rejected)
        add(i, frames_[i].quarter_turns == kAutoTurns ? 0 : frames_[i].quarter_turns);
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
    watch->Lap("initial_pose");
  }

  /// Agreement::score from which on labels are as good as they get.
  static constexpr double kGoodLabels = 0.85;

  /// Takes each sensor's best pose over all turns and aliases, with the labels that suit it. The
  /// paper's estimator gets the turn that fits and stands on the floor best, and nothing else.
  void TakeBest(std::vector<Trial>* trials) {
    ParallelFor(frames_.size(), options_.threads, [&](std::size_t i) {
      std::vector<Trial*> own;
      std::vector<PoseTrial> poses;
      for (Trial& trial : *trials) {
        if (trial.sensor != i) continue;
        own.push_back(&trial);
        poses.push_back({&trial.segmentation, &trial.initial});
      }
      if (own.empty()) return;
      const SensorView& view = work_[i].view;
      const InitialPoseOptions& options = options_.initial;
      PoseChoice choice;
      const auto settled = [](const Trial* t) { return t->decided() && t->score() >= kGoodLabels; };
      if (options.method == PoseMethod::kRobust &&
          std::count_if(own.begin(), own.end(), settled) != 1) {
        choice = ChoosePose(view, structure_, aliases_, poses,
                            frames_[i].quarter_turns != kAutoTurns, options);
      }
      double best_score = 0;
      for (const Trial* t : own) best_score = std::max(best_score, t->score());
      const auto rank = [&](const Trial* t) {
        constexpr double kRival = 0.5;
        const bool rival = t->score() >= kRival * best_score;
        return std::make_tuple(settled(t), rival, t->floor_margin, t->score());
      };
      const auto best =
          std::max_element(own.begin(), own.end(),
                           [&](const Trial* a, const Trial* b) { return rank(a) < rank(b); });
      // What is no structure can be made to look like one by taking its sides for others.
      constexpr double kGoodShape = 0.9, kSomeLabels = 0.4;
      const bool trusted = choice.found && choice.best.overlap >= kGoodShape &&
                           choice.best.label_score >= kSomeLabels;
      Trial& trial = trusted ? *own[choice.best.trial] : **best;
      SensorResult& sensor = result_.sensors[i];
      sensor.quarter_turns = trial.turns;
      sensor.segmentation = trial.segmentation;
      work_[i].initial = std::move(trial.initial);
      if (choice.ambiguous) {
        work_[i].other_pose =
            DescribeMotion(choice.best.structure_from_sensor, choice.rival.structure_from_sensor);
      }
      if (!trusted) return;
      if (choice.best.alias >= 0) {
        const StructureAlias& alias = aliases_[static_cast<std::size_t>(choice.best.alias)];
        if (!alias.keeps_up()) sensor.quarter_turns = (trial.turns + 2) % 4;
        sensor.segmentation = Relabelled(std::move(sensor.segmentation), alias);
      }
      const Pose& pose = choice.best.structure_from_sensor;
      if (choice.best.label_score < kGoodLabels) {
        std::vector<const SegmentationResult*> others;
        for (const Trial* other : own) {
          if (other != &trial) others.push_back(&other->segmentation);
        }
        ReconcileLabels(view, structure_, aliases_, pose, others, options.evidence.min_confidence,
                        &sensor.segmentation);
      }
      work_[i].initial = EstimateInitialPose(view, sensor.segmentation, structure_, options, &pose);
    });
  }

  /// Is the stack built as described? Asked of the sensors that are sure of several sides.
  void InspectStack(Stopwatch* watch) {
    if (!options_.assembly.enabled) return;
    std::vector<AssemblySensor> sensors;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (SeesSides(i))
        sensors.push_back({&work_[i].view, &result_.sensors[i].segmentation, &work_[i].initial});
    }
    if (sensors.empty()) return;
    result_.assembly =
        InspectAssembly(sensors, structure_, options_.initial, options_.assembly, options_.threads);
    watch->Lap("assembly");
  }

  void Fail(std::size_t i, SensorCode code, std::string reason, std::string hint) {
    SensorResult& sensor = result_.sensors[i];
    sensor.status = SensorStatus::kFailed;
    sensor.code = code;
    sensor.reason = std::move(reason);
    sensor.hint = std::move(hint);
  }

  /// What a refinement has to beat on held-out points is the pose from keypoints. One that was
  /// fitted to the sensor's own points has absorbed its warp and the boxes' offsets, and would win
  /// that comparison against better poses.
  RefineSensor Refinable(std::size_t i) const {
    const auto& without = options_.refine.without_structure;
    return {work_[i].refine_view.get(), work_[i].initial.from_keypoints, work_[i].start,
            std::find(without.begin(), without.end(), frames_[i].name) == without.end()};
  }

  /// Refines a sensor alone and decides, by what its view then explains, whether it sees the
  /// structure.
  void Place(std::size_t i) {
    Work& work = work_[i];
    SensorResult& sensor = result_.sensors[i];
    if (work.rejected) return;
    if (result_.assembly && result_.assembly->altered() && SeesSides(i)) {
      const AssemblyReport& report = *result_.assembly;
      return Fail(
          i, report.arrangement.code,
          fmt::format("{}: that explains {:.0f} % of what the sensors see, the stack as described "
                      "{:.0f} %",
                      report.arrangement.sentence, 100 * report.overlap,
                      100 * report.described_overlap),
          "stack the boxes as the structure file says, or describe them as they stand "
          "(--structure)");
    }
    CheckIntrinsics(i);
    if (!work.initial.found) {
      // One or two sides on which the network is sure are a structure seen too narrowly; less is
      // none.
      double area = 0;
      for (const SideEvidence& patch : work.initial.evidence)
        area += patch.mean_confidence > 0.8 ? patch.area : 0;
      constexpr double kSideArea = 0.05;  // m^2: half of the smallest side
      if (area < kSideArea) {
        return Fail(i, SensorCode::kNoStructure, "no side of the structure was found", kLookHint);
      }
      return Fail(i, SensorCode::kDegenerateSides,
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
      refine.choose_estimates = false;
      const RefinedSensor refined = Refine(structure_, {alone}, refine).sensors.front();
      work.start = refined.structure_from_sensor;
      alone_sigma_m = std::sqrt(refined.covariance.diagonal().head<3>().maxCoeff());
    }
    const Agreement agreement =
        CompareWithView(work.view, sensor.segmentation, structure_, work.start,
                        options_.initial.evidence.min_confidence, kInlierDistance);
    sensor.miou = agreement.miou;
    sensor.label_iou = agreement.score();
    sensor.explained_share = agreement.explained_share();
    const std::vector<int> labels = ConfirmedLabels(i, work.start);
    for (const int label : labels) sensor.sides.push_back(structure_.SideOfLabel(label).name);

    const VerdictOptions& limits = options_.verdict;
    const bool seen = agreement.explained_share() >= limits.min_explained_share &&
                      agreement.see_through_share() <= limits.max_see_through_share;
    const bool on_sides = agreement.on_side_share() >= limits.min_inlier_share;
    if (!seen || !on_sides) return FailVerification(i, agreement, seen);
    if (!SidesFixPose(structure_, labels, options_.initial.keypoints)) {
      return Fail(
          i, SensorCode::kDegenerateSides,
          fmt::format(
              "{} found; their keypoints lie on a line and their planes leave a direction free",
              Sides(labels.size())),
          kLookHint);
    }
    if (agreement.score() < limits.min_label_iou) return FailVerification(i, agreement, seen);
    if (!(alone_sigma_m <= limits.max_sigma_translation_m)) {
      return Fail(i, SensorCode::kDegenerateSides,
                  fmt::format("{} found, which leave the sensor's position open to {:.2f} m",
                              Sides(labels.size()), alone_sigma_m),
                  kLookHint);
    }
    constexpr double kFarOff = 0.08;  // of the focal length: the pose is decimetres off
    if (work.better_intrinsics && work.better_intrinsics->size >= kFarOff)
      return Fail(i, SensorCode::kIntrinsicsSuspect, IntrinsicsReason(i), kIntrinsicsHint);
    work.placed = true;
    *work.refine_view =
        RefineView(work.view, LabelsFromPose(work.view, structure_, work.start, kRelabelDistance),
                   structure_, view_options);
  }

  static constexpr char kLookHint[] =
      "turn the sensor so that it sees most of the structure, from 1.5 to 3.5 m";

  struct SureSides {
    std::size_t count = 0;
    double area = 0;
  };
  SureSides CountSureSides(std::size_t i) const {
    SureSides sure;
    for (const SideEvidence& patch : work_[i].initial.evidence) {
      if (patch.mean_confidence < 0.8) continue;
      sure.area += patch.area;
      ++sure.count;
    }
    return sure;
  }
  /// Enough of what looks like sides to ask why they do not fit. A structure seen from one corner
  /// shows over 1 m^2.
  bool SeesSides(std::size_t i) const {
    const SureSides sure = CountSureSides(i);
    return sure.count >= 4 && sure.area > 0.5;
  }

  /// Where labelled sides fit the structure badly: would they with other intrinsics?
  void CheckIntrinsics(std::size_t i) {
    constexpr double kGoodScore = 0.85;
    const InitialPose& initial = work_[i].initial;
    if (!SeesSides(i) || (initial.found && initial.agreement.score() >= kGoodScore)) return;
    work_[i].better_intrinsics =
        FindBetterIntrinsics(work_[i].view.depth, frames_[i].intrinsics,
                             result_.sensors[i].segmentation, structure_, options_.initial);
  }

  std::string IntrinsicsReason(std::size_t i) const {
    const BetterIntrinsics& better = *work_[i].better_intrinsics;
    return fmt::format(
        "its sides fit the structure {:.0f} % better with {} (labels and depth agree on {:.0f} % "
        "of the structure, {:.0f} % as given)",
        100 * (better.score / std::max(better.given_score, 0.01) - 1), better.change,
        100 * better.score, 100 * better.given_score);
  }
  static constexpr char kIntrinsicsHint[] =
      "give the intrinsics of this sensor at this resolution and orientation";

  /// Turns that put a sensor without a pose upright: the network's orientation is upright after as
  /// many turns for every sensor, and those with a pose tell how many.
  std::optional<int> UprightTurnsFrom(std::size_t i) const {
    std::array<int, 4> votes{};
    for (std::size_t j = 0; j < frames_.size(); ++j) {
      if (!work_[j].placed) continue;
      const int upright = UprightTurns(work_[j].start) - result_.sensors[j].quarter_turns;
      ++votes[static_cast<std::size_t>((upright + 4) % 4)];
    }
    const auto most = std::max_element(votes.begin(), votes.end());
    if (*most == 0) return std::nullopt;
    return static_cast<int>(most - votes.begin()) + result_.sensors[i].quarter_turns;
  }

  /// Where to move a sensor that sees too few sides: away from the border that cuts the structure
  /// off, or round the structure.
  std::string MoveHint(std::size_t i) const {
    const LabelImage& labels = result_.sensors[i].segmentation.labels;
    const int w = labels.width(), h = labels.height();
    constexpr int kBorder = 8;  // px: depth is often missing along the very border
    std::vector<int> cut;       // 0 left, 1 top, 2 right, 3 bottom of the stored image
    for (int border = 0; border < 4; ++border) {
      const bool upright = border % 2 == 0;
      const int length = upright ? h : w;
      int marked = 0;
      for (int k = 0; k < length; ++k) {
        bool any = false;
        for (int d = 0; d < kBorder && d < (upright ? w : h); ++d) {
          const int across = border < 2 ? d : (upright ? w : h) - 1 - d;
          any = any || (upright ? labels(across, k) : labels(k, across)) > 0;
        }
        marked += any ? 1 : 0;
      }
      if (10 * marked >= length) cut.push_back(border);
    }
    constexpr char kRound[] =
        "move the sensor round the structure to the left or right, or up, until it sees sides of "
        "more than one orientation";
    if (cut.empty()) return kRound;
    const std::optional<int> turns = UprightTurnsFrom(i);
    if (cut.size() > 1 || !turns) {
      return "the image border cuts the structure off: move the sensor further away, or turn it so "
             "that it sees most of the structure";
    }
    // Turning the picture clockwise sends its left border to the top.
    static constexpr const char* kNames[] = {"to the left", "up", "to the right", "down"};
    return fmt::format(
        "the image border cuts the structure off: turn the sensor {}, or move it further away",
        kNames[(cut.front() + *turns) % 4]);
  }

  static std::string Sides(std::size_t count) {
    return fmt::format("{} side{}", count, count == 1 ? " was" : "s were");
  }

  void FailVerification(std::size_t i, const Agreement& agreement, bool seen) {
    if (work_[i].better_intrinsics)
      return Fail(i, SensorCode::kIntrinsicsSuspect, IntrinsicsReason(i), kIntrinsicsHint);
    const std::string facts = fmt::format(
        "at the best pose {:.0f} % of the labelled pixels lie on their sides, {:.0f} % of the "
        "structure's view is "
        "measured on it and {:.0f} % of that is seen through",
        100 * agreement.on_side_share(), 100 * agreement.explained_share(),
        100 * agreement.see_through_share());
    if (SeesSides(i) && (seen || agreement.on_side_share() > 0.3)) {
      return Fail(
          i, SensorCode::kInconsistent,
          "the sides that were found do not fit the structure together: " + facts,
          "check that the boxes are stacked as the structure file says, and the intrinsics and "
          "depth_scale");
    }
    Fail(i, SensorCode::kNoStructure, "what looks like sides is not the structure: " + facts,
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
    RefineOptions refine = options_.refine;
    refine.coarse = std::any_of(sensors.begin(), sensors.end(),
                                [](const RefineSensor& s) { return !s.use_structure_terms; });
    const RefineResult refined = Refine(structure_, sensors, refine);
    result_.built = refined.built;
    result_.boxes = refined.boxes;
    result_.size_estimated = refined.size_estimated;
    result_.size_scale = refined.size_scale;
    result_.sigma_size_scale = refined.sigma_size_scale;
    for (std::size_t j = 0; j < index.size(); ++j) {
      SensorResult& sensor = result_.sensors[index[j]];
      sensor.initial = work_[index[j]].initial.structure_from_sensor;
      sensor.refinement_accepted = refined.sensors[j].accepted;
      sensor.structure_from_sensor =
          sensor.refinement_accepted ? refined.sensors[j].structure_from_sensor : sensor.initial;
      sensor.covariance = refined.sensors[j].covariance;
      sensor.depth_offset_m = refined.sensors[j].depth_offset;
      sensor.depth_gain = refined.sensors[j].depth_gain;
      sensor.sigma_depth_offset_m = refined.sensors[j].sigma_depth_offset;
      sensor.sigma_depth_gain = refined.sensors[j].sigma_depth_gain;
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
      const SensorView view = Corrected(work_[i].view, sensor.depth_gain, sensor.depth_offset_m);
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
      if (DistanceToSurface(result_.built, captured[j]).distance < kRmsDistance)
        near.push_back(captured[j]);
    }
    if (!near.empty())
      result_.metrics = CompareSets(near, SampleExposedSurface(result_.built, 0.005));
  }

  /// Residuals, errors and status of a placed sensor.
  void Judge(std::size_t i) {
    SensorResult& sensor = result_.sensors[i];
    const SensorView view = Corrected(work_[i].view, sensor.depth_gain, sensor.depth_offset_m);
    const Pose& pose = *sensor.structure_from_sensor;
    const SurfaceFit fit = FitToSurface(view, sensor.segmentation.labels, result_.built, pose);
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
    if (!work_[i].same_depth_as.empty()) {
      sensor.code = SensorCode::kDuplicateDepth;
      sensor.reason = fmt::format("{} has the same depth map", work_[i].same_depth_as);
      sensor.hint = "check which of the two it belongs to";
    } else if (work_[i].better_intrinsics) {
      sensor.code = SensorCode::kIntrinsicsSuspect;
      sensor.reason = IntrinsicsReason(i);
      sensor.hint = kIntrinsicsHint;
    } else if (!work_[i].other_pose.empty()) {
      sensor.code = SensorCode::kAmbiguous;
      sensor.reason = fmt::format(
          "its view fits the structure about as well {}, and shows no floor that would tell",
          work_[i].other_pose);
      sensor.hint = frames_[i].quarter_turns == kAutoTurns
                        ? "let it see the floor under the structure, or give its quarter_turns"
                        : "let it see the floor under the structure";
    } else if (sensor.inlier_share < limits.weak_inlier_share) {
      sensor.code = SensorCode::kFewInliers;
      sensor.reason =
          fmt::format("{:.0f} % of the labelled pixels lie within 3 cm of the structure",
                      100 * sensor.inlier_share);
      sensor.hint = "look at pictures/ for what else was labelled, and clear it away";
    } else if (sensor.rms_to_structure_m > limits.weak_rms_m) {
      sensor.code = SensorCode::kLargeResidual;
      sensor.reason = fmt::format("points are {:.1f} mm RMS off the structure",
                                  1000 * sensor.rms_to_structure_m);
      sensor.hint = "check the boxes' dimensions and placement, the intrinsics and the depth_scale";
    } else if (sensor.label_iou < limits.weak_label_iou) {
      sensor.code = SensorCode::kLabelsDisagree;
      sensor.reason =
          fmt::format("labels as predicted and as seen from the pose overlap by {:.0f} %",
                      100 * sensor.label_iou);
      sensor.hint =
          "look at pictures/: something may hide the structure, or the sensor be too near or far";
    } else if (!(sigma_m <= limits.weak_sigma_translation_m) ||
               !(sigma_deg <= limits.weak_sigma_rotation_deg)) {
      sensor.code = SensorCode::kUncertain;
      sensor.reason = fmt::format("the pose is known to {:.1f} mm and {:.2f} deg only",
                                  1000 * sigma_m, sigma_deg);
      sensor.hint = "let it see more sides, or more of what its neighbours see";
    } else {
      sensor.status = SensorStatus::kOk;
    }
  }

  /// Two sensors cannot stand in one place: it is one sensor under two names.
  void FindTwins() {
    constexpr double kPlace = 0.02, kDirectionDeg = 2;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      for (std::size_t j = 0; j < frames_.size(); ++j) {
        SensorResult& sensor = result_.sensors[i];
        if (i == j || !work_[i].placed || !work_[j].placed) continue;
        const PoseError gap =
            ComparePoses(*sensor.structure_from_sensor, *result_.sensors[j].structure_from_sensor);
        if (gap.translation_m > kPlace || gap.rotation_deg > kDirectionDeg) continue;
        sensor.status = SensorStatus::kWeak;
        sensor.code = SensorCode::kSamePose;
        sensor.reason = fmt::format("it stands where {} stands, to {:.1f} mm and {:.2f} deg",
                                    frames_[j].name, 1000 * gap.translation_m, gap.rotation_deg);
        sensor.hint = "check the sensors' depth files: one sensor seems to be given twice";
      }
    }
  }

  const std::vector<SensorFrame>& frames_;
  const Structure& structure_;
  Segmenter& segmenter_;
  const CalibrateOptions& options_;
  std::vector<StructureAlias> aliases_;
  std::vector<Work> work_;
  CalibrationResult result_;
};

}  // namespace

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
  ParseEstimate(options.refine.estimate);
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
