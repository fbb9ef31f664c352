#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "train/distributed/world.h"

namespace volalign {

/// Another process is gone, or does not answer any more.
class LostProcess : public Error {
 public:
  using Error::Error;
};

/// The processes that train one network together, which exchange tensors over sockets (LibTorch's
/// c10d: Gloo for tensors in memory, NCCL for those on CUDA devices where the build has it). All of
/// them call the same functions in the same order. Every function throws LostProcess, which names
/// the processes that do not answer.
class ProcessGroup {
 public:
  /// A process alone, for which nothing is to be done.
  ProcessGroup();
  /// Joins the others, for which it waits. A process that is not heard of for `timeout_s` seconds
  /// counts as lost. Throws IoError where they do not meet, ConfigError where this build has no
  /// c10d.
  void Connect(const World& world, const at::Device& device, double timeout_s);
  ~ProcessGroup();
  ProcessGroup(const ProcessGroup&) = delete;
  ProcessGroup& operator=(const ProcessGroup&) = delete;

  /// Whether this build has c10d.
  static bool IsBuilt();

  int rank() const { return rank_; }
  int size() const { return size_; }
  bool leads() const { return rank_ == 0; }

  /// The sum over the processes, in place, the same bits everywhere. Contiguous tensors.
  void Sum(const at::Tensor& tensor);
  /// The tensor of rank 0, in place. Contiguous tensors.
  void Broadcast(const at::Tensor& tensor);
  /// What each process gave, by rank.
  std::vector<std::string> Gather(const std::string& own);
  /// What `make` returns in rank 0, where alone it is called. Where it throws, all processes do:
  /// rank 0 what it threw, the others an Error with its message.
  std::string FromLead(const std::function<std::string()>& make);

 private:
  struct Connection;
  int rank_ = 0, size_ = 1;
  std::unique_ptr<Connection> connection_;
};

}  // namespace volalign
