#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace volalign {

/// Told how far a work of known size is: `done` of `total` parts, first where it begins. Called by
/// one thread at a time.
using CountDone = std::function<void(std::int64_t done, std::int64_t total)>;

/// About so long, in words: "40 seconds", "12 minutes", "5 hours", "3 days".
std::string RoundDuration(double seconds);

/// One line on stderr that says what is going on and for how long, and, where its size is known,
/// how much of it is done and how long the rest will take at this speed. It is drawn anew five
/// times a second and wiped when the object goes. Nothing of it unless stderr is a terminal. All
/// calls may come from any thread.
class ProgressLine {
 public:
  /// Not shown: as if stderr were no terminal.
  explicit ProgressLine(bool shown = true);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  bool shown() const { return shown_; }

  /// Something of unknown size begins. `share_done`, where it is above 0: this much of the time
  /// that all takes has gone by, by experience; the rest is then foretold from the time so far.
  void Begin(const std::string& what, double share_done = 0);
  /// So much of it is done. What is done at the first call was done before. `note` follows.
  void Count(const std::string& what, std::int64_t done, std::int64_t total,
             const std::string& note = "");
  /// Count, for a function that takes no more than the numbers.
  CountDone Counter(const std::string& what);
  /// Wipes it for good, as the destructor does.
  void Stop();
  /// A line that stays, also where stderr is no terminal.
  void Say(const std::string& line);

 private:
  using Clock = std::chrono::steady_clock;

  void Show(const std::string& what, std::int64_t done, std::int64_t total, const std::string& note,
            double share_done);
  void Run();
  std::string Text() const;

  const bool shown_;
  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;
  std::condition_variable wake_;
  std::string what_, note_;
  std::int64_t first_ = 0, done_ = 0, total_ = 0;  // of what_; total_ is 0 where it is not known
  double share_done_ = 0;                          // when what_ began, or 0
  Clock::time_point began_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace volalign
