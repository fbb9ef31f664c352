#include "infer/evaluate/suite/box_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace volalign {

namespace {

// Layout, px.
constexpr double kLeft = 70, kTop = 40, kHeight = 300, kStep = 90, kBox = 44, kBottom = 130;
constexpr int kTicks = 6;
constexpr double kWhisker = 1.5;  // interquartile ranges

double InterpolatedQuantile(const std::vector<double>& sorted, double q) {
  const double at = q * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (at - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

std::string Escape(const std::string& text) {
  std::string out;
  for (const char c : text) {
    out += c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '&' ? "&amp;" : std::string(1, c);
  }
  return out;
}

std::string Line(double x1, double y1, double x2, double y2, const char* style) {
  return fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", x1, y1,
                     x2, y2, style);
}

/// A round number not below `raw`: 1, 2 or 5 times a power of ten.
double RoundStep(double raw) {
  const double power = std::pow(10, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw) return factor * power;
  }
  return 10 * power;
}

/// Axis values to picture heights.
struct Scale {
  double low = 0, step = 1;
  int ticks = kTicks;
  double Y(double value) const { return kTop + kHeight * (1 - (value - low) / (step * ticks)); }
};

Scale ScaleOf(const std::vector<PlotSeries>& series, double floor) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  const auto include = [&](double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  };
  for (const PlotSeries& one : series) std::for_each(one.values.begin(), one.values.end(), include);
  if (std::isfinite(floor)) include(floor);
  if (!(low <= high)) return {};
  Scale scale;
  scale.step = RoundStep(std::max(high - low, 1e-9) / (kTicks - 1));
  scale.low = scale.step * std::floor(low / scale.step);
  scale.ticks = std::max(1, static_cast<int>(std::ceil((high - scale.low) / scale.step)));
  return scale;
}

std::string Box(const PlotSeries& one, double x, const Scale& scale) {
  if (one.values.empty()) return "";
  const BoxFigures box = FiguresOf(one.values);
  const char* thin = "stroke=\"#333\"";
  std::string svg = Line(x, scale.Y(box.low), x, scale.Y(box.q1), thin) +
                    Line(x, scale.Y(box.q3), x, scale.Y(box.high), thin);
  for (const double end : {box.low, box.high})
    svg += Line(x - kBox / 4, scale.Y(end), x + kBox / 4, scale.Y(end), thin);
  svg += fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"#9ecae1\" "
      "stroke=\"#333\"/>\n",
      x - kBox / 2, scale.Y(box.q3), kBox, scale.Y(box.q1) - scale.Y(box.q3));
  svg += Line(x - kBox / 2, scale.Y(box.median), x + kBox / 2, scale.Y(box.median),
              "stroke=\"#d62728\" stroke-width=\"2\"");
  for (const double value : box.outliers) {
    svg += fmt::format(
        "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2.5\" fill=\"none\" stroke=\"#333\"/>\n", x,
        scale.Y(value));
  }
  return svg;
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

std::string BoxPlotSvg(const std::string& title, const std::string& axis,
                       const std::vector<PlotSeries>& series, double floor) {
  const Scale scale = ScaleOf(series, floor);
  const double width = kLeft + kStep * static_cast<double>(series.size()) + 20;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "fill=\"white\"/>\n<text x=\"{2:.0f}\" y=\"22\" font-size=\"14\">{3}</text>\n",
      width, kTop + kHeight + kBottom, kLeft, Escape(title));
  for (int tick = 0; tick <= scale.ticks; ++tick) {
    const double value = scale.low + tick * scale.step;
    svg += Line(kLeft, scale.Y(value), width - 10, scale.Y(value), "stroke=\"#ddd\"");
    svg += fmt::format("<text x=\"{:.0f}\" y=\"{:.1f}\" text-anchor=\"end\">{:.6g}</text>\n",
                       kLeft - 6, scale.Y(value) + 4, value);
  }
  if (std::isfinite(floor)) {
    svg += Line(kLeft, scale.Y(floor), width - 10, scale.Y(floor),
                "stroke=\"#2ca02c\" stroke-dasharray=\"5 4\"");
  }
  for (std::size_t i = 0; i < series.size(); ++i) {
    const double x = kLeft + kStep * (static_cast<double>(i) + 0.5);
    svg += Box(series[i], x, scale);
    svg += fmt::format(
        "<text x=\"{0:.1f}\" y=\"{1:.1f}\" text-anchor=\"end\" transform=\"rotate(-35 {0:.1f} "
        "{1:.1f})\">{2}</text>\n",
        x + 10, kTop + kHeight + 18, Escape(series[i].label));
  }
  return svg + fmt::format(
                   "<text x=\"14\" y=\"{0:.0f}\" transform=\"rotate(-90 14 {0:.0f})\" "
                   "text-anchor=\"middle\">{1}</text>\n</svg>\n",
                   kTop + kHeight / 2, Escape(axis));
}

}  // namespace volalign
