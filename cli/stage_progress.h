#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

namespace volalign {

/// One line on stderr that says what is going on and for how long, drawn anew five times a second;
/// nothing unless stderr is a terminal. The line is wiped when the object goes.
class StageProgress {
 public:
  StageProgress();
  ~StageProgress();
  StageProgress(const StageProgress&) = delete;
  StageProgress& operator=(const StageProgress&) = delete;

  void Begin(const std::string& stage);

 private:
  void Draw();

  const bool is_terminal_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::mutex mutex_;
  std::condition_variable wake_;
  std::string stage_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace volalign
