#include "train/data_parallel.h"

#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/config/config.h"

namespace volalign {
namespace {

using nlohmann::json;

/// Keys in which the processes of a run may differ.
const std::set<std::string>& PerMachineKeys() {
  static const std::set<std::string> keys = {
      "run.device",   "run.threads", "run.loader_threads", "run.dataset", "run.validation_dataset",
      "data.renderer"};
  return keys;
}

void RequireSame(const SharedRun& own, const std::string& config, const std::string& dataset,
                 int rank) {
  for (const auto& [key, lead, here] : FindDifferences(config, own.config)) {
    if (PerMachineKeys().count(key) > 0) continue;
    throw ConfigError(fmt::format(
        "rank {} has {} = {}, and rank 0 {}: start all processes with the same configuration", rank,
        key, here, lead));
  }
  if (dataset != own.dataset) {
    throw ConfigError(fmt::format(
        "rank {} reads another dataset than rank 0: run.dataset has to name the same samples",
        rank));
  }
}

/// As CBOR, which, unlike JSON text, has numbers that are not finite.
std::string Pack(const ValidationResult& own) {
  json scores = json::array();
  for (const SampleScore& s : own.scores) {
    scores.push_back(json::array({s.sensor, s.rho_m, s.metrics}));
  }
  const auto bytes =
      json::to_cbor({{"means", own.means}, {"samples", own.samples}, {"scores", scores}});
  return {bytes.begin(), bytes.end()};
}

SampleScore ScoreOf(const json& s) { return {s[0], s[1], s[2]}; }

void Broadcast(ProcessGroup& group, const torch::nn::Module& module) {
  for (const at::Tensor& t : module.parameters()) group.Broadcast(t.detach());
  for (const at::Tensor& t : module.buffers()) group.Broadcast(t);
}

}  // namespace

void RequireProcesses(const TrainConfig& config, int count) {
  SliceOf(config.run.batch_size, 0, count);
  if (!ProcessGroup::IsBuilt()) ProcessGroup().Connect(World(), at::kCPU, 0);
  if (config.model.normalization != Normalization::kBatch) return;
  throw ConfigError(fmt::format(
      "model.normalization = batch in {} processes would normalise with the statistics of each "
      "process's slice: use group or none, or one process",
      count));
}

Compute AgreeOnCompute(ProcessGroup& group, const SharedRun& own,
                       const std::function<Compute(Compute)>& lead) {
  const std::string said = group.BroadcastFromRankZero([&] {
    const Compute chosen = lead(own.compute);
    return json{{"config", own.config},
                {"dataset", own.dataset},
                {"bf16", chosen.type == at::kBFloat16},
                {"channels_last", chosen.channels_last}}
        .dump();
  });
  const json agreed = json::parse(said);
  RequireSame(own, agreed.at("config").get<std::string>(), agreed.at("dataset").get<std::string>(),
              group.rank());
  Compute compute = own.compute;
  compute.type = agreed.at("bf16").get<bool>() ? at::kBFloat16 : at::kFloat;
  compute.channels_last = agreed.at("channels_last").get<bool>();
  return compute;
}

void BroadcastState(ProcessGroup& group, TrainState* state, RunProgress* progress) {
  if (group.size() == 1) return;
  c10::NoGradGuard no_grad;
  *progress = ReadProgress(group.BroadcastFromRankZero([&] { return WriteProgress(*progress); }));
  state->optimizer.set_steps(std::stoll(
      group.BroadcastFromRankZero([&] { return std::to_string(state->optimizer.steps()); })));
  Broadcast(group, *state->net);
  Broadcast(group, *state->average.net());
  for (const auto& [name, moment] : state->optimizer.moments()) group.Broadcast(moment);
}

void ReduceSeenIntrinsics(ProcessGroup& group, RunProgress* progress) {
  if (group.size() == 1) return;
  std::pair<double, double> focal_px{0, 0};
  for (const std::string& bytes : group.Gather(WriteProgress(*progress))) {
    const RunProgress other = ReadProgress(bytes);
    progress->image_sizes.insert(other.image_sizes.begin(), other.image_sizes.end());
    if (other.focal_px.first == 0) continue;
    focal_px.first =
        focal_px.first == 0 ? other.focal_px.first : std::min(focal_px.first, other.focal_px.first);
    focal_px.second = std::max(focal_px.second, other.focal_px.second);
  }
  progress->focal_px = focal_px;
}

ValidationResult MergeValidation(ProcessGroup& group, const ValidationResult& own, int batch_size) {
  if (group.size() == 1) return own;
  std::vector<json> slices;
  std::map<std::string, double> sums;
  for (const std::string& bytes : group.Gather(Pack(own))) {
    const json slice = json::from_cbor(bytes);
    for (const auto& mean : slice.at("means").items())
      sums[mean.key()] += mean.value().get<double>() * slice.at("samples").get<double>();
    slices.push_back(slice.at("scores"));
  }
  std::vector<SampleScore> scores;
  std::vector<std::size_t> taken(slices.size(), 0);
  while (taken[0] < slices[0].size()) {
    for (int rank = 0; rank < group.size(); ++rank) {
      const auto r = static_cast<std::size_t>(rank);
      for (int i = SliceOf(batch_size, rank, group.size()).count; i > 0; --i)
        scores.push_back(ScoreOf(slices[r].at(taken[r]++)));
    }
  }
  ValidationResult result = Summarise(scores);
  // The scores have all but the terms of the loss.
  for (const auto& [name, sum] : sums) result.means.emplace(name, sum / result.samples);
  result.scores = std::move(scores);
  result.examples = own.examples;
  return result;
}

}  // namespace volalign
