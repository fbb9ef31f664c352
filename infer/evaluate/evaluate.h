#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/measure.h"
#include "infer/view/segmenter.h"

namespace volalign {

inline constexpr char kEvaluationFormat[] = "volalign.evaluation/1";

struct CheckpointFile {
  std::string file, sha256;
};

/// Writes evaluation.json: the cases and, for people and other programs, their summary and the
/// models. Throws IoError.
void WriteEvaluation(const std::filesystem::path& path, const std::vector<EvaluatedCase>& cases,
                     const std::vector<CheckpointFile>& models);

/// Reads the cases of an evaluation.json strictly. Throws IoError, or DataError, also for a file
/// that is no evaluation.
std::vector<EvaluatedCase> ReadEvaluation(const std::filesystem::path& path);

/// A network whose calibrations are measured.
struct EvaluationModel {
  CheckpointFile checkpoint;
  Segmenter* segmenter;
  const Structure* structure;  ///< a capture whose structure has other sides is an error
};

struct EvaluateRun {
  std::filesystem::path output;  ///< evaluation.json; results in it are not computed again
  std::string program;           ///< identifies the program's build
  std::function<void()> begin;   ///< called when `output` has only this run's results
  std::function<void(const std::string& line)> progress;  ///< one line per capture
  CountDone count;                                        ///< of the captures that are not done yet
};

/// Evaluates every item with each model under every variant. It writes `output` atomically after
/// each capture, so that a killed run continues where it was. Results of another program, model,
/// option or capture in it are dropped. With several models, a case's variant has the name of its
/// checkpoint's file too: "m05", or "m05, network". Throws what loading, rendering and calibration
/// throw, ConfigError for two checkpoints of one name, and DataError for an `output` that is no
/// evaluation.
std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    const std::vector<EvaluationModel>& models,
                                    const EvaluateRun& run);

}  // namespace volalign
