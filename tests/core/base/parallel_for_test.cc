#include "core/base/parallel_for.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/thread_limit.h"

namespace volalign::parallel_for_test {
namespace {

/// How often each task ran, and on how many threads.
struct Counts {
  std::vector<int> runs;
  std::size_t threads = 0;
};

Counts CountRuns(std::size_t count, int threads) {
  Counts counts{std::vector<int>(count), 0};
  std::mutex mutex;
  std::set<std::thread::id> ids;
  ParallelFor(count, threads, [&](std::size_t i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    const std::lock_guard<std::mutex> lock(mutex);
    ++counts.runs[i];
    ids.insert(std::this_thread::get_id());
  });
  counts.threads = ids.size();
  return counts;
}

TEST(ParallelFor, RunsEachTaskOnce) {
  for (const int threads : {0, 1, 3}) {
    for (const std::size_t count : {0, 1, 40}) {
      EXPECT_EQ(CountRuns(count, threads).runs, std::vector<int>(count, 1)) << threads;
    }
  }
  EXPECT_EQ(CountRuns(40, 1).threads, 1u);
  EXPECT_LE(CountRuns(40, 3).threads, 3u);
}

TEST(ParallelFor, RethrowsWhenAllHaveEnded) {
  std::atomic<int> ended{0};
  ExpectError<DataError>(
      [&] {
        ParallelFor(20, 3, [&](std::size_t i) {
          ++ended;
          if (i == 4) throw DataError("task 4");
        });
      },
      {"task 4"});
  EXPECT_EQ(ended, 20);
}

TEST(ParallelFor, DoesTheWorkWithTheThreadsThatThereAre) {
  for (const int started : {0, 2}) {
    const ThreadLimit limit(started);
    const Counts counts = CountRuns(40, 8);
    EXPECT_EQ(counts.runs, std::vector<int>(40, 1));
    EXPECT_LE(counts.threads, static_cast<std::size_t>(started) + 1);
  }
}

}  // namespace
}  // namespace volalign::parallel_for_test
