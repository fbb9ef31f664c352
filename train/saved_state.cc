#include "train/saved_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/config/config.h"
#include "core/json/json_archive.h"

namespace volalign {

template <class Archive>
void Describe(Archive& ar, BestValidation& best) {
  ar("samples", best.samples);
  ar("value", best.value);
}

template <class Archive>
void Describe(Archive& ar, StepMeans& means) {
  StepReport& sum = means.sum;
  StepTimes& t = sum.times;
  ar("steps", sum.steps);
  ar("samples", means.samples);
  ar("loss", sum.loss);
  ar("loss_seg", sum.terms["loss_seg"]);
  ar("loss_3d", sum.terms["loss_3d"]);
  ar("degenerate", sum.degenerate_samples);
  ar("gradient_norm", sum.gradient_norm);
  Eigen::Matrix<double, 5, 1> times;
  times << t.data, t.forward, t.loss, t.backward, t.optim;
  ar("times", times);
  ar.OptionalSinceVersion("skipped", sum.skipped);
  std::map<std::string, double> own = sum.terms;  // terms of loss.terms
  own.erase("loss_seg");
  own.erase("loss_3d");
  ar.Optional("terms", own);
  sum.terms.insert(own.begin(), own.end());
  t = {times[0], times[1], times[2], times[3], times[4]};
}

template <class Archive>
void Describe(Archive& ar, RunProgress& progress) {
  ar("samples", progress.samples);
  ar("init_samples", progress.init_samples);
  ar("lr", progress.lr);
  ar("focal_px", progress.focal_px);
  std::vector<std::pair<int, int>> sizes(progress.image_sizes.begin(), progress.image_sizes.end());
  ar("image_sizes", sizes);
  progress.image_sizes = {sizes.begin(), sizes.end()};
  ar("validated", progress.validated);
  ar("best", progress.best);
  ar("means", progress.means);
}

template <class Archive>
void Describe(Archive& ar, StateMeta& meta) {
  Describe(ar, meta.progress);
  ar("steps", meta.steps);
  ar("data_identity", meta.data_identity);
  ar("bf16", meta.bf16);
  ar("channels_last", meta.channels_last);
  ar("config", meta.config);
}

namespace {

/// Keys that may differ if a run is resumed. They change no sample and no step, with two
/// exceptions. run.threads and run.device change the rounding of a step's sums. So does
/// data.renderer, which also changes few pixels at edges. RequireSameInputs compares the contents
/// of data.structure and data.intrinsics.
const std::set<std::string>& ResumableKeys() {
  static const std::set<std::string> keys = {"data.real.validation", "data.renderer",
                                             "data.structure",       "data.intrinsics",
                                             "run.samples",          "run.validation_samples",
                                             "run.validate_every",   "run.checkpoint_every",
                                             "run.tensorboard",      "run.log_every",
                                             "run.threads",          "run.loader_threads",
                                             "run.device",           "run.lost_after_s",
                                             "run.dataset",          "run.validation_dataset"};
  return keys;
}

std::string MomentPrefix(const std::string& moment) { return "optimizer/" + moment + "/"; }

}  // namespace

void RunProgress::NoteCameras(const std::vector<Intrinsics>& cameras) {
  for (const Intrinsics& camera : cameras) {
    for (double f : {camera.fx, camera.fy}) {
      focal_px.first = focal_px.first == 0 ? f : std::min(focal_px.first, f);
      focal_px.second = std::max(focal_px.second, f);
    }
  }
  image_sizes.insert({cameras[0].width, cameras[0].height});
}

std::string WriteProgress(const RunProgress& progress) {
  return WriteDescribed(progress, "progress", -1);
}

RunProgress ReadProgress(const std::string& text) {
  return ReadDescribed<RunProgress>(text, "progress");
}

void SaveState(const std::filesystem::path& path, const TrainConfig& config,
               const std::string& data_identity, const Compute& compute, TrainState& state,
               const RunProgress& progress) {
  const StateMeta meta{progress,
                       state.optimizer.steps(),
                       data_identity,
                       compute.type == at::kBFloat16,
                       compute.channels_last,
                       WriteConfig(config)};
  state.average.Refresh(state.flat);
  TensorFile file{kStateFormat, WriteDescribed(meta, path.string(), 1), {}};
  AddModuleTensors(*state.net, "model/", &file.tensors);
  AddModuleTensors(*state.average.net(), "average/", &file.tensors);
  for (const auto& [name, moment] : state.optimizer.moments()) {
    state.flat.AddViews(moment, MomentPrefix(name), &file.tensors);
  }
  WriteTensorFile(path, file);
}

void RequireSameRun(const std::string& saved_yaml, const TrainConfig& config,
                    const std::string& path) {
  // A key that is newer than the state had the effect of its default.
  const std::string before = WriteConfig(ReadSavedConfig(saved_yaml, path));
  for (const auto& [key, was, is] : FindDifferences(before, WriteConfig(config))) {
    if (key == "run.samples" && config.optim.DependsOnLength()) {
      throw ConfigError(fmt::format(
          "run.samples = {} differs from {} in {}: with this optim.schedule the learning rate "
          "depends on it, and would jump: resume with the run's own, or start a new run from its "
          "weights with run.init",
          is, was, path));
    }
    if (ResumableKeys().count(key) > 0) continue;
    throw ConfigError(fmt::format(
        "{} = {} differs from {} in {}: resume with the run's own config.yaml, or start a new run",
        key, is, was, path));
  }
}

bool SameValidation(const std::string& saved_yaml, const TrainConfig& config) {
  const TrainConfig before = ReadSavedConfig(saved_yaml, "the saved configuration");
  return before.run.validation_samples == config.run.validation_samples &&
         before.run.validation_dataset == config.run.validation_dataset &&
         before.data.real.validation == config.data.real.validation;
}

namespace {

SavedState ReadState(const std::filesystem::path& path, const TrainConfig& config,
                     const std::string& data_identity) {
  TensorFile file = ReadTensorFile(path, kStateFormat);
  SavedState saved{ReadDescribed<StateMeta>(file.meta, path.string()), path, std::move(file)};
  RequireSameRun(saved.config, config, path.string());
  if (saved.data_identity != data_identity) {
    throw ConfigError(fmt::format(
        "{} was trained on other samples than run.dataset = '{}' and data.real give: resume with "
        "the run's own (config.yaml there names them), or start a new run",
        path.string(), config.run.dataset));
  }
  if (!SameValidation(saved.config, config)) saved.progress.best = BestValidation();
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

void Restore(const SavedState& saved, TrainState* state) {
  const std::string name = saved.path.string();
  const std::map<std::string, at::Tensor>& tensors = saved.file.tensors;
  CopyIntoModule(tensors, "model/", *state->net, name);
  CopyIntoModule(tensors, "average/", *state->average.net(), name);
  for (const auto& [moment, values] : state->optimizer.moments()) {
    std::map<std::string, at::Tensor> views;
    state->flat.AddViews(values, MomentPrefix(moment), &views);
    CopyTensors(tensors, MomentPrefix(moment), views, name);
  }
  state->optimizer.set_steps(saved.steps);
}

void SaveModel(const std::filesystem::path& path, const TrainConfig& config,
               const TrainingData& data, TrainState& state, const RunProgress& progress) {
  state.average.Refresh(state.flat);
  CheckpointMeta meta;
  meta.network = state.average.net()->options();
  meta.structure = data.structure;
  meta.intrinsics = data.intrinsics;
  meta.renderer = data.drawn_by;
  meta.focal_px = progress.focal_px;
  meta.image_sizes.assign(progress.image_sizes.begin(), progress.image_sizes.end());
  meta.roll_offsets_deg = config.data.pose.roll_offsets_deg;
  meta.samples = progress.init_samples + progress.samples;
  meta.config_yaml = WriteConfig(config);
  SaveCheckpoint(path, state.average.net(), meta, /*half=*/true);
}

}  // namespace volalign
