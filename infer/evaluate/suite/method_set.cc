#include "infer/evaluate/suite/method_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/config/config.h"

namespace volalign {

bool HasModel(const SuiteMethod& method) {
  return method.kind == MethodKind::kMarkers ||
         std::filesystem::exists(FindInputFile(method.model));
}

MethodSet::MethodSet(const SuiteConfig& suite, std::string program)
    : suite_(suite), program_(std::move(program)) {
  std::map<std::string, std::shared_ptr<Shared>> networks;  // by checksum
  for (const SuiteMethod& method : suite.methods) {
    if (!HasModel(method)) continue;
    Entry entry{method, nullptr, ""};
    if (!method.model.empty()) {
      entry.sha256 = Sha256(ReadFile(FindInputFile(method.model), kMaxModelBytes));
      std::shared_ptr<Shared>& shared = networks[entry.sha256];
      if (!shared) shared = std::make_shared<Shared>();
      entry.shared = shared;
    }
    methods_.push_back(std::move(entry));
  }
}

bool MethodSet::HasMarkers() const {
  return std::any_of(methods_.begin(), methods_.end(),
                     [](const Entry& entry) { return entry.method.kind == MethodKind::kMarkers; });
}

bool MethodSet::Applies(std::size_t i, const SuiteItem& item) const {
  const SuiteMethod& method = methods_[i].method;
  return IsApplicable(method, item.dataset) &&
         (method.kind != MethodKind::kMarkers || item.rig.has_value());
}

std::string MethodSet::Fingerprint(std::size_t i, const SuiteItem& item) const {
  const Entry& entry = methods_[i];
  std::string all;
  for (const std::string& part : {program_, item.identity, entry.sha256, WriteConfig(entry.method),
                                  std::to_string(suite_.min_side_pixels)}) {
    all += fmt::format("{}:{}\n", part.size(), part);
  }
  return Sha256(all);
}

MethodResult MethodSet::Run(std::size_t i, const SuiteCapture& capture, int threads) {
  return RunMethod(methods_[i].method, capture, Network(i), threads);
}

Segmenter* MethodSet::Network(std::size_t i) {
  const Entry& entry = methods_[i];
  if (!entry.shared) return nullptr;
  const std::lock_guard<std::mutex> lock(entry.shared->mutex);
  if (!entry.shared->segmenter) entry.shared->segmenter = LoadNetworkSegmenter(entry.method.model);
  return entry.shared->segmenter.get();
}

}  // namespace volalign
