#include "cli/stage_progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace volalign {

namespace {

constexpr std::chrono::milliseconds kInterval(200);
constexpr char kWipe[] = "\r\x1b[K";

}  // namespace

StageProgress::StageProgress() : is_terminal_(::isatty(STDERR_FILENO) == 1) {
  if (is_terminal_) thread_ = std::thread([this] { Draw(); });
}

StageProgress::~StageProgress() {
  if (!is_terminal_) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
  fmt::print(stderr, "{}", kWipe);
  std::fflush(stderr);
}

void StageProgress::Begin(const std::string& stage) {
  if (!is_terminal_) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stage_ = stage;
  }
  wake_.notify_one();
}

void StageProgress::Draw() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    if (!stage_.empty()) {
      const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
      fmt::print(stderr, "{}{:.1f} s: {} ...", kWipe, elapsed.count(), stage_);
      std::fflush(stderr);
    }
    wake_.wait_for(lock, kInterval);
  }
}

}  // namespace volalign
