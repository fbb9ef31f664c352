#pragma once

#include <functional>
#include <string>
#include <vector>

#include "train/distributed/process_group.h"
#include "train/saved_state.h"
#include "train/train_state.h"
#include "train/validation.h"

namespace volalign {

/// Throws ConfigError if so many processes cannot train with this configuration.
void RequireProcesses(const TrainConfig& config, int count);

/// The common choices of the processes of a run at its start. Rank 0 decides.
struct SharedRun {
  Compute compute;      ///< its type and layout
  std::string config;   ///< WriteConfig
  std::string dataset;  ///< TrainingData::identity
};

/// `own.compute` with the type and layout of rank 0, which `lead` derives there from its own.
/// Throws exceptions of `lead`. Throws ConfigError if another process has another configuration
/// (except for keys of the machine) or other samples.
Compute AgreeOnCompute(ProcessGroup& group, const SharedRun& own,
                       const std::function<Compute(Compute)>& lead);

/// Copies the weights and progress of rank 0 to all processes.
void BroadcastState(ProcessGroup& group, TrainState* state, RunProgress* progress);

/// Gives all processes the cameras that any of them has seen.
void ReduceSeenIntrinsics(ProcessGroup& group, RunProgress* progress);

/// The validation of all samples, from each process's slice of each batch.
ValidationResult MergeValidation(ProcessGroup& group, const ValidationResult& own, int batch_size);

}  // namespace volalign
