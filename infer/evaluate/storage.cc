#include "infer/evaluate/storage.h"

#include <fmt/format.h>

#include <optional>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/provenance.h"
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
  ar("initial_mm", summary.initial_mm);
  ar("initial_deg", summary.initial_deg);
  ar("refined_mm", summary.refined_mm);
  ar("refined_deg", summary.refined_deg);
  ar("as_built_initial_mm", summary.built_initial_mm);
  ar("as_built_initial_deg", summary.built_initial_deg);
  ar("as_built_refined_mm", summary.built_refined_mm);
  ar("as_built_refined_deg", summary.built_refined_deg);
  ar("cover_68", summary.cover68);
  ar("cover_95", summary.cover95);
  ar("as_built_cover_68", summary.built_cover68);
  ar("as_built_cover_95", summary.built_cover95);
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
  ar.Derived("tool", file.tool);
  ar.Derived("date", file.date);
  ar.Derived("models", file.models);
  ar.Derived("summary", file.summary);
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
  const JsonObject root(document, name);
  if (!root.Has("format") || root.Text("format") != kEvaluationFormat) {
    throw DataError(
        fmt::format("{}: this is no \"{}\"; choose another folder", name, kEvaluationFormat));
  }
  return ReadDescribed<EvaluationFile>(root).cases;
}

}  // namespace volalign
