#include "infer/evaluate/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <utility>

#include "core/config.h"
#include "core/error.h"
#include "core/file_util.h"
#include "infer/evaluate/storage.h"

namespace volalign {

namespace {

std::string Fingerprint(const EvaluationItem& item, const EvaluationVariant& variant,
                        const EvaluateRun& run) {
  std::string all;
  for (const std::string& part : {run.program, run.model_sha256, item.rig, item.sensors,
                                  item.identity, variant.name, WriteConfig(variant.options)}) {
    all += fmt::format("{}:{}\n", part.size(), part);
  }
  return Sha256(all);
}

/// Results by their fingerprints, and which of them this run is to have.
class Results {
 public:
  Results(const std::vector<EvaluationItem>& items, const std::vector<EvaluationVariant>& variants,
          const EvaluateRun& run) {
    if (std::filesystem::exists(run.output)) {
      for (EvaluatedCase& one : ReadEvaluation(run.output)) {
        const std::string fingerprint = one.fingerprint;
        known_[fingerprint] = std::move(one);
      }
    }
    for (const EvaluationItem& item : items) {
      wanted_.emplace_back();
      for (const EvaluationVariant& variant : variants) {
        wanted_.back().push_back(Fingerprint(item, variant, run));
      }
    }
  }

  /// Indices of the variants under which an item has no result yet.
  std::vector<std::size_t> Missing(std::size_t item) const {
    std::vector<std::size_t> missing;
    for (std::size_t j = 0; j < wanted_[item].size(); ++j) {
      if (!known_.count(wanted_[item][j])) missing.push_back(j);
    }
    return missing;
  }
  void Add(std::size_t item, std::size_t variant, EvaluatedCase one) {
    one.fingerprint = wanted_[item][variant];
    known_[one.fingerprint] = std::move(one);
  }
  /// Of one item, as far as they are there, in order of the variants.
  std::vector<EvaluatedCase> Of(std::size_t item) const {
    std::vector<EvaluatedCase> cases;
    for (const std::string& fingerprint : wanted_[item]) {
      const auto found = known_.find(fingerprint);
      if (found != known_.end()) cases.push_back(found->second);
    }
    return cases;
  }
  /// Of all items.
  std::vector<EvaluatedCase> All() const {
    std::vector<EvaluatedCase> cases;
    for (std::size_t item = 0; item < wanted_.size(); ++item) {
      for (EvaluatedCase& one : Of(item)) cases.push_back(std::move(one));
    }
    return cases;
  }

 private:
  std::map<std::string, EvaluatedCase> known_;
  std::vector<std::vector<std::string>> wanted_;  // by item and variant
};

/// The still of an item. Throws DataError unless it has the sides that the network knows.
EvaluationStill LoadStill(const EvaluationItem& item, const Structure& structure) {
  EvaluationStill still = item.load();
  if (still.structure.SideNames() != structure.SideNames()) {
    throw DataError(fmt::format(
        "{}: the structure \"{}\" has other sides than \"{}\", which the network knows; train "
        "a network for it",
        item.rig, still.structure.name(), structure.name()));
  }
  return still;
}

/// "ring8 kinect seed 3: placed by robust 8/8, paper 7/8"
std::string Placed(const EvaluationItem& item, const std::vector<EvaluatedCase>& cases) {
  std::string placed;
  for (const EvaluatedCase& one : cases) {
    placed +=
        fmt::format("{}{} {}/{}", placed.empty() ? "" : ", ", one.variant,
                    std::count_if(one.results.begin(), one.results.end(),
                                  [](const EvaluatedSensor& sensor) { return sensor.placed(); }),
                    one.results.size());
  }
  return fmt::format("{}{}{}{}{}: placed by {}", item.rig, item.sensors.empty() ? "" : " ",
                     item.sensors, item.seed ? fmt::format(" seed {}", *item.seed) : "",
                     item.placements > 1 ? fmt::format(" with {} placements", item.placements) : "",
                     placed);
}

}  // namespace

std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    Segmenter& segmenter, const Structure& structure,
                                    const EvaluateRun& run) {
  Results results(items, variants, run);
  const auto write = [&] {
    WriteEvaluation(run.output, results.All(), run.model_file, run.model_sha256);
  };
  std::size_t made = 0;
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < items.size(); ++i) {
    const EvaluationItem& item = items[i];
    const std::vector<std::size_t> missing = results.Missing(i);
    if (!missing.empty()) {
      std::vector<EvaluationVariant> asked;
      asked.reserve(missing.size());
      for (const std::size_t j : missing) asked.push_back(variants[j]);
      std::vector<EvaluatedCase> fresh =
          EvaluateStill(LoadStill(item, structure), asked, segmenter);
      for (std::size_t k = 0; k < fresh.size(); ++k) {
        fresh[k].rig = item.rig;
        fresh[k].sensors = item.sensors;
        fresh[k].seed = item.seed;
        fresh[k].placements = item.placements;
        results.Add(i, missing[k], std::move(fresh[k]));
      }
      ++made;
      write();
    }
    if (!run.progress) continue;
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    const double left = elapsed.count() / static_cast<double>(std::max<std::size_t>(made, 1)) *
                        static_cast<double>(items.size() - i - 1);
    run.progress(fmt::format(
        "[{}/{}] {}{}", i + 1, items.size(), Placed(item, results.Of(i)),
        missing.empty() ? " (done before)" : fmt::format("; about {:.0f} s left", left)));
  }
  write();
  return results.All();
}

}  // namespace volalign
