#include "core/base/text.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/noise_fields.h"
#include "core/base/progress_line.h"
#include "core/base/provenance.h"
#include "core/base/random.h"
#include "core/base/statistics.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"

namespace volalign::text_test {
namespace {

using Parts = std::vector<std::string>;

TEST(Text, Splits) {
  EXPECT_EQ(Split("a,,b,", ','), (Parts{"a", "", "b", ""}));
  EXPECT_EQ(Split("", ','), Parts{""});
}

TEST(Text, IndentsLinesThatHoldSomething) {
  EXPECT_EQ(Indented("a:\n\n  b: 1", "  "), "  a:\n\n    b: 1\n");
  EXPECT_EQ(Indented("", "  "), "");
}

TEST(Text, Quotes) {
  EXPECT_EQ(CsvQuoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
  // Cells that a spreadsheet would take for formulas, and come back as they were.
  EXPECT_EQ(CsvQuoted("=1+1"), "\"'=1+1\"");
  for (const char* number :
       {"-30", "+1e-3", "-", "@home", "=cmd|' /C calc'!A0", "'=1", "''+a", "'", "Left", ""}) {
    const std::string quoted = CsvQuoted(number);
    EXPECT_EQ(CsvText(quoted.substr(1, quoted.size() - 2)), number);
  }
  for (const char* plain : {"-30", "+1e-3", "Left", "'tis", ""})
    EXPECT_EQ(CsvQuoted(plain), "\"" + std::string(plain) + "\"");
  EXPECT_EQ(Lower("KA03_Depth"), "ka03_depth");
}

TEST(Text, TellsControlCharacters) {
  EXPECT_EQ(Printable("a\x1b[31m\nb\x7f"), "a\\x1b[31m\\x0ab\\x7f");
  EXPECT_EQ(Printable("\xc2\x9b"
                      "1m"),
            "\\x9b1m");
  EXPECT_EQ(Printable("Küche €"), "Küche €");
}

TEST(Printable, IsUtf8WhateverTheBytesAre) {
  EXPECT_EQ(Printable("K\xfc"
                      "che"),
            "K\\xfc"
            "che");
  // A letter in more bytes than it needs, half a pair of UTF-16, beyond Unicode, one that is cut.
  for (const char* bytes : {"\xc0\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xe2\x82", "\xff"}) {
    EXPECT_FALSE(IsUtf8(bytes));
    EXPECT_EQ(Printable(bytes).find_first_not_of("\\x0123456789abcdef"), std::string::npos);
  }
  EXPECT_TRUE(IsUtf8("📦 €"));
  EXPECT_EQ(Printable("📦"), "📦");
  EXPECT_EQ(Printable("A\xe2\x80\xaegnp"), "A\\u202egnp");  // right to left
  EXPECT_EQ(Printable("a\xe2\x80\xa8"
                      "b\xe2\x80\x8b"),
            "a\\u2028b\\u200b");
  ExpectError<DataError>([] { RequireUtf8("\xff", "argument 3,"); },
                         {"argument 3, \"\\xff\" is not UTF-8", "rename"});
}

TEST(Error, IsOneShortLineWhateverItQuotes) {
  EXPECT_STREQ(Error("a\nb\xff\n").what(), "a\\x0ab\\xff");
  const std::string said = DataError("x.json: " + std::string(1000000, 'a') + "; rename it").what();
  EXPECT_LT(said.size(), 1600u);
  EXPECT_EQ(said.rfind("x.json: a", 0), 0u);
  EXPECT_TRUE(Has(said, "a ... a"));
  EXPECT_EQ(said.substr(said.size() - 11), "; rename it");
  std::string euros;
  for (int i = 0; i < 1000; ++i) euros += "\xe2\x82\xac";
  EXPECT_TRUE(IsUtf8(Error(euros).what()));
  EXPECT_TRUE(IsUtf8(Error("a" + euros).what()));
}

TEST(SentenceOf, SaysWhatTheSystemMeans) {
  std::error_code loop = std::make_error_code(std::errc::too_many_symbolic_link_levels);
  EXPECT_EQ(SentenceOf(std::filesystem::filesystem_error("status", "a/b", loop)),
            "a/b: " + loop.message());
  EXPECT_TRUE(Has(SentenceOf(std::system_error(
                      std::make_error_code(std::errc::resource_unavailable_try_again))),
                  "no more threads"));
  EXPECT_EQ(SentenceOf(std::runtime_error("a\nframe 1")), "a");
}

TEST(Shortened, KeepsMessagesShortAndPlain) {
  EXPECT_EQ(Shortened("a\nb"), "a\\x0ab");
  EXPECT_EQ(Shortened(std::string(200, 'a')), std::string(200, 'a'));
  EXPECT_EQ(Shortened(std::string(1000000, 'a')), std::string(200, 'a') + "...");
  EXPECT_EQ(Shortened("Küche", 2), "K...");
}

TEST(RequirePlainName, RefusesWhatATerminalOrATableWouldMisread) {
  EXPECT_NO_THROW(RequirePlainName(std::string(kMostNameBytes, 'a'), "x"));
  EXPECT_NO_THROW(RequirePlainName("images/left 1.png", "x"));
  ExpectError<DataError>([] { RequirePlainName(std::string(kMostNameBytes + 1, 'a'), "x.json"); },
                         {"x.json", "100 bytes"});
  ExpectError<DataError>([] { RequirePlainName("A\n0 9 9 9", "x.json"); }, {"A\\x0a0 9"});
  for (const char* name : {"A\xe2\x80\xaegnp", "\xff\xfe"}) EXPECT_FALSE(IsPlainName(name));
  EXPECT_NO_THROW(RequirePlainText("CL8 -3 <script>", "serial"));
  ExpectError<DataError>([] { RequirePlainText("\x1b[31m", "serial"); }, {"serial = \"\\x1b[31m"});
  EXPECT_THROW(RequirePlainText(std::string(201, 'a'), "serial"), DataError);
}

using Clock = std::chrono::steady_clock;

/// A pseudo terminal that is stderr while it lives. No more than 4 kB may be written unread.
class Terminal {
 public:
  Terminal() : master_(::posix_openpt(O_RDWR | O_NOCTTY)), kept_(::dup(STDERR_FILENO)) {
    if (master_ < 0 || ::grantpt(master_) != 0 || ::unlockpt(master_) != 0) std::abort();
    const int slave = ::open(::ptsname(master_), O_RDWR | O_NOCTTY);
    if (slave < 0) std::abort();
    ::dup2(slave, STDERR_FILENO);
    ::close(slave);
    ::fcntl(master_, F_SETFL, O_NONBLOCK);
  }
  ~Terminal() {
    std::fflush(stderr);
    ::dup2(kept_, STDERR_FILENO);
    ::close(kept_);
    ::close(master_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  /// What it has shown since the last call.
  std::string Seen() {
    std::fflush(stderr);
    std::string seen;
    char buffer[4096];
    for (ssize_t n; (n = ::read(master_, buffer, sizeof buffer)) > 0;)
      seen.append(buffer, static_cast<std::size_t>(n));
    return seen;
  }

 private:
  int master_, kept_;
};

/// Until it has been drawn, on a machine that does nothing else.
void Wait() { std::this_thread::sleep_for(std::chrono::milliseconds(450)); }

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
    line.Begin("clouds");  // of unknown size
    seen = SeenUntil(&terminal, "clouds ...");
    EXPECT_TRUE(Has(seen.substr(seen.rfind('\r')), "clouds ...")) << seen;
    line.Say("that stays");
    seen = terminal.Seen();
    EXPECT_TRUE(Has(seen, "\r\x1b[Kthat stays\r\n")) << seen;
  }
  seen = terminal.Seen();
  EXPECT_EQ(seen.substr(seen.size() - 4), "\r\x1b[K") << "it is wiped";
}

TEST(ProgressLine, IsNotShownWhereItIsNotWanted) {
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

class Provenance : public ::testing::Test {
 protected:
  void TearDown() override { ::unsetenv("SOURCE_DATE_EPOCH"); }
};

TEST_F(Provenance, TimeIsNow) {
  std::string now, same;
  do {  // within one second
    const std::time_t clock = std::time(nullptr);
    ::unsetenv("SOURCE_DATE_EPOCH");
    now = UtcNow();
    ::setenv("SOURCE_DATE_EPOCH", std::to_string(clock).c_str(), 1);
    same = UtcNow();
    if (std::time(nullptr) == clock) break;
  } while (true);
  EXPECT_EQ(now, same);
}

TEST_F(Provenance, TimeIsThatOfSourceDateEpochIfItIsANumber) {
  ::setenv("SOURCE_DATE_EPOCH", "951782399", 1);
  EXPECT_EQ(UtcNow(), "2000-02-28T23:59:59Z");
  for (const char* wrong : {"", "yesterday", "12x", "-1", "99999999999999999999"}) {
    ::setenv("SOURCE_DATE_EPOCH", wrong, 1);
    EXPECT_THROW(UtcNow(), ConfigError) << wrong;
  }
}

TEST(Quantile, IsAnElementOfTheSortedValues) {
  RandomStream random(1, 0, "values");
  for (const int n : {1, 2, 3, 10, 101}) {
    std::vector<double> values;
    for (int i = 0; i < n; ++i) values.push_back(random.Normal());
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    for (const double q : {0.0, 0.25, 0.5, 0.95, 1.0})
      EXPECT_EQ(Quantile(values, q), sorted[static_cast<std::size_t>(q * (n - 1) + 0.5)])
          << n << " " << q;
    EXPECT_EQ(Quantile(values, 0.5), sorted[static_cast<std::size_t>(n / 2)]) << n;
  }
  EXPECT_EQ(Quantile(std::vector<double>(), 0.5), 0);
}

using Words = std::array<std::uint32_t, 4>;

// kat_vectors of the Random123 distribution, philox4x32 10.
TEST(Philox, KnownAnswers) {
  EXPECT_EQ(Philox4x32({0, 0, 0, 0}, {0, 0}),
            (Words{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(Philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Words{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(Philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Words{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

// From a Python implementation of Philox and FNV-1a: the stream that trained checkpoints' samples
// come from must never change.
TEST(RandomStream, KnownAnswer) {
  RandomStream stream(0x123456789abcdef0, 0xfedcba9876543210, "pose");
  for (const std::uint32_t word :
       {0xfedb78b4u, 0x0e3a64cbu, 0xe9531ceeu, 0x0f92f28cu, 0xdef34249u, 0xa8ff933fu}) {
    EXPECT_EQ(stream.NextU32(), word);
  }
}

constexpr int kDraws = 200000;

/// Of Kolmogorov and Smirnov: the largest gap between the values' distribution and the law.
double GapTo(double (*law)(double), std::vector<double> values) {
  std::sort(values.begin(), values.end());
  double gap = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    gap = std::max(gap, std::abs(law(values[i]) - (static_cast<double>(i) + 0.5) /
                                                      static_cast<double>(values.size())));
  return gap;
}

TEST(RandomStream, UniformHasTheUniformLaw) {
  RandomStream stream(3, 0, "uniform");
  std::vector<double> values;
  for (int i = 0; i < kDraws; ++i) {
    values.push_back(stream.Uniform());
    ASSERT_EQ(values.back(), static_cast<double>(static_cast<float>(values.back())));
    ASSERT_GE(values.back(), 0);
    ASSERT_LT(values.back(), 1);
  }
  EXPECT_LT(GapTo([](double x) { return x; }, values), 2.2 / std::sqrt(kDraws));
}

TEST(RandomStream, BelowIsUniformOverTheIntegers) {
  RandomStream stream(3, 2, "below");
  std::vector<int> counts(7);
  for (int i = 0; i < kDraws; ++i) {
    const int x = stream.Below(7);
    ASSERT_GE(x, 0);
    ASSERT_LT(x, 7);
    ++counts[static_cast<std::size_t>(x)];
  }
  double chi2 = 0;
  for (const int n : counts) chi2 += (n - kDraws / 7.0) * (n - kDraws / 7.0) / (kDraws / 7.0);
  EXPECT_LT(chi2, 27.9);  // 1e-4 quantile of 6 degrees of freedom
  for (int i = 0; i < 100; ++i) EXPECT_EQ(stream.Below(1), 0);
}

TEST(RandomStream, NormalHasTheNormalLaw) {
  RandomStream stream(3, 4, "normal");
  double neighbours = 0, last = stream.Normal();
  std::vector<double> values;
  for (int i = 0; i < kDraws; ++i) {
    values.push_back(stream.Normal());
    neighbours += values.back() * last / kDraws;
    last = values.back();
  }
  EXPECT_NEAR(neighbours, 0, 4.5 / std::sqrt(kDraws));
  EXPECT_LT(GapTo([](double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }, values),
            2.2 / std::sqrt(kDraws));
}

TEST(RandomStream, DrawsAllElseByTheseTwoLaws) {
  RandomStream a(9, 9, "x"), b(9, 9, "x");
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(a.Chance(0.3), b.Uniform() < 0.3);
    EXPECT_DOUBLE_EQ(a.Normal(2, 0.5), 2 + 0.5 * b.Normal());
    EXPECT_DOUBLE_EQ(a.Uniform(-15, 75), -15 + 90 * b.Uniform());
  }
}

TEST(PixelRandom, DrawsManyNumbersAsOneByOne) {
  RandomStream stream(3, 4, "test");
  const PixelRandom pixel(stream);
  std::vector<float> uniform(693), normal(693);
  pixel.Uniforms(1000, 693, uniform.data());
  pixel.Normals(1000, 693, normal.data());
  for (std::size_t i = 0; i < uniform.size(); ++i) {
    ASSERT_EQ(uniform[i], pixel.Uniform(1000 + i));
    ASSERT_EQ(normal[i], pixel.Normal(1000 + i));
  }
}

// Against the sums that are meant, a pixel at a time, where the ends have themselves for
// neighbours.
TEST(SmoothUnitNoise, IsAThreeTapGaussianEachWay) {
  RandomStream random(3, 4, "test");
  const PixelRandom pixel(random);
  Image<float> noise(5, 4);
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = pixel.Normal(i);
  const double side = std::exp(-0.5 / (1.2 * 1.2)), norm = 1 / std::sqrt(1 + 2 * side * side);
  const auto along = [&](int u, int v) {
    const float left = noise(std::max(u - 1, 0), v), right = noise(std::min(u + 1, 4), v);
    return norm * (noise(u, v) + side * (left + right));
  };
  std::vector<double> expected;
  for (const auto [u, v] : Pixels(5, 4)) {
    const double above = along(u, std::max(v - 1, 0)), below = along(u, std::min(v + 1, 3));
    expected.push_back(norm * (along(u, v) + side * (above + below)));
  }
  SmoothUnitNoise(1.2, 1.2, &noise);
  for (std::size_t i = 0; i < noise.size(); ++i) EXPECT_NEAR(noise[i], expected[i], 1e-5) << i;
}

}  // namespace
}  // namespace volalign::text_test
