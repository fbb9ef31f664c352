#pragma once

#include <string>
#include <vector>

namespace volalign {

/// A picture as SVG, drawn element by element, later ones above earlier ones. Lengths are px, y is
/// downwards. `attributes` are written unchanged ("stroke=\"#444\""). Texts are escaped, as are
/// titles, which appear where a pointer rests.
class Svg {
 public:
  struct Point {
    double x = 0, y = 0;
  };

  /// White; x begins at `left`, y at 0. `css`: rules of the classes that the attributes name.
  Svg(double width, double height, const std::string& css = "", double left = 0);

  void Line(const Point& from, const Point& to, const std::string& attributes);
  void Rectangle(const Point& corner, double width, double height, const std::string& attributes);
  void Circle(const Point& centre, double radius, const std::string& attributes);
  /// A closed polygon.
  void Polygon(const std::vector<Point>& points, const std::string& attributes,
               const std::string& title = "");
  void Polyline(const std::vector<Point>& points, const std::string& attributes);
  void Text(const Point& at, const std::string& text, const std::string& attributes = "");
  /// An element without content.
  void Element(const std::string& name, const std::string& attributes);

  /// The file's text.
  std::string Finished() const { return text_ + "</svg>\n"; }

 private:
  std::string text_;
};

}  // namespace volalign
