#include "train/checkpoint_validation.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>
#include <vector>

#include "train/compute.h"
#include "train/rendered_source.h"

namespace volalign {

ValidationResult ValidateCheckpoint(LoadedModel& model, const TrainConfig& config, int samples) {
  const auto context =
      std::make_shared<const SampleContext>(MakeSampleContext(config.data, config.run.batch_size));
  CheckStructure(model.meta, context->structure);
  const Compute compute = ChooseCompute(config.run);
  model.net->to(compute.device);
  const TrainingLoss loss(config.loss, context->structure, compute.device);
  RenderedSource source(context, config.run, static_cast<std::uint64_t>(config.run.validation_seed),
                        0);
  return Validate(model.net, loss, context->structure, ParseKeypointKind(config.loss.keypoints),
                  source, samples, compute.device, compute.channels_last);
}

namespace {

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
    std::map<std::string, std::vector<SampleScore>> by_sensor;
    for (const SampleScore& score : model.result.scores) by_sensor[score.sensor].push_back(score);
    for (const auto& [sensor, scores] : by_sensor) {
      j["by_sensor"][sensor] = ToJson(Summarise(scores));
    }
    list.push_back(j);
  }
  return list.dump(1) + "\n";
}

std::string ValidationTable(const ValidationResult& result) {
  std::string table =
      "| samples of | number | miou | miou_authors | loss_seg | with a pose | median error of it "
      "|\n"
      "|---|---|---|---|---|---|---|\n";
  const auto row = [&](const std::string& name,
                       const std::function<bool(const SampleScore&)>& belongs) {
    std::vector<SampleScore> scores;
    for (const SampleScore& score : result.scores) {
      if (belongs(score)) scores.push_back(score);
    }
    if (scores.empty()) return;
    const ValidationResult r = Summarise(scores);
    table += fmt::format("| {} | {} | {:.3f} | {:.3f} | {:.4f} | {} | {} |\n", name, r.samples,
                         r.miou, r.miou_authors, r.loss_seg, r.posed, MedianPoseError(r));
  };
  row("all", [](const SampleScore&) { return true; });
  std::set<std::string> sensors;
  for (const SampleScore& score : result.scores) sensors.insert(score.sensor);
  for (const std::string& sensor : sensors) {
    row(sensor, [&](const SampleScore& score) { return score.sensor == sensor; });
  }
  constexpr std::array<std::pair<double, double>, 3> kBands{
      {{1.5, 2.25}, {2.25, 2.75}, {2.75, 3.5}}};
  for (const auto& [near, far] : kBands) {
    row(fmt::format("rho {:.0f}-{:.0f} cm", 100 * near, 100 * far),
        [&, low = near, high = far](const SampleScore& score) {
          return score.rho_m >= low && score.rho_m < high;
        });
  }
  return table;
}

}  // namespace volalign
