#include "core/base/progress_line.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

#include "tests/core/base/terminal.h"

namespace volalign::progress_line_test {
namespace {

/// Until it has been drawn.
void Wait() { std::this_thread::sleep_for(std::chrono::milliseconds(450)); }

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(ProgressLine, SaysWhatIsGoingOnAndWhatIsLeft) {
  Terminal terminal;
  std::string seen;
  {
    ProgressLine line;
    line.Begin("first poses");
    Wait();
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen, "0.2 s: first poses ...")) << seen;  // and 0.4 s: it moves
    EXPECT_TRUE(Has(seen, "0.4 s: first poses ...")) << seen;
    EXPECT_FALSE(Has(seen, "left")) << seen;
    // 90 of 100 were there before; 1 took 0.45 s.
    line.Count("frames", 90, 100);
    Wait();
    EXPECT_FALSE(Has(terminal.Seen(), "left")) << "nothing tells how fast it is";
    line.Count("frames", 91, 100, "loss 3");
    Wait();
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen, "frames, 91 of 100, about 4 seconds left; loss 3")) << seen;
    // A tenth of all took 1.35 s, so that 12 are left; a stage that takes longer says nothing.
    line.Begin("writing", 0.1);
    Wait();
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen, "writing, about 12 seconds left ...")) << seen;
    line.Begin("clouds", 0.999);
    Wait();
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen.substr(seen.rfind('\r')), "clouds ...")) << seen;
    line.Say("that stays");
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen, "\r\x1b[Kthat stays\r\n")) << seen;
  }
  seen = terminal.Seen();
  EXPECT_EQ(seen.substr(seen.size() - 4), "\r\x1b[K") << "it is wiped";
}

TEST(ProgressLine, IsForTerminalsAlone) {
  testing::internal::CaptureStderr();
  {
    ProgressLine line;
    EXPECT_FALSE(line.shown());
    line.Count("frames", 1, 2);
    Wait();
    line.Say("that stays");
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "that stays\n");
  Terminal terminal;
  {
    ProgressLine line(/*shown=*/false);
    line.Begin("frames");
    Wait();
  }
  EXPECT_EQ(terminal.Seen(), "");
}

TEST(RoundDuration, IsInTheUnitThatAPersonWouldTake) {
  EXPECT_EQ(RoundDuration(40), "40 seconds");
  EXPECT_EQ(RoundDuration(0.4), "1 second");
  EXPECT_EQ(RoundDuration(40 * 60), "40 minutes");
  EXPECT_EQ(RoundDuration(40 * 3600), "40 hours");
  EXPECT_EQ(RoundDuration(150 * 86400.0), "150 days");
}

}  // namespace
}  // namespace volalign::progress_line_test
