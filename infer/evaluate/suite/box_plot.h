#pragma once

#include <string>
#include <vector>

namespace volalign {

/// A box of a plot and the values that it stands for.
struct PlotSeries {
  std::string label;
  std::vector<double> values;
};

/// Quartiles by linear interpolation; whiskers reach the farthest values within 1.5 interquartile
/// ranges of the box (Tukey); what lies beyond is drawn point by point.
struct BoxFigures {
  double low = 0, q1 = 0, median = 0, q3 = 0, high = 0;
  std::vector<double> outliers;
};
/// Of at least one value.
BoxFigures FiguresOf(std::vector<double> values);

/// A box plot as an SVG file. Series without values keep their place, empty. `floor`: a dashed line
/// at this value where it is finite.
std::string BoxPlotSvg(const std::string& title, const std::string& axis_title,
                       const std::vector<PlotSeries>& series, double floor);

}  // namespace volalign
