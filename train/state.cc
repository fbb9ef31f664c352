#include "train/state.h"

#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "train/same_run.h"

namespace volalign {
namespace {

using nlohmann::json;

json ToJson(const BestValidation& best) {
  return {{"samples", best.samples}, {"value", best.value}, {"since", best.since}};
}

BestValidation BestFromJson(const json& j) {
  return {j.at("samples").get<std::int64_t>(), j.at("value").get<double>(),
          j.at("since").get<int>()};
}

json ToJson(const StepMeans& means) {
  const StepReport& sum = means.sum;
  const StepTimes& t = sum.times;
  return {{"steps", means.steps},
          {"samples", means.samples},
          {"loss", sum.loss},
          {"loss_seg", sum.loss_seg},
          {"loss_3d", sum.loss_3d},
          {"degenerate", sum.degenerate},
          {"gradient_norm", sum.gradient_norm},
          {"times", {t.data, t.forward, t.loss, t.backward, t.optim}}};
}

StepMeans MeansFromJson(const json& j) {
  StepMeans means;
  means.steps = j.at("steps").get<std::int64_t>();
  means.samples = j.at("samples").get<std::int64_t>();
  means.sum.loss = j.at("loss").get<double>();
  means.sum.loss_seg = j.at("loss_seg").get<double>();
  means.sum.loss_3d = j.at("loss_3d").get<double>();
  means.sum.degenerate = j.at("degenerate").get<std::int64_t>();
  means.sum.gradient_norm = j.at("gradient_norm").get<double>();
  const auto times = j.at("times").get<std::array<double, 5>>();
  means.sum.times = {times[0], times[1], times[2], times[3], times[4]};
  return means;
}

json ToJson(const RunProgress& progress) {
  json sizes = json::array();
  for (const auto& [width, height] : progress.image_sizes) sizes.push_back({width, height});
  return {{"samples", progress.samples},
          {"init_samples", progress.init_samples},
          {"lr", progress.lr},
          {"focal_px", {progress.focal_px.first, progress.focal_px.second}},
          {"image_sizes", sizes},
          {"validated", progress.validated},
          {"best", ToJson(progress.best)},
          {"means", ToJson(progress.means)}};
}

RunProgress FromJson(const json& meta) {
  RunProgress progress;
  progress.samples = meta.at("samples").get<std::int64_t>();
  progress.init_samples = meta.at("init_samples").get<std::int64_t>();
  progress.lr = meta.at("lr").get<double>();
  progress.focal_px = {meta.at("focal_px").at(0).get<double>(),
                       meta.at("focal_px").at(1).get<double>()};
  for (const json& size : meta.at("image_sizes")) {
    progress.image_sizes.insert({size.at(0).get<int>(), size.at(1).get<int>()});
  }
  progress.validated = meta.at("validated").get<std::int64_t>();
  progress.best = BestFromJson(meta.at("best"));
  progress.means = MeansFromJson(meta.at("means"));
  return progress;
}

std::string MomentPrefix(const std::string& moment) { return "optimizer/" + moment + "/"; }

void RestoreMoment(const TensorFile& state, const std::string& prefix, const FlatModule& layout,
                   const at::Tensor& flat, const std::string& path) {
  c10::NoGradGuard no_grad;
  std::map<std::string, at::Tensor> views;
  layout.AddViews(flat, prefix, &views);
  for (auto& [name, view] : views) {
    const auto found = state.tensors.find(name);
    if (found == state.tensors.end() || found->second.sizes() != view.sizes() ||
        found->second.scalar_type() != at::kFloat) {
      throw DataError(
          fmt::format("{}: tensor '{}' is missing or of another shape or type", path, name));
    }
    view.copy_(found->second);
  }
}

}  // namespace

void RunProgress::NoteCameras(const std::vector<Sample>& drawn) {
  for (const Sample& s : drawn) {
    for (double f : {s.intrinsics.fx, s.intrinsics.fy}) {
      focal_px.first = focal_px.first == 0 ? f : std::min(focal_px.first, f);
      focal_px.second = std::max(focal_px.second, f);
    }
  }
  image_sizes.insert({drawn[0].depth.width(), drawn[0].depth.height()});
}

std::string WriteProgress(const RunProgress& progress) { return ToJson(progress).dump(); }

RunProgress ReadProgress(const std::string& text) {
  try {
    return FromJson(json::parse(text));
  } catch (const json::exception& e) {
    throw DataError(fmt::format("not the progress of a run: {}", e.what()));
  }
}

void SaveState(const std::filesystem::path& path, const TrainConfig& config,
               const std::string& data_identity, const Compute& compute, Learner& learner,
               const RunProgress& progress) {
  json meta = ToJson(progress);
  meta["steps"] = learner.optimizer.steps();
  meta["data_identity"] = data_identity;
  meta["bf16"] = compute.type == at::kBFloat16;
  meta["channels_last"] = compute.channels_last;
  meta["config"] = WriteConfig(config);
  learner.average.Refresh(learner.flat);
  TensorFile state{kStateFormat, meta.dump(1), {}};
  AddModuleTensors(*learner.net, "model/", &state.tensors);
  AddModuleTensors(*learner.average.net(), "average/", &state.tensors);
  for (const auto& [name, moment] : learner.optimizer.moments()) {
    learner.flat.AddViews(moment, MomentPrefix(name), &state.tensors);
  }
  WriteTensorFile(path, state);
}

namespace {

SavedState ReadState(const std::filesystem::path& path, const TrainConfig& config,
                     const std::string& data_identity) {
  SavedState saved;
  saved.path = path;
  saved.file = ReadTensorFile(path, kStateFormat);
  try {
    const json meta = json::parse(saved.file.meta);
    const auto yaml = meta.at("config").get<std::string>();
    RequireSameRun(yaml, config, path.string());
    if (meta.at("data_identity").get<std::string>() != data_identity) {
      throw ConfigError(fmt::format(
          "{} was trained on other samples than run.dataset = '{}' gives: resume with the "
          "run's own dataset (config.yaml there names it), or start a new run",
          path.string(), config.run.dataset));
    }
    saved.progress = FromJson(meta);
    saved.steps = meta.at("steps").get<std::int64_t>();
    if (meta.at("bf16").get<bool>()) saved.type = at::kBFloat16;
    saved.channels_last = meta.at("channels_last").get<bool>();
    if (!SameValidation(yaml, config)) saved.progress.best = BestValidation();
  } catch (const json::exception& e) {
    throw DataError(fmt::format("{}: invalid metadata ({})", path.string(), e.what()));
  }
  return saved;
}

}  // namespace

std::optional<SavedState> FindState(const RunFolder& folder, const TrainConfig& config,
                                    const std::string& data_identity,
                                    std::vector<std::string>* damaged) {
  const std::vector<std::int64_t> states = folder.States();
  for (const std::int64_t samples : states) {
    try {
      return ReadState(folder.State(samples), config, data_identity);
    } catch (const DataError& e) {
      if (samples == states.back()) throw;
      damaged->push_back(fmt::format("{}: the state before it is used instead", e.what()));
    }
  }
  return std::nullopt;
}

void Restore(const SavedState& state, Learner* learner) {
  const std::string name = state.path.string();
  const std::map<std::string, at::Tensor>& tensors = state.file.tensors;
  CopyIntoModule(tensors, "model/", *learner->net, name);
  CopyIntoModule(tensors, "average/", *learner->average.net(), name);
  for (const auto& [moment, values] : learner->optimizer.moments()) {
    RestoreMoment(state.file, MomentPrefix(moment), learner->flat, values, name);
  }
  learner->optimizer.set_steps(state.steps);
}

void SaveModel(const std::filesystem::path& path, const TrainConfig& config,
               const Structure& structure, Learner& learner, const RunProgress& progress) {
  learner.average.Refresh(learner.flat);
  CheckpointMeta meta;
  meta.network = learner.average.net()->options();
  meta.structure = structure;
  meta.focal_px = progress.focal_px;
  meta.image_sizes.assign(progress.image_sizes.begin(), progress.image_sizes.end());
  meta.roll_offsets_deg = config.data.pose.roll_offsets_deg;
  meta.samples = progress.init_samples + progress.samples;
  meta.config_yaml = WriteConfig(config);
  SaveCheckpoint(path, learner.average.net(), meta, config.run.half_checkpoint);
}

}  // namespace volalign
