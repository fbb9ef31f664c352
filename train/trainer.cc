#include "train/trainer.h"

#include <c10/util/Exception.h>
#include <fmt/format.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "train/batch.h"
#include "train/run.h"
#include "train/run_inputs.h"
#include "train/together.h"

namespace volalign {
namespace {

/// Batches that are packed for a CUDA device while an earlier one is in training.
constexpr int kAhead = 2;

[[noreturn]] void NothingToResume(const std::filesystem::path& dir) {
  throw IoError(fmt::format("{}: there is no run to resume here: drop --resume", dir.string()));
}

/// The state to continue, or nothing for a run that starts at its first sample.
std::optional<SavedState> Begin(const RunFolder& folder, const TrainingData& data,
                                const TrainConfig& config, bool resume,
                                std::vector<std::string>* damaged) {
  if (!resume) {
    if (folder.States().empty()) return std::nullopt;
    throw Error(fmt::format("{} holds a run already: use --resume, or another folder",
                            folder.dir().string()));
  }
  RequireSameInputs(folder.dir(), config, data.structure);
  std::optional<SavedState> state = FindState(folder, config, data.identity, damaged);
  if (state) return state;
  // A run that was killed before its first state left only its configuration.
  if (!std::filesystem::exists(folder.config())) NothingToResume(folder.dir());
  RequireSameRun(ReadFile(folder.config(), kMaxTextBytes), config, folder.config().string());
  return std::nullopt;
}

}  // namespace

TrainResult Train(const TrainConfig& config, const TrainOptions& options) {
  const BatchSlice slice =
      options.world.size > 1 ? SliceOf(config.run.batch_size, options.world) : BatchSlice();
  const TrainingData data = OpenTrainingData(config, slice);
  TrainConfig drawn = config;
  drawn.data.renderer = data.renderer;
  return TrainOn(data, drawn, options);
}

TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options) {
  const InterruptGuard guard;
  ValidateConfig(config);
  config.Validate();
  Compute compute = ChooseCompute(config.run, options.world);
  ProcessGroup group;
  if (options.world.size > 1) {
    RequireProcesses(config, options.world.size);
    group.Connect(options.world, compute.device, config.run.lost_after_s);
  }
  std::optional<RunFolder> folder;
  std::optional<SavedState> state;
  std::vector<std::string> damaged;
  compute = Agree(group, {compute, WriteConfig(config), data.identity + data.structure.Hash()},
                  [&](Compute chosen) {
                    if (options.resume && !std::filesystem::exists(options.run_dir)) {
                      NothingToResume(options.run_dir);
                    }
                    folder.emplace(options.run_dir);
                    state = Begin(*folder, data, config, options.resume, &damaged);
                    if (!state) return chosen;
                    chosen.type = state->bf16 ? at::kBFloat16 : at::kFloat;
                    chosen.channels_last = state->channels_last;
                    return chosen;
                  });
  Run run(data, config, compute, group, folder ? &*folder : nullptr, std::move(state), options,
          guard);
  run.Say(ToString(compute));
  if (!data.drawn_by.empty()) run.Say("renderer: " + data.drawn_by);
  if (group.size() > 1) run.Say(fmt::format("{} processes", group.size()));
  for (const std::string& sentence : damaged) run.Say("warning: " + sentence);
  const OptimConfig& optim = config.optim;
  if (optim.DependsOnLength() && optim.warmup_samples >= config.run.samples)
    run.Say(
        fmt::format("optim.warmup_samples = {} is not shorter than run.samples = {}: the "
                    "learning rate does not reach optim.lr",
                    optim.warmup_samples, config.run.samples));
  try {
    if (run.Begin()) {
      const auto next = FeedBatches(data.open_training(run.samples()), compute.device,
                                    compute.device.is_cpu() ? 0 : kAhead);
      while (run.Ready() && run.Advance(next())) {
      }
    }
    return run.End();
  } catch (const c10::OutOfMemoryError&) {
    throw Error(run.OutOfMemory());
  }
}

}  // namespace volalign
