#pragma once

#include <string>

#include "core/base/batch_slice.h"

namespace volalign {

/// The place of a process among those that train one network together.
struct World {
  int rank = 0, size = 1;
  int local_rank = 0;  ///< among the processes of this machine
  /// If LaunchProcesses started all of them on this machine: the file by which they meet. None of
  /// them then listens on an address that other machines reach. Else rank 0 listens.
  std::string store;
  std::string address;  ///< of rank 0
  int port = 0;         ///< on which rank 0 listens
};

inline constexpr char kStoreVariable[] = "VOLALIGN_STORE";

/// Reads torchrun's variables RANK, WORLD_SIZE, LOCAL_RANK, MASTER_ADDR and MASTER_PORT; a single
/// process if WORLD_SIZE is not set. The agent of torchrun itself listens on MASTER_PORT, so its
/// processes take the next port. VOLALIGN_PORT names another one. Processes of LaunchProcesses have
/// VOLALIGN_STORE instead of an address and a port. Throws ConfigError for a variable that is
/// missing or no number in its range.
World ReadWorld();

/// The samples of each batch for the process `rank` of `size`. Throws ConfigError if there are more
/// processes than samples.
BatchSlice SliceOf(int batch_size, int rank, int size);

}  // namespace volalign
