#include "core/base/progress_line.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/base/text.h"

namespace volalign {

namespace {

constexpr std::chrono::milliseconds kInterval(200);
constexpr char kWipe[] = "\r\x1b[K";
constexpr double kMinute = 60, kHour = 60 * kMinute, kDay = 24 * kHour;

/// As much of a line as the terminal has columns. The rest of a longer one would stay on the next
/// line.
std::string Fitted(const std::string& line) {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return line;
  return line.substr(0, size.ws_col - 1U);
}

}  // namespace

std::string RoundDuration(double seconds) {
  const auto in = [&](double unit, const char* name) {
    const long count = std::max(1L, std::lround(seconds / unit));
    return fmt::format("{} {}{}", count, name, count == 1 ? "" : "s");
  };
  if (seconds < 2 * kMinute) return in(1, "second");
  if (seconds < 2 * kHour) return in(kMinute, "minute");
  return seconds < 2 * kDay ? in(kHour, "hour") : in(kDay, "day");
}

ProgressLine::ProgressLine(bool shown) : shown_(shown && ::isatty(STDERR_FILENO) == 1) {
  std::vector<std::thread> started;
  const auto run = [this] { Run(); };
  if (shown_ && StartThreads(1, run, &started) == 1) thread_ = std::move(started.front());
}

ProgressLine::~ProgressLine() { Stop(); }

void ProgressLine::Stop() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
  fmt::print(stderr, "{}", kWipe);
  std::fflush(stderr);
}

void ProgressLine::Count(const std::string& what, std::int64_t done, std::int64_t total,
                         const std::string& note) {
  if (!shown_) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (Printable(what) != what_ || total != total_) {
      what_ = Printable(what);
      total_ = total;
      first_ = done;
      began_ = Clock::now();
    }
    done_ = done;
    note_ = note;
  }
  wake_.notify_one();
}

CountDone ProgressLine::Counter(const std::string& what) {
  return [this, what](std::int64_t done, std::int64_t total) { Count(what, done, total); };
}

void ProgressLine::Say(const std::string& line) {
  const std::lock_guard<std::mutex> lock(mutex_);
  fmt::print(stderr, "{}{}\n", shown_ ? kWipe : "", line);
  std::fflush(stderr);
}

std::string ProgressLine::Text() const {
  const auto seconds_since = [now = Clock::now()](Clock::time_point then) {
    return std::chrono::duration<double>(now - then).count();
  };
  std::string text = fmt::format("{:.1f} s: {}", seconds_since(start_), what_);
  if (total_ > 0) {
    text += fmt::format(", {} of {}", done_, total_);
    if (done_ > first_) {
      const double each = seconds_since(began_) / static_cast<double>(done_ - first_);
      text +=
          fmt::format(", about {} left", RoundDuration(each * static_cast<double>(total_ - done_)));
    }
  }
  return text + (note_.empty() ? " ..." : "; " + note_);
}

void ProgressLine::Run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    if (!what_.empty()) {
      fmt::print(stderr, "{}{}", kWipe, Fitted(Text()));
      std::fflush(stderr);
    }
    wake_.wait_for(lock, kInterval);
  }
}

}  // namespace volalign
