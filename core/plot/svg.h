#pragma once

#include <string>
#include <vector>

namespace volalign {

/// An axis of a plot: values from `low` to `high` are drawn between the px `from` and `to`.
struct PlotAxis {
  double low = 0, high = 1;
  double from = 0, to = 1;

  /// From the least to the largest finite one of `values`. Where there is only one, it stands in
  /// the middle of half to one and a half times it.
  static PlotAxis Of(const std::vector<double>& values, double from, double to);

  double At(double value) const { return from + (value - low) / (high - low) * (to - from); }
  /// 1, 2 or 5 times a power of ten, whichever makes about five steps.
  double Step() const;
  /// The multiples of Step() on the axis.
  std::vector<double> Ticks() const;
  /// With the first and the last of its ticks at its ends.
  PlotAxis RoundedOut() const;
};

/// A picture as SVG, drawn element by element, later ones above earlier ones. Lengths are px, y is
/// downwards. `attributes` are written as they are ("stroke=\"#444\""); texts, and titles, which
/// show up where a pointer rests, are escaped.
class Svg {
 public:
  struct Point {
    double x = 0, y = 0;
  };

  /// White; x begins at `left`, y at 0. `css`: rules of the classes that the attributes name.
  Svg(double width, double height, const std::string& css = "", double left = 0);

  void Line(const Point& from, const Point& to, const std::string& attributes);
  void Rectangle(const Point& corner, double width, double height, const std::string& attributes,
                 const std::string& title = "");
  void Circle(const Point& centre, double radius, const std::string& attributes);
  /// Closed.
  void Polygon(const std::vector<Point>& points, const std::string& attributes,
               const std::string& title = "");
  void Polyline(const std::vector<Point>& points, const std::string& attributes);
  void Text(const Point& at, const std::string& text, const std::string& attributes = "");
  /// About `at`, clockwise.
  void TurnedText(const Point& at, double deg, const std::string& text,
                  const std::string& attributes);
  /// An element without content.
  void Element(const std::string& name, const std::string& attributes);

  /// Horizontal lines at the ticks of a vertical axis, with their values to the left.
  void Grid(const PlotAxis& y, double left, double right);

  /// The file's text.
  std::string Finished() const { return text_ + "</svg>\n"; }

 private:
  void Close(const std::string& name, const std::string& title);

  std::string text_;
};

}  // namespace volalign
