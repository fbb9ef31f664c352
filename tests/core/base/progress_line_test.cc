#include "core/base/progress_line.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

#include "tests/core/base/terminal.h"

namespace volalign::progress_line_test {
namespace {

using Clock = std::chrono::steady_clock;

/// Until it has been drawn, on a machine that does nothing else.
void Wait() { std::this_thread::sleep_for(std::chrono::milliseconds(450)); }

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// What is shown from now on, until all of it has `part` so many times, or ten seconds have passed.
std::string SeenUntil(Terminal* terminal, const std::string& part, int times = 1) {
  std::string seen;
  for (const auto start = Clock::now(); Clock::now() - start < std::chrono::seconds(10);) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    seen += terminal->Seen();
    int found = 0;
    for (std::size_t at = 0; (at = seen.find(part, at)) != std::string::npos; ++at) ++found;
    if (found >= times) break;
  }
  return seen;
}

/// The number behind the last `part`; -1 where there is none.
double NumberAfter(const std::string& text, const std::string& part) {
  const std::size_t at = text.rfind(part);
  return at == std::string::npos ? -1 : std::atof(text.c_str() + at + part.size());
}

TEST(ProgressLine, SaysWhatIsGoingOnAndWhatIsLeft) {
  Terminal terminal;
  std::string seen;
  {
    const auto start = Clock::now();
    const auto passed = [&] { return std::chrono::duration<double>(Clock::now() - start).count(); };
    ProgressLine line;
    line.Begin("first poses");
    seen = SeenUntil(&terminal, " s: first poses ...", 2);
    const double first = std::atof(seen.c_str() + seen.find_first_of("0123456789"));
    EXPECT_GE(NumberAfter(seen, "\x1b[K"), first + 0.1) << "it moves: " << seen;
    EXPECT_FALSE(Has(seen, "left")) << seen;
    // 90 of 100 were there before.
    const double before = passed();
    line.Count("frames", 90, 100);
    const double begun = passed();
    Wait();
    EXPECT_FALSE(Has(terminal.Seen(), "left")) << "nothing tells how fast it is";
    const double one = passed() - begun;
    line.Count("frames", 91, 100, "loss 3");
    seen = SeenUntil(&terminal, "left; loss 3");
    EXPECT_TRUE(Has(seen, "frames, 91 of 100, about ")) << seen;
    EXPECT_GE(NumberAfter(seen, "about "), 9 * one - 0.5) << seen;
    EXPECT_LE(NumberAfter(seen, "about "), 9 * (passed() - before) + 0.5) << seen;
    // A tenth of all is over, so that nine times as much is left; a stage that takes longer says
    // nothing.
    const double tenth = passed();
    line.Begin("writing", 0.1);
    const double at_most = passed();
    seen = SeenUntil(&terminal, "left ...");
    const double left = NumberAfter(seen, "writing, about ");
    EXPECT_GE(left, 10 * tenth - passed() - 0.5) << seen;
    EXPECT_LE(left, 9 * at_most + 0.5) << seen;
    line.Begin("clouds", 0.999);
    seen = SeenUntil(&terminal, "clouds ...");
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
