#pragma once

#include <csignal>

namespace volalign {

/// While it lives, SIGINT and SIGTERM end nothing, and children can be waited for even where this
/// process was started with SIGCHLD ignored. One object at a time.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  /// Whether one of them came.
  bool Interrupted() const;
  /// Which of them came since the last call, the last one; 0: none.
  int Take();

 private:
  struct sigaction old_int_ {
  }, old_term_{}, old_child_{};
};

}  // namespace volalign
