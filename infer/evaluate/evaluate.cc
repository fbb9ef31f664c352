#include "infer/evaluate/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/provenance.h"
#include "core/config/config.h"
#include "core/json/json_archive.h"
#include "infer/evaluate/statistics.h"

namespace volalign {

// The file's keys.

template <class Archive>
void Describe(Archive& ar, EvaluatedErrors& errors) {
  ar("initial", errors.initial);
  ar("refined", errors.refined);
  ar("delta", errors.delta);
}

template <class Archive>
void Describe(Archive& ar, EvaluatedSensor& sensor) {
  ar("name", sensor.name);
  ar("status", sensor.status);
  ar.Optional("code", sensor.code);
  ar.Optional("sides_fix_pose", sensor.sides_fix_pose);
  if (!sensor.placed()) return;
  ar("sides", sensor.sides);
  ar.IfFinite("initial_rms_to_structure_m", sensor.initial_rms_to_structure_m);
  ar.IfFinite("rms_to_structure_m", sensor.rms_to_structure_m);
  ar.IfFinite("inlier_share", sensor.inlier_share);
  ar.IfFinite("sigma", sensor.sigma);
  ar.Optional("error", sensor.nominal);
  ar.Optional("error_as_built", sensor.built);
}

/// The key is present for several placements.
template <class Archive>
void DescribePlacements(Archive& ar, int& placements) {
  std::optional<int> several;
  if (placements > 1) several = placements;
  ar.Optional("placements", several);
  placements = several.value_or(1);
}

template <class Archive>
void Describe(Archive& ar, EvaluatedCase& one) {
  ar("fingerprint", one.fingerprint);
  ar("rig", one.rig);
  ar.Optional("sensor_model", one.sensors);
  ar.Optional("seed", one.seed);
  ar("variant", one.variant);
  ar("sensors", one.results);
  ar("timings_s", one.timings_s);
  DescribePlacements(ar, one.placements);
}

template <class Archive>
void Describe(Archive& ar, ErrorStatistics& statistics) {
  ar("median", statistics.median);
  ar("p95", statistics.p95);
  ar("max", statistics.max);
}

template <class Archive>
void DescribePoses(Archive& ar, const std::string& begin, PoseStatistics& poses) {
  ar(begin + "initial_mm", poses.initial_mm);
  ar(begin + "initial_deg", poses.initial_deg);
  ar(begin + "refined_mm", poses.refined_mm);
  ar(begin + "refined_deg", poses.refined_deg);
  ar(begin + "cover_68", poses.cover68);
  ar(begin + "cover_95", poses.cover95);
}

template <class Archive>
void Describe(Archive& ar, EvaluationSummary& summary) {
  ar("rig", summary.rig);
  ar("sensor_model", summary.sensors);
  ar("variant", summary.variant);
  DescribePlacements(ar, summary.placements);
  ar("sensors", summary.count);
  ar("placed", summary.placed);
  ar("weak", summary.weak);
  ar("fixable", summary.fixable);
  ar("lost", summary.lost);
  ar("wrong", summary.wrong);
  ar("measured", summary.measured);
  DescribePoses(ar, "", summary.nominal);
  DescribePoses(ar, "as_built_", summary.built);
}

namespace {

struct EvaluationFile {
  std::string tool = Tool(), date = UtcNow();
  std::vector<CheckpointFile> models;
  std::vector<EvaluationSummary> summary;
  std::vector<EvaluatedCase> cases;
};

}  // namespace

template <class Archive>
void Describe(Archive& ar, CheckpointFile& model) {
  ar("file", model.file);
  ar("sha256", model.sha256);
}

template <class Archive>
void Describe(Archive& ar, EvaluationFile& file) {
  ar.Constant("format", kEvaluationFormat);
  ar.WriteOnly("tool", file.tool);
  ar.WriteOnly("date", file.date);
  ar.WriteOnly("models", file.models);
  ar.WriteOnly("summary", file.summary);
  ar("cases", file.cases);
}

void WriteEvaluation(const std::filesystem::path& path, const std::vector<EvaluatedCase>& cases,
                     const std::vector<CheckpointFile>& models) {
  EvaluationFile file;
  file.models = models;
  file.summary = SummariseCases(cases);
  file.cases = cases;
  WriteFileAtomically(path, WriteDescribed(file, path.string(), 1));
}

std::vector<EvaluatedCase> ReadEvaluation(const std::filesystem::path& path) {
  const std::string name = path.string();
  const nlohmann::json document = ParseStrictJson(ReadFile(path, kMaxResultBytes), name);
  const ObjectReader root(document, name);
  if (!root.Has("format") || root.Text("format") != kEvaluationFormat) {
    throw DataError(
        fmt::format("{}: this is no \"{}\"; choose another folder", name, kEvaluationFormat));
  }
  return ReadDescribed<EvaluationFile>(root).cases;
}

namespace {

/// A model with a variant.
struct Combination {
  std::size_t model, variant;
  std::string name;
};

/// By model, then by variant. Throws ConfigError for two models of one name.
std::vector<Combination> Combine(const std::vector<EvaluationModel>& models,
                                 const std::vector<EvaluationVariant>& variants) {
  std::vector<Combination> combinations;
  std::set<std::string> names;
  for (std::size_t m = 0; m < models.size(); ++m) {
    const std::string& file = models[m].checkpoint.file;
    const std::string model = std::filesystem::path(file).stem().string();
    if (!names.insert(model).second) {
      throw ConfigError(fmt::format(
          "{}: another checkpoint is called {} too, and tables name them so; rename one", file,
          model));
    }
    for (std::size_t v = 0; v < variants.size(); ++v) {
      const std::string& variant = variants[v].name;
      combinations.push_back({m, v,
                              models.size() == 1     ? variant
                              : variants.size() == 1 ? model
                                                     : fmt::format("{}, {}", model, variant)});
    }
  }
  return combinations;
}

std::string Fingerprint(const EvaluationItem& item, const Combination& combination,
                        const std::string& model_sha256, const CalibrateOptions& options,
                        const EvaluateRun& run) {
  std::string all;
  for (const std::string& part : {run.program, model_sha256, item.rig, item.sensors, item.identity,
                                  combination.name, WriteConfig(options)}) {
    all += fmt::format("{}:{}\n", part.size(), part);
  }
  return Sha256(all);
}

using Results = std::map<std::string, EvaluatedCase>;  // by fingerprint

/// The cases with these fingerprints, as far as known.
std::vector<EvaluatedCase> Select(const Results& known, const std::vector<std::string>& wanted) {
  std::vector<EvaluatedCase> cases;
  for (const std::string& fingerprint : wanted) {
    const auto found = known.find(fingerprint);
    if (found != known.end()) cases.push_back(found->second);
  }
  return cases;
}

/// Throws DataError unless the capture of `item` has the sides that the network knows.
void RequireSides(const EvaluationItem& item, const Structure& of_capture, const Structure& known) {
  if (of_capture.SideNames() == known.SideNames()) return;
  throw DataError(fmt::format(
      "{}: the structure \"{}\" has other sides than \"{}\", which the network knows; train a "
      "network for it",
      item.rig, of_capture.name(), known.name()));
}

/// The cases of one item, of the combinations `asked`.
std::vector<EvaluatedCase> EvaluateItem(const EvaluationItem& item,
                                        const std::vector<EvaluationVariant>& variants,
                                        const std::vector<EvaluationModel>& models,
                                        const std::vector<Combination>& asked) {
  const EvaluationCapture capture = item.load();
  std::vector<EvaluatedCase> cases;
  for (std::size_t m = 0; m < models.size(); ++m) {
    std::vector<EvaluationVariant> own;
    for (const Combination& one : asked) {
      if (one.model == m) own.push_back({one.name, variants[one.variant].options});
    }
    if (own.empty()) continue;
    RequireSides(item, capture.structure, *models[m].structure);
    for (EvaluatedCase& one : EvaluateCapture(capture, own, *models[m].segmenter)) {
      one.rig = item.rig;
      one.sensors = item.sensors;
      one.seed = item.seed;
      one.placements = item.placements;
      cases.push_back(std::move(one));
    }
  }
  return cases;
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
                                    const std::vector<EvaluationModel>& models,
                                    const EvaluateRun& run) {
  const std::vector<Combination> combinations = Combine(models, variants);
  Results known;
  if (std::filesystem::exists(run.output)) {
    for (const EvaluatedCase& one : ReadEvaluation(run.output)) known[one.fingerprint] = one;
  }
  std::vector<std::vector<std::string>> wanted(items.size());  // by item and combination
  std::vector<std::string> all;
  for (std::size_t i = 0; i < items.size(); ++i) {
    for (const Combination& one : combinations) {
      wanted[i].push_back(Fingerprint(items[i], one, models[one.model].checkpoint.sha256,
                                      variants[one.variant].options, run));
    }
    all.insert(all.end(), wanted[i].begin(), wanted[i].end());
  }
  std::vector<CheckpointFile> files;
  for (const EvaluationModel& model : models) files.push_back(model.checkpoint);
  const auto write = [&] { WriteEvaluation(run.output, Select(known, all), files); };
  write();
  if (run.begin) run.begin();
  const auto is_known = [&](const std::string& one) { return known.count(one) > 0; };
  const auto to_make = std::count_if(wanted.begin(), wanted.end(), [&](const auto& ones) {
    return !std::all_of(ones.begin(), ones.end(), is_known);
  });
  std::int64_t made = 0;
  if (run.count) run.count(made, to_make);
  for (std::size_t i = 0; i < items.size(); ++i) {
    const EvaluationItem& item = items[i];
    std::vector<Combination> asked;
    std::vector<std::string> missing;
    for (std::size_t j = 0; j < combinations.size(); ++j) {
      if (known.count(wanted[i][j])) continue;
      asked.push_back(combinations[j]);
      missing.push_back(wanted[i][j]);
    }
    if (!missing.empty()) {
      std::vector<EvaluatedCase> fresh = EvaluateItem(item, variants, models, asked);
      for (std::size_t k = 0; k < fresh.size(); ++k) {
        fresh[k].fingerprint = missing[k];
        known[missing[k]] = std::move(fresh[k]);
      }
      write();
      if (run.count) run.count(++made, to_make);
    }
    if (run.progress) {
      run.progress(fmt::format("[{}/{}] {}{}", i + 1, items.size(),
                               Placed(item, Select(known, wanted[i])),
                               missing.empty() ? " (done before)" : ""));
    }
  }
  write();
  return Select(known, all);
}

}  // namespace volalign
