#include "train/run_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>

#include "core/error.h"

namespace volalign {
namespace {

// Sizes in the units of the picture.
constexpr double kWidth = 720, kPanel = 300, kLegendLine = 20;
constexpr double kLeft = 70, kRight = 20, kTop = 34, kBottom = 40;
constexpr int kTicks = 5;
/// Of Okabe and Ito, which people with any colour vision tell apart.
constexpr std::array<const char*, 8> kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                 "#e69f00", "#56b4e9", "#000000", "#8a8a00"};

/// Mean, least and largest of a group's runs at the samples that all of them have.
struct Band {
  std::vector<double> samples, mean, least, largest;
};

Band BandOf(const RunGroup& group, const std::string& metric) {
  Band band;
  std::map<std::int64_t, std::vector<double>> values;
  for (const LoggedRun& run : group.runs) {
    const auto curve = run.curves.find(metric);
    if (curve == run.curves.end()) continue;
    for (std::size_t i = 0; i < curve->second.samples.size(); ++i) {
      values[curve->second.samples[i]].push_back(curve->second.values[i]);
    }
  }
  for (const auto& [samples, all] : values) {
    if (all.size() < group.runs.size()) continue;
    double sum = 0;
    for (double v : all) sum += v;
    band.samples.push_back(static_cast<double>(samples));
    band.mean.push_back(sum / static_cast<double>(all.size()));
    band.least.push_back(*std::min_element(all.begin(), all.end()));
    band.largest.push_back(*std::max_element(all.begin(), all.end()));
  }
  return band;
}

/// An axis: values low to high become from to to.
struct Axis {
  double low, high, from, to;
  double At(double value) const { return from + (value - low) / (high - low) * (to - from); }

  /// Round values: 1, 2 or 5 times a power of ten apart.
  std::vector<double> Ticks() const {
    const double rough = (high - low) / kTicks;
    const double power = std::pow(10.0, std::floor(std::log10(rough)));
    const double share = rough / power;
    const double step = power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
    std::vector<double> ticks;
    for (double k = std::ceil(low / step); k * step <= high + 1e-9 * step; ++k) {
      ticks.push_back(k == 0 ? 0 : k * step);
    }
    return ticks;
  }
};

Axis AxisOf(const std::vector<std::vector<double>>& all, double from, double to) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const std::vector<double>& values : all) {
    for (double v : values) {
      if (!std::isfinite(v)) continue;
      low = std::min(low, v);
      high = std::max(high, v);
    }
  }
  if (!(low < high)) {
    low = std::isfinite(low) ? low - 0.5 : 0;
    high = low + 1;
  }
  return {low, high, from, to};
}

std::string Escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    escaped += c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '&' ? "&amp;" : std::string(1, c);
  }
  return escaped;
}

std::string Text(double x, double y, const char* anchor, const std::string& text) {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>\n", x, y, anchor,
                     Escaped(text));
}

std::string Points(const std::vector<double>& xs, const std::vector<double>& ys, const Axis& x,
                   const Axis& y) {
  std::string points;
  for (std::size_t i = 0; i < xs.size(); ++i) {
    if (!std::isfinite(ys[i])) continue;
    points += fmt::format("{:.1f},{:.1f} ", x.At(xs[i]), y.At(ys[i]));
  }
  return points;
}

std::string Frame(const Axis& x, const Axis& y, const std::string& title) {
  std::string svg;
  for (const double tick : y.Ticks()) {
    svg += fmt::format("<path d=\"M{:.1f} {:.1f}H{:.1f}\" stroke=\"#ddd\"/>\n", x.from, y.At(tick),
                       x.to);
    svg += Text(x.from - 6, y.At(tick) + 4, "end", fmt::format("{:g}", tick));
  }
  for (const double tick : x.Ticks()) {
    svg += fmt::format("<path d=\"M{:.1f} {:.1f}v5\" stroke=\"#444\"/>\n", x.At(tick), y.from);
    svg += Text(x.At(tick), y.from + 18, "middle", fmt::format("{:g}", tick));
  }
  svg += fmt::format("<path d=\"M{:.1f} {:.1f}V{:.1f}H{:.1f}\" fill=\"none\" stroke=\"#444\"/>\n",
                     x.from, y.to, y.from, x.to);
  svg += Text(x.from, y.to - 10, "start", title);
  return svg + Text(x.to, y.from + 34, "end", "samples");
}

std::string Panel(const std::vector<RunGroup>& groups, const std::string& metric, double top) {
  std::vector<Band> bands;
  std::vector<std::vector<double>> xs, ys;
  for (const RunGroup& group : groups) {
    bands.push_back(BandOf(group, metric));
    xs.push_back(bands.back().samples);
    ys.push_back(bands.back().least);
    ys.push_back(bands.back().largest);
  }
  const Axis x = AxisOf(xs, kLeft, kWidth - kRight);
  const Axis y = AxisOf(ys, top + kPanel - kBottom, top + kTop);
  std::string svg = Frame(x, y, metric);
  for (std::size_t i = 0; i < bands.size(); ++i) {
    const char* colour = kColours[i % kColours.size()];
    const Band& band = bands[i];
    if (groups[i].runs.size() > 1) {
      std::vector<double> around = band.samples, edge = band.least;
      around.insert(around.end(), band.samples.rbegin(), band.samples.rend());
      edge.insert(edge.end(), band.largest.rbegin(), band.largest.rend());
      svg += fmt::format("<polygon points=\"{}\" fill=\"{}\" fill-opacity=\"0.2\"/>\n",
                         Points(around, edge, x, y), colour);
    }
    svg +=
        fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\"/>\n",
                    Points(band.samples, band.mean, x, y), colour);
  }
  return svg;
}

void RequireMetrics(const std::vector<RunGroup>& groups, const std::vector<std::string>& metrics) {
  std::set<std::string> known;
  for (const RunGroup& group : groups) {
    for (const LoggedRun& run : group.runs) {
      for (const auto& [name, unused] : run.curves) known.insert(name);
    }
  }
  for (const std::string& metric : metrics) {
    if (known.count(metric) > 0) continue;
    throw ConfigError(
        fmt::format("no run has the metric '{}'; there are {}", metric, fmt::join(known, ", ")));
  }
}

}  // namespace

std::string PlotRuns(const std::vector<RunGroup>& groups, const std::vector<std::string>& metrics) {
  RequireMetrics(groups, metrics);
  const double legend = kPanel * static_cast<double>(metrics.size());
  const bool spread = std::any_of(groups.begin(), groups.end(),
                                  [](const RunGroup& group) { return group.runs.size() > 1; });
  const double height =
      legend + kLegendLine * static_cast<double>(groups.size() + (spread ? 1 : 0)) + 10;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:g} {1:g}\" width=\"{0:g}\" "
      "height=\"{1:g}\" font-family=\"sans-serif\" font-size=\"12\">\n"
      "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
      kWidth, height);
  for (std::size_t i = 0; i < metrics.size(); ++i) {
    svg += Panel(groups, metrics[i], kPanel * static_cast<double>(i));
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const double y = legend + kLegendLine * (static_cast<double>(i) + 0.5);
    svg += fmt::format("<path d=\"M{:g} {:.1f}h24\" stroke=\"{}\" stroke-width=\"3\"/>\n", kLeft, y,
                       kColours[i % kColours.size()]);
    const std::size_t runs = groups[i].runs.size();
    svg += Text(kLeft + 32, y + 4, "start",
                runs == 1 ? fmt::format("{} ({})", groups[i].Label(), groups[i].runs[0].name)
                          : fmt::format("{} ({} runs)", groups[i].Label(), runs));
  }
  if (spread) {
    svg += Text(kLeft, height - 0.5 * kLegendLine, "start",
                "lines: mean of the runs; bands: from the least to the largest of them");
  }
  return svg + "</svg>\n";
}

}  // namespace volalign
