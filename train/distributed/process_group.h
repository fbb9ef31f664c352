#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "train/distributed/world.h"

namespace volalign {

/// Another process has ended, or does not answer.
class LostProcess : public Error {
 public:
  using Error::Error;
};

/// The processes that train one network together. They exchange tensors over sockets by LibTorch's
/// c10d: Gloo for tensors in memory, NCCL for those on CUDA devices if the build has it. All
/// processes call the same functions in the same order. Every function throws LostProcess if
/// another process does not answer.
class ProcessGroup {
 public:
  /// A single process, for which all functions do nothing.
  ProcessGroup();
  /// Joins the others and waits for them. A process that is silent for `timeout_s` seconds counts
  /// as lost. Throws IoError if they do not meet, ConfigError if this build has no c10d.
  void Connect(const World& world, const at::Device& device, double timeout_s);
  ~ProcessGroup();
  ProcessGroup(const ProcessGroup&) = delete;
  ProcessGroup& operator=(const ProcessGroup&) = delete;

  /// Has this build c10d?
  static bool IsBuilt();

  int rank() const { return rank_; }
  int size() const { return size_; }
  bool leads() const { return rank_ == 0; }

  /// Replaces a contiguous tensor by its sum over the processes, with the same bits everywhere.
  void Sum(const at::Tensor& tensor);
  /// Replaces a contiguous tensor by that of rank 0.
  void Broadcast(const at::Tensor& tensor);
  /// The argument of each process, by rank.
  std::vector<std::string> Gather(const std::string& own);
  /// The result of `make`, which only rank 0 calls. If it throws, all processes do: rank 0 the same
  /// exception, the others an Error with its message.
  std::string BroadcastFromRankZero(const std::function<std::string()>& make);

 private:
  struct Connection;
  int rank_ = 0, size_ = 1;
  std::unique_ptr<Connection> connection_;
};

/// This machine's numeric address on the way to rank 0, at which other machines reach it. Throws
/// IoError if rank 0's name has no address or no route leads there.
std::string AddressTowards(const World& world);

}  // namespace volalign
