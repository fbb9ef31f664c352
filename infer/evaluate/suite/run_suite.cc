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
#include <utility>

#include "core/base/file_util.h"
#include "core/base/lists.h"
#include "core/base/parallel_for.h"
#include "core/config/config.h"
#include "infer/evaluate/suite/markers.h"
#include "infer/evaluate/suite/table_data.h"
#include "infer/segment/load.h"
#include "infer/view/sensor_view.h"
#include "render/rig.h"

namespace volalign {

namespace {

std::string Stem(const std::string& path) { return std::filesystem::path(path).stem().string(); }

/// Renders or reads a capture. A thread's renderer is made at its first use.
SuiteCapture LoadSuiteCapture(const SuiteItem& item, bool infrared, const SuiteRun& run,
                              std::unique_ptr<DepthRenderer>* renderer) {
  SuiteCapture capture;
  if (item.rig) {
    std::vector<MarkerPrint> prints;
    if (infrared) prints = StructureMarkers(ReadStructure(item.rig->structure));
    if (!*renderer) *renderer = run.make_renderer();
    const std::vector<RigCapture> captures =
        RenderPlacements(*item.rig, **renderer, infrared ? &prints : nullptr);
    capture.evaluation = EvaluationCaptureOf(captures);
    for (const CapturedSensor& sensor : captures.front().sensors) {
      if (!infrared) break;
      capture.infrared.push_back(sensor.infrared);
      capture.infrared_intrinsics.push_back(sensor.infrared_intrinsics);
    }
  } else {
    capture.evaluation = item.recording.load();
  }
  for (const SensorFrame& frame : capture.evaluation.frames)
    capture.views.push_back(MakeSensorView(frame, frame.intrinsics));
  return capture;
}

/// A method that can run. A network's forward pass changes nothing in it, so that threads share it.
struct LoadedMethod {
  SuiteMethod method;
  std::shared_ptr<Segmenter> network;  ///< null without a model
};

std::vector<LoadedMethod> LoadMethods(const SuiteConfig& suite) {
  std::map<std::string, std::shared_ptr<Segmenter>> networks;  // by file
  std::vector<LoadedMethod> methods;
  for (const SuiteMethod& method : suite.methods) {
    if (!HasModel(method)) continue;
    std::shared_ptr<Segmenter>& network = networks[method.model];
    if (!network && !method.model.empty()) network = LoadNetworkSegmenter(method.model);
    methods.push_back({method, network});
  }
  return methods;
}

/// Every method's scores of a capture.
std::vector<CaptureScores> RunItem(const SuiteItem& item, const SuiteCapture& capture,
                                   const std::vector<LoadedMethod>& methods,
                                   const SuiteConfig& suite, const SuiteRun& run) {
  using Clock = std::chrono::steady_clock;
  std::vector<CaptureScores> all;
  for (const auto& [method, network] : methods) {
    if (!Applies(method, item)) continue;
    const auto start = Clock::now();
    const MethodResult result = RunMethod(method, capture, network.get(), run.workers > 1 ? 1 : 2);
    CaptureScores scores = ScoreCapture(capture, result, suite.min_side_pixels);
    scores.seconds = std::chrono::duration<double>(Clock::now() - start).count();
    scores.dataset = item.dataset;
    scores.set_up = item.set_up;
    scores.capture = item.capture;
    scores.method = method.name;
    WriteScores(run.output / "captures" / item.dataset /
                    fmt::format("{}.{}.json", item.capture, method.name),
                scores);
    all.push_back(std::move(scores));
  }
  return all;
}

/// "arc_165_90_turn_3: m05 8/8 markers 7/8"
std::string Placed(const SuiteItem& item, const std::vector<CaptureScores>& all) {
  std::string text = item.capture + ":";
  for (const CaptureScores& scores : all) {
    const auto count =
        std::count_if(scores.views.begin(), scores.views.end(),
                      [](const ViewScores& view) { return view.stages.front().placed; });
    text += fmt::format(" {} {}/{}", scores.method, count, scores.views.size());
  }
  return text;
}

}  // namespace

std::vector<SuiteItem> SuiteItems(const SuiteDataset& dataset, const Structure& structure,
                                  int most) {
  std::vector<SuiteItem> items;
  for (const std::string& file : dataset.rigs) {
    const std::vector<Rig> turns = Turns(ReadRig(ConfigSource::FromFile(file)));
    for (std::size_t k = 0; k < turns.size(); ++k) {
      items.push_back(
          {dataset.name, Stem(file), fmt::format("{}_turn_{}", Stem(file), k + 1), turns[k], {}});
    }
  }
  for (std::size_t k = 0; k < dataset.captures.size(); ++k) {
    items.push_back({dataset.name, "recordings", fmt::format("recording_{}", k + 1), std::nullopt,
                     CaptureItem(dataset.captures[k], structure)});
  }
  return most <= 0 ? items : EvenSubset(items, static_cast<std::size_t>(most));
}

bool Applies(const SuiteMethod& method, const SuiteItem& item) {
  return IsApplicable(method, item.dataset) &&
         (method.kind != MethodKind::kMarkers || item.rig.has_value());
}

std::vector<CaptureScores> RunSuite(const SuiteConfig& suite, const SuiteRun& run) {
  const std::vector<LoadedMethod> methods = LoadMethods(suite);
  const bool infrared = std::any_of(methods.begin(), methods.end(), [](const LoadedMethod& one) {
    return one.method.kind == MethodKind::kMarkers;
  });
  const Structure structure = ReadStructure(Rig().structure);
  std::vector<SuiteItem> items;
  for (const SuiteDataset& dataset : suite.datasets) {
    for (SuiteItem& item : SuiteItems(dataset, structure, run.max_captures))
      items.push_back(std::move(item));
  }
  const auto total = static_cast<std::int64_t>(items.size());
  std::mutex mutex;
  std::int64_t done = 0;
  if (run.count) run.count(0, total);
  std::vector<std::vector<CaptureScores>> results(items.size());
  std::atomic<std::size_t> next{0};
  const auto workers = static_cast<std::size_t>(std::max(run.workers, 1));
  ParallelFor(workers, static_cast<int>(workers), [&](std::size_t) {
    std::unique_ptr<DepthRenderer> renderer;  // destroyed on the thread that made it
    for (std::size_t i = next++; i < items.size(); i = next++) {
      const SuiteCapture capture = LoadSuiteCapture(items[i], infrared, run, &renderer);
      results[i] = RunItem(items[i], capture, methods, suite, run);
      const std::lock_guard<std::mutex> lock(mutex);
      if (run.count) run.count(++done, total);
      if (run.progress) run.progress(Placed(items[i], results[i]));
    }
  });
  std::vector<CaptureScores> all;
  for (std::vector<CaptureScores>& of_item : results)
    std::move(of_item.begin(), of_item.end(), std::back_inserter(all));
  return all;
}

std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores) {
  std::string all;
  for (const SuiteTable& table : suite.tables) {
    const TableData data = MakeTable(suite, table, scores);
    WriteFileAtomically(folder / (table.name + ".csv"), FormatTableCsv(data));
    WriteFileAtomically(folder / (table.name + ".json"), FormatTableJson(data));
    all += (all.empty() ? "" : "\n") + FormatMarkdown(data);
  }
  WriteFileAtomically(folder / "suite.md", all);
  WriteFileAtomically(folder / "suite.json", FormatScores(scores));
  return all;
}

}  // namespace volalign
