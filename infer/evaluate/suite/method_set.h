#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/suite_config.h"
#include "infer/evaluate/suite/suite_items.h"
#include "infer/segment/load.h"

namespace volalign {

/// Can the method run? It needs no model, or the file is there.
bool HasModel(const SuiteMethod& method);

/// The methods of a suite that can run, with their networks. Several threads may use it.
class MethodSet {
 public:
  /// `suite` must outlive the set. `program` identifies the program's build.
  MethodSet(const SuiteConfig& suite, std::string program);

  std::size_t size() const { return methods_.size(); }
  const SuiteMethod& at(std::size_t i) const { return methods_[i].method; }
  bool HasMarkers() const;
  /// Does the method apply to the capture? Some are for one dataset, and recordings have no
  /// markers.
  bool Applies(std::size_t i, const SuiteItem& item) const;
  /// A fingerprint of everything that the method's result for the capture depends on.
  std::string Fingerprint(std::size_t i, const SuiteItem& item) const;
  MethodResult Run(std::size_t i, const SuiteCapture& capture, int threads);

 private:
  /// A network is loaded at its first use; its forward pass changes nothing in it.
  struct Shared {
    std::mutex mutex;
    std::unique_ptr<NetworkSegmenter> segmenter;
  };
  struct Entry {
    SuiteMethod method;
    std::shared_ptr<Shared> shared;
    std::string sha256;
  };

  Segmenter* Network(std::size_t i);

  const SuiteConfig& suite_;
  std::string program_;
  std::vector<Entry> methods_;
};

}  // namespace volalign
