#include "train/checkpoint_validation.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "render/egl/renderers.h"
#include "train/compute.h"
#include "train/real_frames.h"
#include "train/training_data.h"

namespace volalign {

namespace {

/// The intrinsics of the model's training, if it had all these sensors; else null.
const std::vector<IntrinsicsPoolEntry>* TrainedIntrinsics(const CheckpointMeta& meta,
                                                          const std::vector<std::string>& sensors) {
  const std::vector<IntrinsicsPoolEntry>& own = meta.intrinsics;
  const bool has_all = std::all_of(sensors.begin(), sensors.end(), [&](const auto& sensor) {
    return std::any_of(own.begin(), own.end(), [&](const auto& e) { return e.sensor == sensor; });
  });
  return own.empty() || !has_all ? nullptr : &own;
}

}  // namespace

ValidationResult ValidateCheckpoint(LoadedModel& model, const TrainConfig& config, int samples,
                                    const CountDone& count, const Structure* structure) {
  const auto context = std::make_shared<const SampleContext>(MakeSampleContext(
      config.data, config.run.batch_size, structure != nullptr ? structure : &model.meta.structure,
      TrainedIntrinsics(model.meta, config.data.sensors)));
  CheckStructure(model.meta, context->structure);
  const Compute compute = ChooseCompute(config.run);
  model.net->to(compute.device);
  const TrainingLoss loss(config.loss, context->structure, compute.device);
  SampleSource source;
  if (config.data.real.validation.empty()) {
    const Renderers renderers = ChooseRenderers(config.data.renderer, {}, compute.device.is_cuda());
    source = RenderedSamples(context, config.run, renderers.make,
                             static_cast<std::uint64_t>(config.run.validation_seed), 0);
  } else {
    const std::vector<RealFrame> frames =
        ReadRealFrames(config.data.real.validation, context->structure);
    samples = static_cast<int>(frames.size());
    source = ValidationFrames(frames, context->image_sizes, config.run.batch_size,
                              config.data.pose.roll_offsets_deg);
  }
  return Validate(model.net, loss, context->structure, config.loss.keypoints, source, samples,
                  compute.device, compute.channels_last, count);
}

namespace {

constexpr char kBySensor[] = "by_sensor";
/// Bands of horizontal distance, m: the differences of the paper's three ranges.
constexpr std::array<std::pair<double, double>, 3> kBands{{{1.5, 2.25}, {2.25, 2.75}, {2.75, 3.5}}};

/// The samples of a sensor, or of a band of distances.
struct Group {
  const char* kind;  ///< its key in JSON
  std::string name;
  ValidationResult result;
};

std::vector<Group> GroupsOf(const std::vector<SampleScore>& scores) {
  std::map<std::string, std::vector<SampleScore>> by_sensor;
  for (const SampleScore& score : scores) by_sensor[score.sensor].push_back(score);
  std::vector<Group> groups;
  for (const auto& [sensor, own] : by_sensor) groups.push_back({kBySensor, sensor, Summarise(own)});
  for (const auto& [low, high] : kBands) {
    std::vector<SampleScore> inside;
    for (const SampleScore& score : scores) {
      if (score.rho_m >= low && score.rho_m < high) inside.push_back(score);
    }
    if (inside.empty()) continue;
    groups.push_back(
        {"by_rho_cm", fmt::format("{:.0f}-{:.0f}", 100 * low, 100 * high), Summarise(inside)});
  }
  return groups;
}

nlohmann::ordered_json ToJson(const ValidationResult& r) {
  nlohmann::ordered_json j = {{"samples", r.samples}, {"posed", r.samples_with_pose}};
  for (const auto& [name, mean] : r.means) j[name] = mean;
  return j;
}

}  // namespace

std::string ValidationJson(const std::vector<ValidatedModel>& models) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ValidatedModel& model : models) {
    nlohmann::ordered_json j = {{"model", model.file},
                                {"training_samples", model.training_samples}};
    j.update(ToJson(model.result));
    for (const Group& group : GroupsOf(model.result.scores))
      j[group.kind][group.name] = ToJson(group.result);
    list.push_back(j);
  }
  return list.dump(1) + "\n";
}

Table ValidationTable(const std::vector<ValidatedModel>& models) {
  Table table;
  table.columns = {"model",
                   "training_samples",
                   {"group", "samples of"},
                   {"samples", "number"},
                   {"miou", "miou", 1, 3},
                   {"miou_authors", "miou_authors", 1, 3},
                   {"loss_seg", "loss_seg", 1, 4},
                   {"posed", "with a pose"},
                   {"median_translation_error_m", "median error, cm", 100, 1},
                   {"median_rotation_error_deg", "deg", 1, 2}};
  for (const ValidatedModel& model : models) {
    const auto row = [&](const std::string& group, const ValidationResult& r) {
      const auto mean = [&](const char* name) {
        return r.means.count(name) > 0 ? Table::Cell(r.Mean(name)) : Table::Cell();
      };
      table.rows.push_back({model.file, model.training_samples, group, CellOf(r.samples),
                            mean("miou"), mean("miou_authors"), mean("loss_seg"),
                            CellOf(r.samples_with_pose), mean("median_translation_error_m"),
                            mean("median_rotation_error_deg")});
    };
    row("all", Summarise(model.result.scores));
    for (const Group& group : GroupsOf(model.result.scores))
      row(group.kind == kBySensor ? group.name : fmt::format("rho {} cm", group.name),
          group.result);
  }
  return table;
}

}  // namespace volalign
