#pragma once

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstddef>
#include <fstream>

namespace volalign {

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

}  // namespace volalign
