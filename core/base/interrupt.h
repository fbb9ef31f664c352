#pragma once

#include <csignal>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

namespace volalign {

/// While it lives, SIGINT and SIGTERM are only noted. Children can be waited for even if this
/// process was started with SIGCHLD ignored. Nested guards note the same signals. For one thread.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  /// The last of these signals since the outermost guard began; 0: none.
  int Signal() const;
  /// The same, and forgets it.
  int Take();

 private:
  struct sigaction old_int_ {
  }, old_term_{}, old_child_{};
};

/// The status with which a program ends on a signal, as a shell gives it.
constexpr int StatusOfSignal(int number) { return 128 + number; }

/// From now on SIGINT and SIGTERM end the program, unless an InterruptGuard lives. It writes a
/// sentence to stderr, removes its TemporaryPath files and folders, and ends with StatusOfSignal. A
/// signal that is ignored stays so. If the system gives no thread for it, signals have their
/// default effect. An exception that nothing can catch ends the program likewise, with status 1.
/// For main, before other work.
void EndOnInterrupt();

/// A sentence that EndOnInterrupt adds to an exception that nothing can catch: the work of a
/// library's threads, and what may be wrong there. Valid from now on.
void ExplainUncaught(const std::string& sentence);

/// EndOnInterrupt waits for this lock. For short steps that belong together.
std::unique_lock<std::mutex> HoldInterrupts();

/// A file or folder that is being written. The object and EndOnInterrupt remove it unless it is
/// complete.
class TemporaryPath {
 public:
  /// `create` makes it and returns its path.
  explicit TemporaryPath(const std::function<std::filesystem::path()>& create);
  ~TemporaryPath();
  TemporaryPath(const TemporaryPath&) = delete;
  TemporaryPath& operator=(const TemporaryPath&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void Complete();

 private:
  std::filesystem::path path_;
  bool complete_ = false;
};

}  // namespace volalign
