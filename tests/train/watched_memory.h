#pragma once

#include <c10/core/CPUAllocator.h>
#include <torch/version.h>

#include <cstddef>
#include <functional>
#include <utility>

namespace volalign {

/// While it lives, LibTorch's memory on the CPU is asked for through it: `before` is told of the
/// number of bytes, and may throw.
class WatchedMemory : public at::Allocator {
 public:
  explicit WatchedMemory(std::function<void(std::size_t)> before)
      : before_(std::move(before)), real_(c10::GetCPUAllocator()) {
    c10::SetCPUAllocator(this);
  }
  ~WatchedMemory() override { c10::SetCPUAllocator(real_); }
  WatchedMemory(const WatchedMemory&) = delete;
  WatchedMemory& operator=(const WatchedMemory&) = delete;
#if TORCH_VERSION_MAJOR * 100 + TORCH_VERSION_MINOR >= 203
  at::DataPtr allocate(std::size_t bytes) override { return Allocate(bytes); }
  void copy_data(void* to, const void* from, std::size_t bytes) const override {
    real_->copy_data(to, from, bytes);
  }
#else
  at::DataPtr allocate(std::size_t bytes) const override { return Allocate(bytes); }
#endif
  at::DeleterFnPtr raw_deleter() const override { return real_->raw_deleter(); }

 private:
  at::DataPtr Allocate(std::size_t bytes) const {
    before_(bytes);
    return real_->allocate(bytes);
  }

  std::function<void(std::size_t)> before_;
  at::Allocator* real_;
};

}  // namespace volalign
