#include "infer/evaluate/suite/suite_items.h"

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>
#include <utility>

#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/evaluate/suite/markers.h"
#include "infer/view/sensor_view.h"
#include "render/rig.h"

namespace volalign {

namespace {

std::string Stem(const std::string& path) { return std::filesystem::path(path).stem().string(); }

/// At most `most` items of a list, evenly taken; 0: all.
template <class T>
std::vector<T> Some(std::vector<T> items, int most) {
  const auto wanted = static_cast<std::size_t>(most);
  if (most <= 0 || items.size() <= wanted) return items;
  std::vector<T> some;
  for (std::size_t k = 0; k < wanted; ++k)
    some.push_back(std::move(items[k * items.size() / wanted]));
  return some;
}

std::vector<SuiteItem> ItemsOf(const SuiteDataset& dataset, const Structure& structure,
                               bool infrared) {
  std::vector<SuiteItem> items;
  for (const std::string& file : dataset.rigs) {
    const std::vector<Rig> turns = Turns(ReadRig(ConfigSource::FromFile(file)));
    for (std::size_t k = 0; k < turns.size(); ++k) {
      const std::string name = Stem(file);
      items.push_back({dataset.name,
                       name,
                       fmt::format("{}_turn_{}", name, k + 1),
                       turns[k],
                       {},
                       RigItem(name, turns[k], "", nullptr).identity,
                       infrared});
    }
  }
  for (std::size_t k = 0; k < dataset.captures.size(); ++k) {
    const EvaluationItem recording = CaptureItem(dataset.captures[k], structure);
    items.push_back({dataset.name, "recordings", fmt::format("recording_{}", k + 1), std::nullopt,
                     recording, recording.identity});
  }
  return items;
}

}  // namespace

std::vector<SuiteItem> SuiteItems(const SuiteDataset& dataset, const Structure& structure,
                                  bool infrared, int most) {
  return Some(ItemsOf(dataset, structure, infrared), most);
}

SuiteCapture LoadSuiteCapture(const SuiteItem& item, WorkerRenderer& renderer) {
  SuiteCapture capture;
  if (item.rig) {
    std::optional<InfraredRequest> infrared;
    if (item.infrared) {
      infrared.emplace(InfraredRequest{StructureMarkers(ReadStructure(item.rig->structure)), {}});
    }
    const std::vector<RigCapture> captures =
        RenderPlacements(*item.rig, *renderer, infrared ? &*infrared : nullptr);
    capture.evaluation = EvaluationCaptureOf(captures);
    for (const CapturedSensor& sensor : captures.front().sensors) {
      if (!infrared) break;
      capture.infrared.push_back(sensor.infrared);
      capture.infrared_intrinsics.push_back(sensor.infrared_intrinsics);
    }
  } else {
    capture.evaluation = item.recording.load();
  }
  for (const SensorFrame& frame : capture.evaluation.frames)
    capture.views.push_back(MakeSensorView(frame, frame.intrinsics));
  return capture;
}

}  // namespace volalign
