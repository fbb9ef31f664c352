#include "core/base/stop.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "core/base/parallel_for.h"

namespace volalign::stop_test {
namespace {

TEST(Stop, ConcernsItsScopeAlone) {
  std::atomic<bool> asked{true};
  EXPECT_NO_THROW(ThrowIfStopped());
  {
    const StopScope scope(&asked);
    EXPECT_THROW(ThrowIfStopped(), Stopped);
    {
      std::atomic<bool> other{false};
      const StopScope inner(&other);
      EXPECT_NO_THROW(ThrowIfStopped());
    }
    EXPECT_THROW(ThrowIfStopped(), Stopped);
    std::thread([] { EXPECT_NO_THROW(ThrowIfStopped()); }).join();
  }
  EXPECT_NO_THROW(ThrowIfStopped());
}

TEST(Stop, ReachesAllTasksOfParallelFor) {
  std::atomic<bool> asked{false};
  std::atomic<int> begun{0};
  const StopScope scope(&asked);
  EXPECT_THROW(ParallelFor(1000, 4,
                           [&](std::size_t) {
                             if (++begun == 2) asked = true;
                             while (!asked) std::this_thread::yield();
                             ThrowIfStopped();
                           }),
               Stopped);
  EXPECT_LE(begun, 4) << "those that had not begun do not begin";
}

}  // namespace
}  // namespace volalign::stop_test
