#include "train/state.h"

#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "core/checkpoint.h"
#include "core/error.h"
#include "train/same_run.h"

namespace volalign {
namespace {

using nlohmann::json;

json ToJson(const RunProgress& progress) {
  json sizes = json::array();
  for (const auto& [width, height] : progress.image_sizes) sizes.push_back({width, height});
  return {{"samples", progress.samples},
          {"init_samples", progress.init_samples},
          {"lr", progress.lr},
          {"focal_px", {progress.focal_px.first, progress.focal_px.second}},
          {"image_sizes", sizes}};
}

RunProgress FromJson(const json& meta) {
  RunProgress progress;
  progress.samples = meta.at("samples").get<std::int64_t>();
  progress.init_samples = meta.value("init_samples", std::int64_t{0});
  progress.lr = meta.at("lr").get<double>();
  progress.focal_px = {meta.at("focal_px").at(0).get<double>(),
                       meta.at("focal_px").at(1).get<double>()};
  for (const json& size : meta.at("image_sizes")) {
    progress.image_sizes.insert({size.at(0).get<int>(), size.at(1).get<int>()});
  }
  return progress;
}

void RestoreMoments(const TensorFile& state, const std::string& prefix, const FlatModule& layout,
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

void SaveState(const std::filesystem::path& path, const TrainConfig& config,
               const std::string& data_identity, Learner& learner, const RunProgress& progress) {
  json meta = ToJson(progress);
  meta["steps"] = learner.optimizer.steps();
  meta["data_identity"] = data_identity;
  meta["config"] = WriteConfig(config);
  learner.average.Refresh(learner.flat);
  TensorFile state{kStateFormat, meta.dump(1), {}};
  AddModuleTensors(*learner.net, "model/", &state.tensors);
  AddModuleTensors(*learner.average.net(), "average/", &state.tensors);
  learner.flat.AddViews(learner.optimizer.mean(), "adam_mean/", &state.tensors);
  learner.flat.AddViews(learner.optimizer.square(), "adam_square/", &state.tensors);
  WriteTensorFile(path, state);
}

RunProgress LoadState(const std::filesystem::path& path, const TrainConfig& config,
                      const std::string& data_identity, Learner* learner) {
  const std::string name = path.string();
  const TensorFile state = ReadTensorFile(path, kStateFormat);
  RunProgress progress;
  try {
    const json meta = json::parse(state.meta);
    RequireSameRun(meta.at("config").get<std::string>(), config, name);
    if (meta.value("data_identity", std::string()) != data_identity) {
      throw ConfigError(fmt::format(
          "{} was trained on other samples than run.dataset = '{}' gives: resume with the "
          "run's own dataset (config.yaml there names it), or start a new run",
          name, config.run.dataset));
    }
    progress = FromJson(meta);
    learner->optimizer.set_steps(meta.at("steps").get<std::int64_t>());
  } catch (const json::exception& e) {
    throw DataError(fmt::format("{}: invalid metadata ({})", name, e.what()));
  }
  CopyIntoModule(state.tensors, "model/", *learner->net, name);
  CopyIntoModule(state.tensors, "average/", *learner->average.net(), name);
  RestoreMoments(state, "adam_mean/", learner->flat, learner->optimizer.mean(), name);
  RestoreMoments(state, "adam_square/", learner->flat, learner->optimizer.square(), name);
  return progress;
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
