#pragma once

#include <atomic>

namespace volalign {

/// Thrown by work that was asked to stop. No Error: nothing is wrong, and nobody handles it on its
/// way out.
class Stopped {};

/// While it lives, work on this thread, and on the threads that ParallelFor starts for it, ends
/// with Stopped soon after `asked` becomes true. Scopes nest: the innermost one counts.
class StopScope {
 public:
  explicit StopScope(const std::atomic<bool>* asked);
  ~StopScope();
  StopScope(const StopScope&) = delete;
  StopScope& operator=(const StopScope&) = delete;

  /// What the innermost scope of this thread looks at; null where there is none.
  static const std::atomic<bool>* Current();

 private:
  const std::atomic<bool>* outer_;
};

bool IsStopAsked();

/// Called by work that takes long, several times a second.
void ThrowIfStopped();

}  // namespace volalign
