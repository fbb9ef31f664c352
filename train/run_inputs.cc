#include "train/run_inputs.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/geometry/camera.h"
#include "core/nn/checkpoint.h"
#include "render/sample.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

bool Exists(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error);
}

bool IsFound(const std::string& path) { return Exists(FindInputFile(path)); }

std::string IfExists(const fs::path& path) { return Exists(path) ? path.string() : ""; }

std::string KeptStructure(const fs::path& dir) { return IfExists(dir / "structure.yaml"); }

bool SamePool(const std::vector<IntrinsicsPoolEntry>& a,
              const std::vector<IntrinsicsPoolEntry>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const IntrinsicsPoolEntry& x, const IntrinsicsPoolEntry& y) {
                      return x.sensor == y.sensor && x.intrinsics == y.intrinsics;
                    });
}

[[noreturn]] void Differs(const char* key, const std::string& given, const std::string& kept,
                          const char* what) {
  throw ConfigError(
      fmt::format("{0} = {1} has other {3} than {2}, with which this run began: resume with --set "
                  "{0}={2}, or start a new run",
                  key, given, kept, what));
}

}  // namespace

std::string KeptIntrinsics(const fs::path& dir) { return IfExists(dir / "intrinsics.yaml"); }

void KeepInputs(const fs::path& dir, const TrainConfig& config, const Structure& structure) {
  const TrainingDataConfig& data = config.data;
  if (KeptStructure(dir).empty()) {
    // A mesh is no text, or in another file.
    if (structure.IsOfBoxes() && IsFound(data.structure) &&
        ReadStructure(data.structure).Hash() == structure.Hash()) {
      WriteFileAtomically(dir / "structure.yaml",
                          ReadFile(FindInputFile(data.structure), kMaxTextBytes));
    } else {
      WriteFileAtomically(dir / "structure.yaml", StructureYaml(structure));
    }
  }
  if (KeptIntrinsics(dir).empty() && IsFound(data.intrinsics))
    WriteFileAtomically(dir / "intrinsics.yaml",
                        ReadFile(FindInputFile(data.intrinsics), kMaxTextBytes));
}

void RequireSameInputs(const fs::path& dir, const TrainConfig& config, const Structure& structure) {
  const TrainingDataConfig& data = config.data;
  if (const std::string kept = KeptStructure(dir); !kept.empty()) {
    if (ReadStructure(kept).Hash() != structure.Hash())
      Differs("data.structure", data.structure, kept, "boxes or labels");
  } else if (const std::string model = IfExists(dir / "model.safetensors"); !model.empty()) {
    if (LoadCheckpoint(model).meta.structure.Hash() != structure.Hash())
      throw ConfigError(fmt::format(
          "data.structure = {} has other boxes or labels than {}, which this run has trained: "
          "resume with the structure that it began with, or start a new run",
          data.structure, model));
  }
  const std::string kept = KeptIntrinsics(dir);
  if (kept.empty() || !IsFound(data.intrinsics)) return;
  if (!SamePool(EntriesOf(data.sensors, ReadIntrinsicsPool(kept)),
                EntriesOf(data.sensors, ReadIntrinsicsPool(data.intrinsics))))
    Differs("data.intrinsics", data.intrinsics, kept, "intrinsics of the recipe's sensors");
}

std::vector<std::string> UseKeptInputs(const fs::path& dir, TrainingDataConfig* config) {
  std::vector<std::string> sentences;
  if (!Exists(dir / "config.yaml")) return sentences;  // configs/ has such files, too
  const auto use = [&](const char* key, const std::string& kept, std::string* path) {
    if (kept.empty() || IsFound(*path)) return;
    sentences.push_back(fmt::format("{} = {} is not there: {} is used", key, *path, kept));
    *path = kept;
  };
  use("data.structure", KeptStructure(dir), &config->structure);
  use("data.intrinsics", KeptIntrinsics(dir), &config->intrinsics);
  return sentences;
}

}  // namespace volalign
