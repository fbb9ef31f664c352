#include "infer/evaluate/suite/box_plot.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/plot/svg.h"

namespace volalign {

namespace {

// Layout, px.
constexpr double kLeft = 70, kTop = 40, kHeight = 300, kStep = 90, kBox = 44, kBottom = 130;
constexpr double kWhisker = 1.5;  // interquartile ranges
constexpr char kThin[] = "stroke=\"#333\"";

double InterpolatedQuantile(const std::vector<double>& sorted, double q) {
  const double at = q * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (at - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

void DrawBox(const BoxFigures& box, double x, const PlotAxis& axis, Svg* svg) {
  svg->Line({x, axis.At(box.low)}, {x, axis.At(box.q1)}, kThin);
  svg->Line({x, axis.At(box.q3)}, {x, axis.At(box.high)}, kThin);
  for (const double end : {box.low, box.high})
    svg->Line({x - kBox / 4, axis.At(end)}, {x + kBox / 4, axis.At(end)}, kThin);
  svg->Rectangle({x - kBox / 2, axis.At(box.q3)}, kBox, axis.At(box.q1) - axis.At(box.q3),
                 "fill=\"#9ecae1\" stroke=\"#333\"");
  svg->Line({x - kBox / 2, axis.At(box.median)}, {x + kBox / 2, axis.At(box.median)},
            "stroke=\"#d62728\" stroke-width=\"2\"");
  for (const double value : box.outliers)
    svg->Circle({x, axis.At(value)}, 2.5, "fill=\"none\" stroke=\"#333\"");
}

}  // namespace

BoxFigures FiguresOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  BoxFigures box;
  box.q1 = InterpolatedQuantile(values, 0.25);
  box.median = InterpolatedQuantile(values, 0.5);
  box.q3 = InterpolatedQuantile(values, 0.75);
  const double reach = kWhisker * (box.q3 - box.q1);
  box.low = box.q1;
  box.high = box.q3;
  for (const double value : values) {
    if (value < box.q1 - reach || value > box.q3 + reach) {
      box.outliers.push_back(value);
    } else {
      box.low = std::min(box.low, value);
      box.high = std::max(box.high, value);
    }
  }
  return box;
}

std::string BoxPlotSvg(const std::string& title, const std::string& axis_title,
                       const std::vector<PlotSeries>& series, double floor) {
  std::vector<double> all{floor};
  for (const PlotSeries& one : series) all.insert(all.end(), one.values.begin(), one.values.end());
  const PlotAxis axis = PlotAxis::Of(all, kTop + kHeight, kTop).RoundedOut();
  const double width = kLeft + kStep * static_cast<double>(series.size()) + 20;
  Svg svg(width, kTop + kHeight + kBottom);
  svg.Text({kLeft, 22}, title, "font-size=\"14\"");
  svg.Grid(axis, kLeft, width - 10);
  if (std::isfinite(floor)) {
    svg.Line({kLeft, axis.At(floor)}, {width - 10, axis.At(floor)},
             "stroke=\"#2ca02c\" stroke-dasharray=\"5 4\"");
  }
  for (std::size_t i = 0; i < series.size(); ++i) {
    const double x = kLeft + kStep * (static_cast<double>(i) + 0.5);
    if (!series[i].values.empty()) DrawBox(FiguresOf(series[i].values), x, axis, &svg);
    svg.TurnedText({x + 10, kTop + kHeight + 18}, -35, series[i].label, "text-anchor=\"end\"");
  }
  svg.TurnedText({14, kTop + kHeight / 2}, -90, axis_title, "text-anchor=\"middle\"");
  return svg.Finished();
}

}  // namespace volalign
