#pragma once

#include <functional>
#include <string>
#include <vector>

#include "train/distributed/process_group.h"
#include "train/learner.h"
#include "train/state.h"
#include "train/validation.h"

namespace volalign {

/// Throws ConfigError where so many processes cannot train with this configuration.
void RequireProcesses(const TrainConfig& config, int count);

/// What the processes of a run agree on at its start, as rank 0 says it.
struct SharedRun {
  Compute compute;      ///< its type and layout
  std::string config;   ///< WriteConfig
  std::string dataset;  ///< TrainingData::identity
};

/// `own.compute` with the type and layout of rank 0, which are what `lead` there makes of its own.
/// Throws what `lead` throws, or ConfigError where another process has another configuration (but
/// for keys of the machine) or other samples.
Compute Agree(ProcessGroup& group, const SharedRun& own,
              const std::function<Compute(Compute)>& lead);

/// All processes go on from what rank 0 has.
void ShareState(ProcessGroup& group, Learner* learner, RunProgress* progress);

/// All processes know the cameras that any of them has seen.
void ShareCameras(ProcessGroup& group, RunProgress* progress);

/// The validation of all samples, of which each process has done its slice of each batch.
ValidationResult ShareValidation(ProcessGroup& group, const ValidationResult& own, int batch_size);

}  // namespace volalign
