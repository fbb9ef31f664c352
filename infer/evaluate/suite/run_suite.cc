#include "infer/evaluate/suite/run_suite.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <iterator>
#include <mutex>
#include <optional>
#include <utility>

#include "core/base/file_util.h"
#include "core/base/parallel_for.h"
#include "core/geometry/rig.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/suite/method_set.h"
#include "infer/evaluate/suite/suite_items.h"
#include "infer/evaluate/suite/table_data.h"

namespace volalign {

namespace {

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

/// "[3/24] arc_165_90_turn_3: m05 8/8, markers 7/8"
class Progress {
 public:
  Progress(const SuiteRun& run, std::size_t total) : run_(run), total_(total) {
    if (run_.count) run_.count(0, static_cast<std::int64_t>(total_));
  }

  void Done(const SuiteItem& item, const std::vector<CaptureScores>& fresh) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++done_;
    if (run_.count) run_.count(static_cast<std::int64_t>(done_), static_cast<std::int64_t>(total_));
    if (!run_.progress) return;
    std::string placed;
    for (const CaptureScores& scores : fresh) {
      const auto count =
          std::count_if(scores.views.begin(), scores.views.end(),
                        [](const ViewScores& view) { return view.stages.front().placed; });
      placed += fmt::format(" {} {}/{}", scores.method, count, scores.views.size());
    }
    run_.progress(fmt::format("[{}/{}] {}:{}", done_, total_, item.capture,
                              fresh.empty() ? " done before" : placed));
  }

 private:
  const SuiteRun& run_;
  std::size_t total_, done_ = 0;
  std::mutex mutex_;
};

CaptureScores Score(std::size_t method, const SuiteCapture& capture, const SuiteConfig& suite,
                    const SuiteRun& run, MethodSet& methods) {
  const auto start = std::chrono::steady_clock::now();
  const MethodResult result = methods.Run(method, capture, run.workers > 1 ? 1 : 2);
  CaptureScores scores = ScoreCapture(capture, result, suite.min_side_pixels);
  scores.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return scores;
}

/// Every method's scores of a capture, computed if they are not known.
std::vector<CaptureScores> RunItem(const SuiteItem& item, const SuiteConfig& suite,
                                   const SuiteRun& run, MethodSet& methods,
                                   WorkerRenderer& renderer, std::vector<CaptureScores>* fresh) {
  std::vector<CaptureScores> all;
  std::optional<SuiteCapture> capture;
  for (std::size_t i = 0; i < methods.size(); ++i) {
    if (!methods.Applies(i, item)) continue;
    const std::filesystem::path file = FileOf(run, item, methods.at(i));
    const std::string fingerprint = methods.Fingerprint(i, item);
    if (std::optional<CaptureScores> known = Known(file, fingerprint)) {
      all.push_back(std::move(*known));
      continue;
    }
    if (!capture) capture = LoadSuiteCapture(item, renderer);
    CaptureScores scores = Score(i, *capture, suite, run, methods);
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

std::vector<CaptureScores> RunSuite(const SuiteConfig& suite, const SuiteRun& run) {
  MethodSet methods(suite, run.program);
  const Structure structure = ReadStructure(Rig().structure);
  std::vector<SuiteItem> items;
  for (const SuiteDataset& dataset : suite.datasets) {
    for (SuiteItem& item : SuiteItems(dataset, structure, methods.HasMarkers(), run.max_captures))
      items.push_back(std::move(item));
  }
  Progress progress(run, items.size());
  std::vector<std::vector<CaptureScores>> results(items.size());
  std::atomic<std::size_t> next{0};
  const auto workers = static_cast<std::size_t>(std::max(run.workers, 1));
  ParallelFor(workers, static_cast<int>(workers), [&](std::size_t) {
    WorkerRenderer renderer(run.make_renderer);
    for (std::size_t i = next++; i < items.size(); i = next++) {
      std::vector<CaptureScores> fresh;
      results[i] = RunItem(items[i], suite, run, methods, renderer, &fresh);
      progress.Done(items[i], fresh);
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
    const std::string markdown = FormatMarkdown(data);
    WriteFileAtomically(folder / (table.name + ".md"), markdown);
    WriteFileAtomically(folder / (table.name + ".csv"), FormatCsv(data));
    WriteFileAtomically(folder / (table.name + ".json"), FormatTableJson(data));
    all += (all.empty() ? "" : "\n") + markdown;
  }
  WriteFileAtomically(folder / "suite.md", all);
  WriteFileAtomically(folder / "suite.json", FormatScores(scores));
  return all;
}

}  // namespace volalign
