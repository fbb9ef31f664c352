// The expected streams are written down here from the index alone; delays make the threads finish
// in another order.

#include "core/base/ordered_prefetch.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "core/base/error.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/thread_limit.h"

namespace volalign::ordered_prefetch_test {
namespace {

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
}  // namespace volalign::ordered_prefetch_test
