#pragma once

#include <atomic>

namespace volalign {

/// Thrown by work that was asked to stop. It is no Error: nothing is wrong, and nothing between
/// handles it.
class Stopped {};

/// While it lives, work on this thread, and on the threads that ParallelFor starts for it, ends
/// with Stopped soon after `asked` becomes true. Scopes may be nested: the innermost one counts.
class StopScope {
 public:
  explicit StopScope(const std::atomic<bool>* asked);
  ~StopScope();
  StopScope(const StopScope&) = delete;
  StopScope& operator=(const StopScope&) = delete;

  /// The flag of this thread's innermost scope; null if there is none.
  static const std::atomic<bool>* Current();

 private:
  const std::atomic<bool>* outer_;
};

bool IsStopAsked();

/// Throws Stopped if the innermost scope asks for it. Long work calls it several times per second.
void ThrowIfStopped();

}  // namespace volalign
