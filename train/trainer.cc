#include "train/trainer.h"

#include <c10/util/Exception.h>
#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "train/batch_feed.h"
#include "train/run.h"
#include "train/run_inputs.h"
#include "train/same_run.h"
#include "train/together.h"

namespace volalign {
namespace {

[[noreturn]] void NothingToResume(const std::filesystem::path& dir) {
  throw IoError(fmt::format("{}: there is no run to resume here: drop --resume", dir.string()));
}

/// The state to continue, or none for a run that starts at its first sample.
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
  // A run that was killed before its first state left its configuration alone.
  if (!std::filesystem::exists(folder.config())) NothingToResume(folder.dir());
  RequireSameRun(ReadFile(folder.config(), kMaxTextBytes), config, folder.config().string());
  return std::nullopt;
}

/// A run, and what it stands on.
class OpenRun {
 public:
  OpenRun(const TrainingData& data, const TrainConfig& config, const TrainOptions& options,
          const InterruptGuard& guard) {
    ValidateConfig(config);
    config.Validate();
    compute_ = ChooseCompute(config.run, options.world);
    if (options.world.size > 1) {
      RequireProcesses(config, options.world.size);
      group_.Connect(options.world, compute_.device, config.run.lost_after_s);
    }
    std::optional<SavedState> state;
    std::vector<std::string> damaged;
    compute_ = Agree(group_, {compute_, WriteConfig(config), data.identity + data.structure.Hash()},
                     [&](Compute chosen) {
                       if (options.resume && !std::filesystem::exists(options.run_dir)) {
                         NothingToResume(options.run_dir);
                       }
                       folder_.emplace(options.run_dir);
                       state = Begin(*folder_, data, config, options.resume, &damaged);
                       if (!state) return chosen;
                       chosen.type = state->type;
                       chosen.channels_last = state->channels_last;
                       return chosen;
                     });
    run_.emplace(data, config, compute_, group_, folder_ ? &*folder_ : nullptr, std::move(state),
                 options, guard);
    run_->Say(ToString(compute_));
    if (!data.drawn_by.empty()) run_->Say("renderer: " + data.drawn_by);
    if (group_.size() > 1) run_->Say(fmt::format("{} processes", group_.size()));
    for (const std::string& sentence : damaged) run_->Say("warning: " + sentence);
    const OptimConfig& optim = config.optim;
    if (optim.DependsOnLength() && optim.warmup_samples >= config.run.samples)
      run_->Say(
          fmt::format("optim.warmup_samples = {} is not shorter than run.samples = {}: the "
                      "learning rate does not reach optim.lr",
                      optim.warmup_samples, config.run.samples));
  }

  Run& run() { return *run_; }
  const at::Device& device() const { return compute_.device; }

 private:
  Compute compute_;
  ProcessGroup group_;
  std::optional<RunFolder> folder_;
  std::optional<Run> run_;
};

/// A job at work.
struct Worker {
  std::unique_ptr<OpenRun> open;
  JobResult* to;
};

/// Trains all on the same batches. `failed`, called while an Error is handled, may rethrow it.
class Feeding {
 public:
  Feeding(const TrainingData& data, std::vector<Worker> workers, int batch_size,
          std::function<void(JobResult*, const Error&)> failed)
      : data_(data),
        workers_(std::move(workers)),
        batch_size_(batch_size),
        failed_(std::move(failed)) {}

  void Train() {
    Keep([](Run& run) { return run.Begin(); });
    std::unique_ptr<BatchFeed> feed;
    std::int64_t next = 0;  // sample of the feed
    while (Keep([](Run& run) { return run.Ready(); })) {
      std::int64_t first = workers_[0].open->run().samples();
      for (const Worker& w : workers_) first = std::min(first, w.open->run().samples());
      std::optional<FedBatch> fed;
      Attempt(nullptr, [&] {
        if (!feed || next != first) {
          feed.reset();
          const at::Device& device = workers_[0].open->device();
          feed = std::make_unique<BatchFeed>(data_.open_training(first), device,
                                             device.is_cpu() ? 0 : BatchFeed::kAhead);
        }
        fed = feed->Next();
        return true;
      });
      if (!fed) return;
      next = first + batch_size_;
      Keep([&](Run& run) { return run.samples() != first || run.Advance(*fed); });
    }
  }

 private:
  /// f(), or false where it throws: an Error of one run, or where there is none, of all.
  bool Attempt(JobResult* of, const std::function<bool()>& f) {
    try {
      try {
        return f();
      } catch (const c10::OutOfMemoryError&) {
        const auto it = std::find_if(workers_.begin(), workers_.end(),
                                     [&](const Worker& w) { return of == nullptr || w.to == of; });
        throw Error(it->open->run().OutOfMemory());
      }
    } catch (const Error& e) {
      if (of != nullptr) {
        failed_(of, e);
      } else {
        for (const Worker& w : workers_) failed_(w.to, e);
      }
      return false;
    }
  }

  /// Ends the runs for which `goes_on` is false. Whether any is left.
  bool Keep(const std::function<bool(Run&)>& goes_on) {
    std::vector<Worker> kept;
    for (Worker& w : workers_) {
      Run& run = w.open->run();
      bool ended = false;
      const bool stays = Attempt(w.to, [&] {
        if (goes_on(run)) return true;
        ended = true;
        return false;
      });
      if (stays) {
        kept.push_back(std::move(w));
      } else if (ended) {
        Attempt(w.to, [&] {
          w.to->result = run.End();
          return true;
        });
      }
    }
    workers_ = std::move(kept);
    return !workers_.empty();
  }

  const TrainingData& data_;
  std::vector<Worker> workers_;
  int batch_size_;
  std::function<void(JobResult*, const Error&)> failed_;
};

/// Keys that say which batches there are, and where.
const std::set<std::string>& KeysOfTheBatches() {
  static const std::set<std::string> keys = {"run.batch_size", "run.seed",    "run.dataset",
                                             "run.device",     "run.threads", "run.loader_threads",
                                             "run.prefetch"};
  return keys;
}

std::map<std::string, std::vector<std::string>> Batches(const TrainConfig& config) {
  std::map<std::string, std::vector<std::string>> values;
  const ConfigSource source = ConfigSource::FromString(WriteConfig(config), "a configuration");
  for (const auto& [key, leaf] : source.leaves()) {
    if (key.rfind("data.", 0) == 0 || KeysOfTheBatches().count(key) > 0) values[key] = leaf.values;
  }
  return values;
}

/// The samples of a job, and what it is called with them.
struct OwnData {
  TrainingData data;
  TrainConfig config;
};

std::vector<JobResult> TrainJobs(const std::vector<TrainJob>& jobs,
                                 const std::function<OwnData(const TrainConfig&)>& open) {
  const InterruptGuard guard;
  std::vector<JobResult> results(jobs.size());
  const auto failed = [](JobResult* of, const Error& e) { of->failure = e.what(); };
  std::deque<OwnData> own;
  std::vector<Worker> workers;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    try {
      const OwnData& o = own.emplace_back(open(jobs[i].config));
      workers.push_back(
          {std::make_unique<OpenRun>(o.data, o.config, jobs[i].options, guard), &results[i]});
    } catch (const Error& e) {
      failed(&results[i], e);
    }
  }
  if (workers.empty()) return results;
  Feeding(own[0].data, std::move(workers), jobs[0].config.run.batch_size, failed).Train();
  return results;
}

OwnData OpenOwnData(const TrainConfig& config, const BatchSlice& slice = {}) {
  OwnData own{OpenTrainingData(config, slice), config};
  own.config.data.renderer = own.data.renderer;
  return own;
}

}  // namespace

TrainResult Train(const TrainConfig& config, const TrainOptions& options) {
  const BatchSlice slice =
      options.world.size > 1 ? SliceOf(config.run.batch_size, options.world) : BatchSlice();
  const OwnData own = OpenOwnData(config, slice);
  return TrainOn(own.data, own.config, options);
}

TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options) {
  const InterruptGuard guard;
  JobResult result;
  std::vector<Worker> worker;
  worker.push_back({std::make_unique<OpenRun>(data, config, options, guard), &result});
  Feeding(data, std::move(worker), config.run.batch_size, [](JobResult*, const Error&) {
    throw;
  }).Train();
  return result.result;
}

bool ShareSamples(const TrainConfig& a, const TrainConfig& b) { return Batches(a) == Batches(b); }

std::vector<JobResult> TrainSideBySide(const std::vector<TrainJob>& jobs) {
  return TrainJobs(jobs, [](const TrainConfig& config) { return OpenOwnData(config); });
}

std::vector<JobResult> TrainSideBySideOn(const TrainingData& data,
                                         const std::vector<TrainJob>& jobs) {
  return TrainJobs(jobs, [&](const TrainConfig& config) { return OwnData{data, config}; });
}

}  // namespace volalign
