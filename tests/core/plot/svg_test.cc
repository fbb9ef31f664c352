#include "core/plot/svg.h"

#include <gtest/gtest.h>

#include <string>

namespace volalign::svg_test {
namespace {

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
