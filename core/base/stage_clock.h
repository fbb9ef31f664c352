#pragma once

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace volalign {

/// Wall-clock time of the stages of a job, which begins when the clock is made.
class StageClock {
 public:
  /// Adds the time since the last lap to a stage.
  void Lap(const std::string& stage) {
    const auto now = Clock::now();
    const auto known = std::find_if(stages_.begin(), stages_.end(),
                                    [&](const auto& timing) { return timing.first == stage; });
    if (known != stages_.end()) {
      known->second += Seconds(now - lap_);
    } else {
      stages_.emplace_back(stage, Seconds(now - lap_));
    }
    lap_ = now;
  }

  /// Stages in the order of their first laps, s, then "total".
  std::vector<std::pair<std::string, double>> Total() const {
    auto all = stages_;
    all.emplace_back("total", Seconds(Clock::now() - start_));
    return all;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static double Seconds(Clock::duration d) { return std::chrono::duration<double>(d).count(); }

  std::vector<std::pair<std::string, double>> stages_;
  Clock::time_point start_ = Clock::now(), lap_ = start_;
};

}  // namespace volalign
