#include "core/nn/cpu/torch_threads.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "core/base/error.h"

namespace volalign::torch_threads_test {
namespace {

TEST(SetTorchThreads, RefusesNegativeNumbers) {
  EXPECT_THROW(SetTorchThreads(-1), Error);
  SetTorchThreads(0);
  EXPECT_EQ(at::get_num_threads(), 1);  // of torch_test_main.cc
}

TEST(ForEachOnTorchThreads, CallsEachTaskOnce) {
  for (const int count : {0, 1, 2, 7}) {
    std::vector<int> calls(static_cast<std::size_t>(count));
    ForEachOnTorchThreads(count, [&](std::int64_t i) { ++calls[static_cast<std::size_t>(i)]; });
    EXPECT_EQ(calls, std::vector<int>(static_cast<std::size_t>(count), 1));
  }
}

#ifdef VOLALIGN_OPENMP
TEST(ForEachOnTorchThreads, TakesAsManyThreadsAsLibTorch) {
  for (const int threads : {1, 2}) {
    SetTorchThreads(threads);
    std::vector<std::thread::id> by(8);
    ForEachOnTorchThreads(
        8, [&](std::int64_t i) { by[static_cast<std::size_t>(i)] = std::this_thread::get_id(); });
    EXPECT_EQ(std::set<std::thread::id>(by.begin(), by.end()).size(),
              static_cast<std::size_t>(threads));
  }
}
#endif

TEST(ForEachOnTorchThreads, RethrowsAnException) {
  EXPECT_THROW(ForEachOnTorchThreads(4,
                                     [](std::int64_t i) {
                                       if (i == 3) throw std::runtime_error("task 3");
                                     }),
               std::runtime_error);
}

}  // namespace
}  // namespace volalign::torch_threads_test
