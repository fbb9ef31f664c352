#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "infer/evaluate/measure.h"

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

}  // namespace volalign
