#pragma once

#include <csignal>

namespace volalign {

/// While it lives, SIGINT and SIGTERM end nothing; Interrupted() says that one of them came. One
/// object at a time.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  bool Interrupted() const;

 private:
  struct sigaction old_int_ {
  }, old_term_{};
};

}  // namespace volalign
