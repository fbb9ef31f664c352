#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace volalign {

/// Receives the progress of work of known size: `done` of `total` parts, first at the beginning.
/// Called by one thread at a time.
using CountDone = std::function<void(std::int64_t done, std::int64_t total)>;

/// A rounded duration in words: "40 seconds", "12 minutes", "5 hours", "3 days".
std::string RoundDuration(double seconds);

/// One line on stderr with the current work and its duration. If its size is known, also the part
/// that is done and the time left. It is drawn again five times a second and wiped by the
/// destructor. It does not appear unless stderr is a terminal. All calls may come from any thread.
class ProgressLine {
 public:
  /// `shown` = false: as if stderr were no terminal.
  explicit ProgressLine(bool shown = true);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  bool shown() const { return shown_; }

  /// Begins work of unknown size.
  void Begin(const std::string& what) { Count(what, 0, 0); }
  /// Reports progress. The first call's `done` was done before. `note` follows the numbers.
  void Count(const std::string& what, std::int64_t done, std::int64_t total,
             const std::string& note = "");
  /// Count as a function of the numbers alone.
  CountDone Counter(const std::string& what);
  /// Wipes the line for good, as the destructor does.
  void Stop();
  /// Writes a line that stays, even if stderr is no terminal.
  void Say(const std::string& line);

 private:
  using Clock = std::chrono::steady_clock;

  void Run();
  std::string Text() const;

  const bool shown_;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;
  std::condition_variable wake_;
  std::string what_, note_;
  std::int64_t first_ = 0, done_ = 0, total_ = 0;  // of what_; total_ is 0 if unknown
  Clock::time_point began_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace volalign
