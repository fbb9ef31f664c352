#include "infer/evaluate/suite/run_suite.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "core/config.h"
#include "core/error.h"
#include "core/file_util.h"
#include "core/parallel_for.h"
#include "core/rig.h"
#include "core/structure_gltf.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/suite/markers.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/view/segmenter.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"
#include "render/rig.h"

namespace volalign {

namespace {

/// A capture to come.
struct SuiteItem {
  std::string dataset, set_up, capture;
  std::optional<Rig> rig;  ///< to render, else
  EvaluationItem recording;
  std::string identity;
  bool infrared = false;  ///< a method wants markers
};

std::string Stem(const std::string& path) { return std::filesystem::path(path).stem().string(); }

/// `most` items of a list, evenly taken; all where it is 0.
template <class T>
std::vector<T> Some(std::vector<T> items, int most) {
  const auto wanted = static_cast<std::size_t>(most);
  if (most <= 0 || items.size() <= wanted) return items;
  std::vector<T> some;
  for (std::size_t k = 0; k < wanted; ++k)
    some.push_back(std::move(items[k * items.size() / wanted]));
  return some;
}

std::vector<SuiteItem> ItemsOf(const SuiteDataset& dataset, const Structure& structure,
                               bool infrared) {
  std::vector<SuiteItem> items;
  for (const std::string& file : dataset.rigs) {
    const std::vector<Rig> turns = Turns(ReadRig(ConfigSource::FromFile(file)));
    for (std::size_t k = 0; k < turns.size(); ++k) {
      SuiteItem item;
      item.dataset = dataset.name;
      item.set_up = Stem(file);
      item.capture = fmt::format("{}_turn_{}", item.set_up, k + 1);
      item.rig = turns[k];
      item.identity = RigItem(item.set_up, turns[k], "", nullptr).identity;
      item.infrared = infrared;
      items.push_back(std::move(item));
    }
  }
  for (std::size_t k = 0; k < dataset.captures.size(); ++k) {
    SuiteItem item;
    item.dataset = dataset.name;
    item.set_up = "recordings";
    item.capture = fmt::format("recording_{}", k + 1);
    item.recording = CaptureItem(dataset.captures[k], structure);
    item.identity = item.recording.identity;
    items.push_back(std::move(item));
  }
  return items;
}

SuiteStill LoadStill(const SuiteItem& item, const SuiteConfig& suite, DepthRenderer* renderer) {
  SuiteStill still;
  if (item.rig) {
    std::optional<InfraredRequest> infrared;
    if (item.infrared) {
      infrared.emplace(
          InfraredRequest{StructureMarkers(ReadStructure(item.rig->structure)), suite.infrared});
    }
    const std::vector<RigCapture> captures =
        RenderPlacements(*item.rig, *renderer, infrared ? &*infrared : nullptr);
    still.still = StillOf(captures);
    for (const CapturedSensor& sensor : captures.front().sensors) {
      if (!infrared) break;
      still.infrared.push_back(sensor.infrared);
      still.infrared_intrinsics.push_back(sensor.infrared_intrinsics);
    }
  } else {
    still.still = item.recording.load();
  }
  still.views = MakeSensorViews(still.still.frames, 1);
  return still;
}

/// Methods with their networks, and what else the results depend on.
class Methods {
 public:
  Methods(const SuiteConfig& suite, const SuiteRun& run) : suite_(suite), program_(run.program) {
    for (const SuiteMethod& method : suite.methods) {
      if (!HasModel(method)) continue;
      methods_.push_back({method, nullptr, ""});
      if (!method.model.empty()) {
        methods_.back().sha256 = Sha256(ReadFile(method.model));
        std::shared_ptr<Shared>& shared = networks_[methods_.back().sha256];
        if (!shared) shared = std::make_shared<Shared>();
        methods_.back().shared = shared;
      }
    }
  }

  std::size_t size() const { return methods_.size(); }
  const SuiteMethod& at(std::size_t i) const { return methods_[i].method; }

  /// Whether a method can run on a capture: recordings have no markers.
  bool Applies(std::size_t i, const SuiteItem& item) const {
    return methods_[i].method.kind != MethodKind::kMarkers || item.rig.has_value();
  }

  std::string Fingerprint(std::size_t i, const SuiteItem& item) const {
    const Entry& entry = methods_[i];
    std::string all;
    for (const std::string& part :
         {program_, item.identity, entry.sha256, WriteConfig(entry.method),
          std::to_string(suite_.min_side_pixels), WriteConfig(suite_.graph),
          entry.method.kind == MethodKind::kMarkers ? WriteConfig(suite_.infrared)
                                                    : std::string()}) {
      all += fmt::format("{}:{}\n", part.size(), part);
    }
    return Sha256(all);
  }

  CaptureScores Run(std::size_t i, const SuiteStill& still, int threads) {
    const auto start = std::chrono::steady_clock::now();
    const MethodResult result = RunMethod(methods_[i].method, still, Network(i), suite_, threads);
    CaptureScores scores = ScoreCapture(still, result, suite_.min_side_pixels);
    scores.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return scores;
  }

 private:
  /// A network is loaded when it is needed first; its forward pass changes nothing in it.
  struct Shared {
    std::mutex mutex;
    std::unique_ptr<NetworkSegmenter> segmenter;
  };
  struct Entry {
    SuiteMethod method;
    std::shared_ptr<Shared> shared;
    std::string sha256;
  };

  Segmenter* Network(std::size_t i) {
    const Entry& entry = methods_[i];
    if (!entry.shared) return nullptr;
    const std::lock_guard<std::mutex> lock(entry.shared->mutex);
    if (!entry.shared->segmenter)
      entry.shared->segmenter = LoadNetworkSegmenter(entry.method.model);
    return entry.shared->segmenter.get();
  }

  const SuiteConfig& suite_;
  std::string program_;
  std::vector<Entry> methods_;
  std::map<std::string, std::shared_ptr<Shared>> networks_;
};

std::filesystem::path FileOf(const SuiteRun& run, const SuiteItem& item,
                             const SuiteMethod& method) {
  return run.output / "captures" / item.dataset /
         fmt::format("{}.{}.json", item.capture, method.name);
}

std::optional<CaptureScores> Known(const std::filesystem::path& file,
                                   const std::string& fingerprint) {
  if (!std::filesystem::exists(file)) return std::nullopt;
  CaptureScores scores = ReadScores(file);
  if (scores.fingerprint != fingerprint) return std::nullopt;
  return scores;
}

/// "[3/24] arc_165_90_turn_3: m05 8/8, markers 7/8; about 300 s left"
class Progress {
 public:
  Progress(const SuiteRun& run, std::size_t total) : run_(run), total_(total) {}

  void Done(const SuiteItem& item, const std::vector<CaptureScores>& fresh) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++done_;
    if (!fresh.empty()) ++made_;
    if (!run_.progress) return;
    std::string placed;
    for (const CaptureScores& scores : fresh) {
      const auto count =
          std::count_if(scores.views.begin(), scores.views.end(),
                        [](const ViewScores& view) { return view.stages.front().placed; });
      placed += fmt::format(" {} {}/{}", scores.method, count, scores.views.size());
    }
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
    run_.progress(fmt::format("[{}/{}] {}:{}", done_, total_, item.capture,
                              fresh.empty()
                                  ? " done before"
                                  : fmt::format("{}; about {:.0f} s left", placed,
                                                elapsed.count() / static_cast<double>(made_) *
                                                    static_cast<double>(total_ - done_))));
  }

 private:
  const SuiteRun& run_;
  std::size_t total_, done_ = 0, made_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::mutex mutex_;
};

/// A thread's GL, made when it is needed first; destroyed on the thread that made it.
class WorkerGl {
 public:
  explicit WorkerGl(int device) { options_.device = device; }
  DepthRenderer* renderer() {
    if (!egl_) {
      egl_.emplace(options_);
      renderer_.emplace();
    }
    return &*renderer_;
  }

 private:
  EglContextOptions options_;
  std::optional<EglContext> egl_;
  std::optional<DepthRenderer> renderer_;
};

/// What every method says about a capture, computed where it is not known.
std::vector<CaptureScores> RunItem(const SuiteItem& item, const SuiteConfig& suite,
                                   const SuiteRun& run, Methods& methods, WorkerGl& gl,
                                   std::vector<CaptureScores>* fresh) {
  std::vector<CaptureScores> all;
  std::optional<SuiteStill> still;
  for (std::size_t i = 0; i < methods.size(); ++i) {
    if (!methods.Applies(i, item)) continue;
    const std::filesystem::path file = FileOf(run, item, methods.at(i));
    const std::string fingerprint = methods.Fingerprint(i, item);
    if (std::optional<CaptureScores> known = Known(file, fingerprint)) {
      all.push_back(std::move(*known));
      continue;
    }
    if (!still) still = LoadStill(item, suite, item.rig ? gl.renderer() : nullptr);
    CaptureScores scores = methods.Run(i, *still, run.workers > 1 ? 1 : 2);
    scores.fingerprint = fingerprint;
    scores.dataset = item.dataset;
    scores.set_up = item.set_up;
    scores.capture = item.capture;
    scores.method = methods.at(i).name;
    WriteScores(file, scores);
    fresh->push_back(scores);
    all.push_back(std::move(scores));
  }
  return all;
}

}  // namespace

bool HasModel(const SuiteMethod& method) {
  return method.kind == MethodKind::kMarkers || std::filesystem::exists(method.model);
}

std::vector<CaptureScores> RunSuite(const SuiteConfig& suite, const SuiteRun& run) {
  Methods methods(suite, run);
  bool infrared = false;
  for (std::size_t i = 0; i < methods.size(); ++i)
    infrared = infrared || methods.at(i).kind == MethodKind::kMarkers;
  const Structure structure = ReadStructure(Rig().structure);
  std::vector<SuiteItem> items;
  for (const SuiteDataset& dataset : suite.datasets) {
    for (SuiteItem& item : Some(ItemsOf(dataset, structure, infrared), run.max_captures))
      items.push_back(std::move(item));
  }
  Progress progress(run, items.size());
  std::vector<std::vector<CaptureScores>> results(items.size());
  std::atomic<std::size_t> next{0};
  const auto workers = static_cast<std::size_t>(std::max(run.workers, 1));
  ParallelFor(workers, static_cast<int>(workers), [&](std::size_t) {
    WorkerGl gl(run.device);
    for (std::size_t i = next++; i < items.size(); i = next++) {
      std::vector<CaptureScores> fresh;
      results[i] = RunItem(items[i], suite, run, methods, gl, &fresh);
      progress.Done(items[i], fresh);
    }
  });
  std::vector<CaptureScores> all;
  for (std::vector<CaptureScores>& of_item : results)
    std::move(of_item.begin(), of_item.end(), std::back_inserter(all));
  return all;
}

}  // namespace volalign
