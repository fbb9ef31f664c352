#include "core/plot/svg.h"

#include <fmt/format.h>

namespace volalign {

namespace {

std::string Escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    escaped += c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '&' ? "&amp;" : std::string(1, c);
  }
  return escaped;
}

std::string Coordinates(const std::vector<Svg::Point>& points) {
  std::string text;
  for (const Svg::Point& p : points) text += fmt::format("{:.1f},{:.1f} ", p.x, p.y);
  return text;
}

}  // namespace

Svg::Svg(double width, double height, const std::string& css, double left)
    : text_(fmt::format(
          "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
          "viewBox=\"{2:.0f} 0 {0:.0f} {1:.0f}\" font-family=\"sans-serif\" font-size=\"13\">\n"
          "<style>text{{fill:#222}}{3}</style>\n"
          "<rect x=\"{2:.0f}\" width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#fff\"/>\n",
          width, height, left, css)) {}

void Svg::Line(const Point& from, const Point& to, const std::string& attributes) {
  Element("line", fmt::format("x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}", from.x,
                              from.y, to.x, to.y, attributes));
}

void Svg::Rectangle(const Point& corner, double width, double height,
                    const std::string& attributes) {
  Element("rect", fmt::format("x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" {}",
                              corner.x, corner.y, width, height, attributes));
}

void Svg::Circle(const Point& centre, double radius, const std::string& attributes) {
  Element("circle", fmt::format("cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:.1f}\" {}", centre.x, centre.y,
                                radius, attributes));
}

void Svg::Polygon(const std::vector<Point>& points, const std::string& attributes,
                  const std::string& title) {
  text_ += fmt::format("<polygon points=\"{}\" {}", Coordinates(points), attributes);
  text_ += title.empty() ? "/>\n" : fmt::format("><title>{}</title></polygon>\n", Escaped(title));
}

void Svg::Polyline(const std::vector<Point>& points, const std::string& attributes) {
  Element("polyline",
          fmt::format("points=\"{}\" fill=\"none\" {}", Coordinates(points), attributes));
}

void Svg::Text(const Point& at, const std::string& text, const std::string& attributes) {
  text_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" {}>{}</text>\n", at.x, at.y, attributes,
                       Escaped(text));
}

void Svg::Element(const std::string& name, const std::string& attributes) {
  text_ += fmt::format("<{} {}/>\n", name, attributes);
}

}  // namespace volalign
