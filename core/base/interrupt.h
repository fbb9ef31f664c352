#pragma once

#include <csignal>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

namespace volalign {

/// While it lives, SIGINT and SIGTERM end nothing and are noted, and children can be waited for
/// even where this process was started with SIGCHLD ignored. One made while another lives notes
/// the same signals as that one. For one thread.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  /// Which of them came last since the outermost guard began; 0: none.
  int Signal() const;
  /// The same, and forgets it.
  int Take();

 private:
  struct sigaction old_int_ {
  }, old_term_{}, old_child_{};
};

/// The status with which a program ends on a signal, as a shell gives it.
constexpr int StatusOfSignal(int number) { return 128 + number; }

/// From now on SIGINT and SIGTERM end the program wherever no InterruptGuard lives: with a sentence
/// on stderr, without its Unfinished files and folders, with StatusOfSignal. One that is ignored
/// stays so. Where the system gives no thread for it, signals do what they do by themselves. An
/// exception that nothing can catch ends the program likewise, with status 1. For main, before it
/// begins.
void EndOnInterrupt();

/// What EndOnInterrupt says behind an exception that nothing can catch: what a library's threads
/// are at, and what may be wrong there. Stays from now on.
void ExplainUncaught(const std::string& sentence);

/// EndOnInterrupt waits while the lock is held: for steps that belong together and take no time.
std::unique_lock<std::mutex> HoldInterrupts();

/// A file or folder that is being written: removed with the object, and by EndOnInterrupt, unless
/// it is complete.
class Unfinished {
 public:
  /// `create` makes it and returns its path.
  explicit Unfinished(const std::function<std::filesystem::path()>& create);
  ~Unfinished();
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void Complete();

 private:
  std::filesystem::path path_;
  bool complete_ = false;
};

}  // namespace volalign
