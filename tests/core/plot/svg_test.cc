#include "core/plot/svg.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

namespace volalign::svg_test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(PlotAxis, SpansTheFiniteValues) {
  const PlotAxis axis = PlotAxis::Of({3, kNan, -1, HUGE_VAL, 2}, 100, 0);
  EXPECT_EQ(axis.low, -1);
  EXPECT_EQ(axis.high, 3);
  EXPECT_EQ(axis.At(-1), 100);
  EXPECT_EQ(axis.At(1), 50);
  EXPECT_EQ(axis.At(3), 0);
}

TEST(PlotAxis, OneValueOrNoneStandsInTheMiddle) {
  for (const double value : {0.003, -20.0, 0.0}) {
    const PlotAxis axis = PlotAxis::Of({value, value}, 0, 10);
    EXPECT_LT(axis.low, value);
    EXPECT_NEAR(axis.At(value), 5, 1e-12);
    EXPECT_FALSE(axis.Ticks().empty());
  }
  EXPECT_GT(PlotAxis::Of({}, 0, 10).high, PlotAxis::Of({kNan}, 0, 10).low);
}

TEST(PlotAxis, TicksAreRoundAndWithinTheAxis) {
  for (const auto& [low, high, ticks] :
       {std::tuple<double, double, std::vector<double>>{0, 10, {0, 2, 4, 6, 8, 10}},
        {-0.1, 0.1, {-0.1, -0.05, 0, 0.05, 0.1}},
        {13, 59, {20, 30, 40, 50}},
        {3.4, 10.8, {4, 5, 6, 7, 8, 9, 10}},  // 3 to 11 by 1 would be eight steps: 2 to 12 by 2
        {0.0031, 0.0069, {0.004, 0.005, 0.006}}}) {
    const PlotAxis axis{low, high, 0, 1};
    const std::vector<double> found = axis.Ticks();
    ASSERT_EQ(found.size(), ticks.size()) << low;
    for (std::size_t i = 0; i < ticks.size(); ++i) EXPECT_NEAR(found[i], ticks[i], 1e-12);
    const PlotAxis wide = axis.RoundedOut();
    EXPECT_LE(wide.low, low + 1e-12);
    EXPECT_GE(wide.high, high - 1e-12);
    EXPECT_NEAR(wide.Ticks().front(), wide.low, 1e-12);
    EXPECT_NEAR(wide.Ticks().back(), wide.high, 1e-12);
  }
}

TEST(Svg, IsTheseElements) {
  Svg svg(20, 10, ".a{stroke:#444}", -5);
  svg.Line({0, 1}, {2, 3.25}, "class=\"a\"");
  svg.Polygon({{0, 0}, {1, 0}, {1, 1}}, "fill=\"none\"");
  svg.TurnedText({3, 4}, -90, "up", "text-anchor=\"middle\"");
  EXPECT_EQ(svg.Finished(),
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"10\" "
            "viewBox=\"-5 0 20 10\" font-family=\"sans-serif\" font-size=\"13\">\n"
            "<style>text{fill:#222}.a{stroke:#444}</style>\n"
            "<rect x=\"-5\" width=\"20\" height=\"10\" fill=\"#fff\"/>\n"
            "<line x1=\"0.0\" y1=\"1.0\" x2=\"2.0\" y2=\"3.2\" class=\"a\"/>\n"
            "<polygon points=\"0.0,0.0 1.0,0.0 1.0,1.0 \" fill=\"none\"/>\n"
            "<text x=\"3.0\" y=\"4.0\" text-anchor=\"middle\" "
            "transform=\"rotate(-90 3.0 4.0)\">up</text>\n"
            "</svg>\n");
}

TEST(Svg, EscapesTextsAndTitles) {
  Svg svg(1, 1);
  svg.Text({0, 0}, "a<b & c>d");
  svg.Rectangle({0, 0}, 1, 1, "", "x<y");
  svg.Polygon({{0, 0}}, "", "</polygon>");
  const std::string text = svg.Finished();
  EXPECT_NE(text.find(">a&lt;b &amp; c&gt;d</text>"), std::string::npos) << text;
  EXPECT_NE(text.find("<title>x&lt;y</title></rect>"), std::string::npos) << text;
  EXPECT_NE(text.find("<title>&lt;/polygon&gt;</title></polygon>"), std::string::npos) << text;
}

}  // namespace
}  // namespace volalign::svg_test
