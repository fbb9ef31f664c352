#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/rig.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/suite_config.h"
#include "render/depth_renderer.h"

namespace volalign {

/// A capture of a suite, to be rendered or read when its turn comes.
struct SuiteItem {
  std::string dataset, set_up, capture;
  std::optional<Rig> rig;  ///< to render; else a recording
  EvaluationItem recording;
  std::string identity;   ///< everything that it depends on
  bool infrared = false;  ///< a method needs markers
};

/// At most `most` captures of a dataset, evenly taken (0: all): the turns of its rigs, then its
/// recordings. Recordings are of `structure` unless they name another. Throws what reading rigs and
/// captures throws.
std::vector<SuiteItem> SuiteItems(const SuiteDataset& dataset, const Structure& structure,
                                  bool infrared, int most);

/// A thread's renderer, made at its first use; it is destroyed on the thread that made it.
class WorkerRenderer {
 public:
  explicit WorkerRenderer(RendererFactory make) : make_(std::move(make)) {}
  DepthRenderer& operator*() {
    if (!renderer_) renderer_ = make_();
    return *renderer_;
  }

 private:
  RendererFactory make_;
  std::unique_ptr<DepthRenderer> renderer_;
};

/// Renders or reads a capture.
SuiteCapture LoadSuiteCapture(const SuiteItem& item, WorkerRenderer& renderer);

}  // namespace volalign
