#include "core/base/stop.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "core/base/ordered_prefetch.h"
#include "core/base/parallel_for.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::stop_test {
namespace {

/// While it lives, the process can start `count` more threads at a time: stacks are made so large
/// that its address space holds no more.
class ThreadLimit {
 public:
  explicit ThreadLimit(int count) {
    constexpr std::size_t kStack = std::size_t{1} << 30;
    pthread_attr_init(&old_attributes_);
    EXPECT_EQ(pthread_getattr_default_np(&old_attributes_), 0);
    EXPECT_EQ(getrlimit(RLIMIT_AS, &old_limit_), 0);
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, kStack);
    EXPECT_EQ(pthread_setattr_default_np(&attributes), 0);
    pthread_attr_destroy(&attributes);
    std::size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    rlimit limit = old_limit_;
    limit.rlim_cur = pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE)) +
                     static_cast<std::size_t>(count) * kStack + kStack / 2;
    EXPECT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
  }
  ~ThreadLimit() {
    EXPECT_EQ(setrlimit(RLIMIT_AS, &old_limit_), 0);
    EXPECT_EQ(pthread_setattr_default_np(&old_attributes_), 0);
    pthread_attr_destroy(&old_attributes_);
  }
  ThreadLimit(const ThreadLimit&) = delete;
  ThreadLimit& operator=(const ThreadLimit&) = delete;

 private:
  pthread_attr_t old_attributes_;
  rlimit old_limit_;
};

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

int g_reached = 0;  // signals that came to the handler of before

TEST(InterruptGuard, NotesSignalsWhileItLivesAndGivesThemBack) {
  for (const int number : {SIGINT, SIGTERM}) {
    SCOPED_TRACE(number);
    const auto before = std::signal(number, [](int) { ++g_reached; });
    g_reached = 0;
    {
      const InterruptGuard guard;
      EXPECT_EQ(guard.Signal(), 0);
      std::raise(number);
      EXPECT_EQ(guard.Signal(), number);
      {
        InterruptGuard inner;
        EXPECT_EQ(inner.Signal(), number);
      }
      std::raise(number);
      EXPECT_EQ(g_reached, 0);
    }
    std::raise(number);
    EXPECT_EQ(g_reached, 1);
    // A signal of an earlier run does not interrupt the next one.
    EXPECT_EQ(InterruptGuard().Signal(), 0);
    std::signal(number, before);
  }
}

/// Calls `work` in a process of its own and gives its status, as a shell does; what it says on
/// stderr comes into `said`.
int StatusOf(const std::function<void()>& work, std::string* said) {
  const TempFolder folder;
  const pid_t child = ::fork();
  if (child == 0) {
    if (std::freopen((folder / "said").c_str(), "w", stderr) == nullptr) ::_exit(99);
    for (const int number : {SIGINT, SIGTERM}) std::signal(number, SIG_DFL);
    work();
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  *said = ReadFile(folder / "said");
  return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

[[noreturn]] void WaitForEver() {
  for (;;) ::pause();
}

TEST(EndOnInterrupt, DoesWithoutAThread) {
  std::string said;
  const auto work = [] {
    const ThreadLimit limit(0);
    EndOnInterrupt();
    ::_exit(3);
  };
  EXPECT_EQ(StatusOf(work, &said), 3);
  EXPECT_EQ(said, "");
}

TEST(EndOnInterrupt, SaysInALineWhatNothingCanCatch) {
  const TempFolder folder;
  std::string said;
  const auto work = [&] {
    EndOnInterrupt();
    const TemporaryPath draft([&] {
      folder.Write("draft", "half");
      return folder / "draft";
    });
    ExplainUncaught("is the port right?");
    std::thread([] { throw std::runtime_error("the store is\nframe 1\nframe 2"); }).join();
  };
  EXPECT_EQ(StatusOf(work, &said), 1);
  EXPECT_EQ(said,
            "error: a library failed where nothing can go on: the store is; is the port right?\n");
  EXPECT_FALSE(std::filesystem::exists(folder / "draft"));
}

TEST(EndOnInterrupt, WaitsWhileStepsBelongTogether) {
  const TempFolder folder;
  std::string said;
  const auto work = [&] {
    EndOnInterrupt();
    {
      const auto hold = HoldInterrupts();
      std::raise(SIGTERM);
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      folder.Write("whole", "");
    }
    WaitForEver();
  };
  EXPECT_EQ(StatusOf(work, &said), 128 + SIGTERM);
  EXPECT_TRUE(std::filesystem::exists(folder / "whole"));
}

TEST(EndOnInterrupt, LeavesGuardsAndIgnoredSignalsAlone) {
  std::string said;
  const auto work = [] {
    std::signal(SIGINT, SIG_IGN);
    EndOnInterrupt();
    std::raise(SIGINT);
    {
      const InterruptGuard guard;
      std::raise(SIGTERM);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  };
  EXPECT_EQ(StatusOf(work, &said), 0);
  EXPECT_EQ(said, "");
}

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
    for (const std::size_t count : {0, 1, 40})
      EXPECT_EQ(CountRuns(count, threads).runs, std::vector<int>(count, 1)) << threads;
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

// The expected streams are written down here from the index alone; delays make the threads finish
// in another order.
using Stream = OrderedPrefetch<std::uint64_t>;

void Sleep(int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); }

/// False when `count` has not become `expected` after 10 s.
bool Becomes(const std::atomic<int>& count, int expected) {
  for (int i = 0; i < 10000 && count != expected; ++i) Sleep(1);
  return count == expected;
}

TEST(OrderedPrefetch, GivesItemsInOrderUnderRandomDelays) {
  for (const int num_threads : {1, 5}) {
    for (const int batch_size : {1, 4}) {
      std::atomic<int> produced{0};
      Stream stream({8, batch_size, 3, num_threads}, [&] {
        return [&](std::uint64_t index) {
          Sleep(RandomStream(1, index, "delay").Below(5));
          ++produced;
          return index * index;
        };
      });
      for (std::uint64_t i = 8; i < 72; ++i) ASSERT_EQ(stream.Take(), i * i);
      // Every item once, to the end of what may be ahead.
      EXPECT_TRUE(Becomes(produced, 64 + 3 * batch_size)) << produced;
    }
  }
}

TEST(OrderedPrefetch, HoldsNoMoreThanTheLookAhead) {
  std::atomic<int> begun{0};
  Stream stream({6, 3, 2, 4}, [&] {
    return [&](std::uint64_t index) {
      ++begun;
      return index;
    };
  });
  const auto expect_begun = [&](int expected) {
    EXPECT_TRUE(Becomes(begun, expected)) << begun;
    Sleep(30);
    EXPECT_EQ(begun, expected);
  };
  expect_begun(6);
  stream.Take();
  stream.Take();
  expect_begun(6);  // a batch is not taken in part
  stream.Take();
  expect_begun(9);
}

TEST(OrderedPrefetch, AnExceptionArrivesAtItsIndexAndStays) {
  Stream stream({0, 1, 8, 3}, [] {
    return [](std::uint64_t index) {
      if (index == 5) throw DataError("item 5 is spoilt");
      Sleep(10);
      return index;
    };
  });
  for (std::uint64_t i = 0; i < 5; ++i) ASSERT_EQ(stream.Take(), i);
  ExpectError<DataError>([&] { stream.Take(); }, {"item 5 is spoilt"});
  ExpectError<DataError>([&] { stream.Take(); }, {"item 5 is spoilt"});
}

TEST(OrderedPrefetch, AFailedSetUpArrivesToo) {
  Stream stream({0, 1, 2, 2}, []() -> Stream::Produce { throw IoError("no device"); });
  ExpectError<IoError>([&] { stream.Take(); }, {"no device"});
}

TEST(OrderedPrefetch, AProducerStaysOnItsThread) {
  struct Tool {
    Tool(std::atomic<int>* made_count, std::atomic<int>* alive_count)
        : alive(alive_count), thread(std::this_thread::get_id()) {
      ++*made_count;
      ++*alive;
    }
    ~Tool() {
      EXPECT_EQ(std::this_thread::get_id(), thread);
      --*alive;
    }
    std::atomic<int>* const alive;
    const std::thread::id thread;
  };
  std::atomic<int> made{0}, alive{0};
  {
    Stream stream({0, 1, 4, 3}, [&] {
      return [tool = std::make_shared<Tool>(&made, &alive)](std::uint64_t index) {
        EXPECT_EQ(std::this_thread::get_id(), tool->thread);
        Sleep(2);
        return index;
      };
    });
    for (int i = 0; i < 30; ++i) stream.Take();
  }
  EXPECT_LE(made, 3);
  EXPECT_EQ(alive, 0);
}

TEST(OrderedPrefetch, StopsWhileWorkersAreBusy) {
  std::atomic<int> begun{0}, ended{0};
  {
    const Stream stream({0, 1, 1000, 3}, [&] {
      return [&](std::uint64_t index) {
        ++begun;
        Sleep(300);
        ++ended;
        return index;
      };
    });
    ASSERT_TRUE(Becomes(begun, 3));
  }
  EXPECT_EQ(begun, 3);  // no other item was begun
  EXPECT_EQ(ended, 3);  // and none is left behind
}

TEST(OrderedPrefetch, WorksWithTheThreadsThatThereAre) {
  const auto square = [] { return [](std::uint64_t index) { return index * index; }; };
  {
    const ThreadLimit limit(2);
    Stream stream({0, 1, 4, 8}, square);
    for (std::uint64_t i = 0; i < 30; ++i) ASSERT_EQ(stream.Take(), i * i);
  }
  const ThreadLimit limit(0);
  ExpectError<Error>([&] { Stream stream({0, 1, 4, 8}, square); }, {"no thread", "ulimit -u"});
}

TEST(OrderedPrefetch, RejectsBadOptions) {
  const auto make = [] { return [](std::uint64_t index) { return index; }; };
  ExpectError<Error>([&] { Stream({0, 0, 1, 1}, make); }, {"batch_size = 0"});
  ExpectError<Error>([&] { Stream({0, 1, 0, 1}, make); }, {"prefetch = 0"});
  ExpectError<Error>([&] { Stream({0, 1, 1, 0}, make); }, {"num_threads = 0"});
}

}  // namespace
}  // namespace volalign::stop_test
