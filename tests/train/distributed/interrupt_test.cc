#include "train/distributed/interrupt.h"

#include <gtest/gtest.h>

#include <csignal>

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
      EXPECT_FALSE(guard.Interrupted());
      std::raise(number);
      EXPECT_TRUE(guard.Interrupted());
      EXPECT_EQ(g_reached, 0);
    }
    std::raise(number);
    EXPECT_EQ(g_reached, 1);
    // A signal of an earlier run does not interrupt the next one.
    EXPECT_FALSE(InterruptGuard().Interrupted());
    std::signal(number, before);
  }
}

}  // namespace
}  // namespace volalign::interrupt_test
