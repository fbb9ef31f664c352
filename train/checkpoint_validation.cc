#include "train/checkpoint_validation.h"

#include <fmt/format.h>

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

ValidationResult ValidateCheckpoint(LoadedModel& model, const TrainConfig& config, int samples,
                                    const CountDone& count, const Structure* structure) {
  const auto context = std::make_shared<const SampleContext>(
      MakeSampleContext(config.data, config.run.batch_size,
                        structure != nullptr ? structure : &model.meta.structure));
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
    source = HeldOut(frames, context->image_sizes, config.run.batch_size,
                     config.data.pose.roll_offsets_deg);
  }
  return Validate(model.net, loss, context->structure, config.loss.keypoints, source, samples,
                  compute.device, compute.channels_last, count);
}

namespace {

/// Bands of horizontal distance, m: the differences of the paper's three ranges.
constexpr std::array<std::pair<double, double>, 3> kBands{{{1.5, 2.25}, {2.25, 2.75}, {2.75, 3.5}}};

std::vector<SampleScore> InBand(const std::vector<SampleScore>& scores,
                                std::pair<double, double> band) {
  std::vector<SampleScore> inside;
  for (const SampleScore& score : scores) {
    if (score.rho_m >= band.first && score.rho_m < band.second) inside.push_back(score);
  }
  return inside;
}

std::map<std::string, std::vector<SampleScore>> BySensor(const std::vector<SampleScore>& scores) {
  std::map<std::string, std::vector<SampleScore>> by_sensor;
  for (const SampleScore& score : scores) by_sensor[score.sensor].push_back(score);
  return by_sensor;
}

std::string InCentimetres(std::pair<double, double> band) {
  return fmt::format("{:.0f}-{:.0f}", 100 * band.first, 100 * band.second);
}

nlohmann::ordered_json ToJson(const ValidationResult& r) {
  nlohmann::ordered_json j = {{"samples", r.samples},
                              {"loss_seg", r.loss_seg},
                              {"miou", r.miou},
                              {"miou_authors", r.miou_authors},
                              {"posed", r.posed}};
  if (r.posed == 0) return j;
  j["keypoint_rmse_m"] = r.keypoint_rmse_m;
  j["median_translation_error_m"] = r.median_translation_error_m;
  j["median_rotation_error_deg"] = r.median_rotation_error_deg;
  return j;
}

}  // namespace

std::string ValidationJson(const std::vector<ValidatedModel>& models) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ValidatedModel& model : models) {
    nlohmann::ordered_json j = {{"model", model.file},
                                {"training_samples", model.training_samples}};
    j.update(ToJson(model.result));
    for (const auto& [sensor, scores] : BySensor(model.result.scores)) {
      j["by_sensor"][sensor] = ToJson(Summarise(scores));
    }
    for (const auto& band : kBands) {
      const std::vector<SampleScore> scores = InBand(model.result.scores, band);
      if (!scores.empty()) j["by_rho_cm"][InCentimetres(band)] = ToJson(Summarise(scores));
    }
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
    const auto row = [&](const std::string& group, const std::vector<SampleScore>& scores) {
      if (scores.empty()) return;
      const ValidationResult r = Summarise(scores);
      const bool posed = r.posed > 0;
      const auto if_posed = [&](double error) {
        return posed ? Table::Cell(error) : Table::Cell();
      };
      table.rows.push_back({model.file, model.training_samples, group, CellOf(r.samples), r.miou,
                            r.miou_authors, r.loss_seg, CellOf(r.posed),
                            if_posed(r.median_translation_error_m),
                            if_posed(r.median_rotation_error_deg)});
    };
    row("all", model.result.scores);
    for (const auto& [sensor, scores] : BySensor(model.result.scores)) row(sensor, scores);
    for (const auto& band : kBands)
      row(fmt::format("rho {} cm", InCentimetres(band)), InBand(model.result.scores, band));
  }
  return table;
}

}  // namespace volalign
