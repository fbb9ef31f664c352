#include "train/log/run_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/plot/svg.h"

namespace volalign {
namespace {

// Sizes in the units of the picture.
constexpr double kPlotWidth = 720, kPanel = 300, kLegendLine = 20;
constexpr double kLeft = 70, kRight = 30, kTop = 34, kBottom = 40;
constexpr std::size_t kLegendLetters = 85;  // in a line: 7 px each
constexpr char kFrame[] = "stroke=\"#444\"";
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

std::vector<Svg::Point> Points(const std::vector<double>& xs, const std::vector<double>& ys,
                               const PlotAxis& x, const PlotAxis& y) {
  std::vector<Svg::Point> points;
  for (std::size_t i = 0; i < xs.size(); ++i) {
    if (std::isfinite(ys[i])) points.push_back({x.At(xs[i]), y.At(ys[i])});
  }
  return points;
}

void DrawFrame(const PlotAxis& x, const PlotAxis& y, const std::string& title, Svg* svg) {
  svg->Grid(y, x.from, x.to);
  for (const double tick : x.Ticks()) {
    svg->Line({x.At(tick), y.from}, {x.At(tick), y.from + 5}, kFrame);
    svg->Text({x.At(tick), y.from + 18}, fmt::format("{:g}", tick), "text-anchor=\"middle\"");
  }
  svg->Line({x.from, y.to}, {x.from, y.from}, kFrame);
  svg->Line({x.from, y.from}, {x.to, y.from}, kFrame);
  svg->Text({x.from, y.to - 10}, title);
  svg->Text({x.to, y.from + 34}, "samples", "text-anchor=\"end\"");
}

void DrawPanel(const std::vector<RunGroup>& groups, const std::string& metric, double top,
               Svg* svg) {
  std::vector<Band> bands;
  std::vector<double> xs, ys;
  for (const RunGroup& group : groups) {
    bands.push_back(BandOf(group, metric));
    const Band& band = bands.back();
    xs.insert(xs.end(), band.samples.begin(), band.samples.end());
    ys.insert(ys.end(), band.least.begin(), band.least.end());
    ys.insert(ys.end(), band.largest.begin(), band.largest.end());
  }
  const PlotAxis x = PlotAxis::Of(xs, kLeft, kPlotWidth - kRight);
  const PlotAxis y = PlotAxis::Of(ys, top + kPanel - kBottom, top + kTop);
  DrawFrame(x, y, metric, svg);
  for (std::size_t i = 0; i < bands.size(); ++i) {
    const char* colour = kColours[i % kColours.size()];
    const Band& band = bands[i];
    if (groups[i].runs.size() > 1) {
      std::vector<double> around = band.samples, edge = band.least;
      around.insert(around.end(), band.samples.rbegin(), band.samples.rend());
      edge.insert(edge.end(), band.largest.rbegin(), band.largest.rend());
      svg->Polygon(Points(around, edge, x, y),
                   fmt::format("fill=\"{}\" fill-opacity=\"0.2\"", colour));
    }
    svg->Polyline(Points(band.samples, band.mean, x, y),
                  fmt::format("stroke=\"{}\" stroke-width=\"1.5\"", colour));
  }
}

/// What a group is called, in lines that fit beside its colour, broken behind commas.
std::vector<std::string> LegendLines(const RunGroup& group) {
  std::vector<std::string> lines;
  for (const std::string& part : Split(group.Label(), ',')) {
    if (lines.empty()) {
      lines.push_back(part);
    } else if (lines.back().size() + part.size() < kLegendLetters) {
      lines.back() += "," + part;
    } else {
      lines.back() += ",";
      lines.push_back(part.substr(std::min(part.find_first_not_of(' '), part.size())));
    }
  }
  return lines;
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
  std::vector<std::vector<std::string>> names;
  std::size_t lines = spread ? 1 : 0;
  for (const RunGroup& group : groups) {
    names.push_back(LegendLines(group));
    lines += names.back().size();
  }
  const double height = legend + kLegendLine * static_cast<double>(lines) + 10;
  Svg svg(kPlotWidth, height);
  for (std::size_t i = 0; i < metrics.size(); ++i) {
    DrawPanel(groups, metrics[i], kPanel * static_cast<double>(i), &svg);
  }
  double y = legend + 0.5 * kLegendLine;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    svg.Line({kLeft, y}, {kLeft + 24, y},
             fmt::format("stroke=\"{}\" stroke-width=\"3\"", kColours[i % kColours.size()]));
    for (const std::string& line : names[i]) {
      svg.Text({kLeft + 32, y + 4}, line);
      y += kLegendLine;
    }
  }
  if (spread) {
    svg.Text({kLeft, height - 0.5 * kLegendLine},
             "lines: mean of the runs; bands: from the least to the largest of them");
  }
  return svg.Finished();
}

}  // namespace volalign
