#include "core/base/interrupt.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>

#include "core/base/file_util.h"
#include "tests/core/base/read_file.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/base/thread_limit.h"

namespace volalign::interrupt_test {
namespace {

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

TEST(EndOnInterrupt, LeavesNothingUnfinished) {
  const TempFolder folder;
  std::string said;
  for (const int number : {SIGINT, SIGTERM}) {
    const auto work = [&] {
      EndOnInterrupt();
      const Unfinished draft([&] {
        std::filesystem::create_directory(folder / "draft");
        return folder / "draft";
      });
      folder.Write("draft/a", "half");
      std::raise(number);
      WaitForEver();
    };
    EXPECT_EQ(StatusOf(work, &said), 128 + number);
    EXPECT_EQ(said, number == SIGINT ? "stopped by Ctrl-C (SIGINT)\n" : "stopped by SIGTERM\n");
    EXPECT_FALSE(std::filesystem::exists(folder / "draft"));
  }
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
    const Unfinished draft([&] {
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

}  // namespace
}  // namespace volalign::interrupt_test
