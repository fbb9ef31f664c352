#include "infer/evaluate/suite/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/formats/image_io.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "core/plot/picture_text.h"
#include "infer/evaluate/suite/method_set.h"
#include "infer/evaluate/suite/suite_items.h"
#include "infer/segment/attention.h"

namespace volalign {

namespace {

constexpr double kPixel = 0.005;        // m, of a drawn cloud
constexpr double kMargin = 0.1;         // m, around the structure
constexpr double kWorst = 0.05;         // m, drawn yellow
constexpr int kBlot = 1;                // px around a point
constexpr double kNoDepthShade = 0.35;  // of an attention map where there is no depth
constexpr double kViews[] = {30, 210};  // deg, from which clouds are drawn

/// A picture of a view, upright if it is known how.
RgbImage DrawView(const SuiteCapture& capture, std::size_t i, const RgbImage& picture,
                  const std::string& caption) {
  const SensorFrame& frame = capture.evaluation.frames[i];
  return Captioned(frame.ground_truth ? Turn(picture, UprightTurns(*frame.ground_truth)) : picture,
                   fmt::format("{} {}", frame.name, caption));
}

std::vector<RgbImage> DrawLabels(const SuiteCapture& capture, const MethodResult& result,
                                 const std::string& method) {
  std::vector<RgbImage> row;
  for (std::size_t i = 0; i < result.labels.size(); ++i) {
    row.push_back(
        DrawView(capture, i, OverlayLabels(capture.views[i].depth, result.labels[i]), method));
  }
  return row;
}

/// Empty for a method without attention. Captions have the least and the largest value.
std::vector<RgbImage> DrawAttentions(const SuiteCapture& capture, const SuiteMethod& method) {
  std::vector<RgbImage> row;
  if (method.model.empty()) return row;
  const std::vector<Image<float>> attention = AttentionMaps(method.model, RequestsOf(capture));
  for (std::size_t i = 0; i < attention.size(); ++i) {
    const Image<float>& map = attention[i];
    if (map.empty()) continue;
    const auto [least, most] = std::minmax_element(map.begin(), map.end());
    row.push_back(DrawView(capture, i, DrawAttention(capture.views[i].depth, map),
                           fmt::format("{}: {:.3f}-{:.3f}", method.name, *least, *most)));
  }
  return row;
}

std::vector<RgbImage> DrawClouds(const SuiteCapture& capture, const MethodResult& result,
                                 PoseStage stage, const std::string& method) {
  const FramePoses* poses = PosesAt(stage, result);
  if (!poses) return {};
  const std::vector<SensorView> views = ViewsAt(stage, capture, result);
  const Structure& structure = capture.evaluation.structure;
  const std::vector<LabelImage>& labels =
      capture.evaluation.labels.empty() ? result.labels : capture.evaluation.labels;
  ErrorCloud cloud;
  for (std::size_t i = 0; i < poses->size() && i < labels.size(); ++i) {
    if ((*poses)[i]) AddToCloud(views[i], labels[i], structure, *(*poses)[i], &cloud);
  }
  std::vector<RgbImage> row;
  for (const double phi : kViews) {
    row.push_back(Captioned(DrawCloud(cloud, structure, phi),
                            fmt::format("{}: from {:.0f} deg", method, phi)));
  }
  return row;
}

/// The row of a method; empty if it has nothing for the figure.
std::vector<RgbImage> DrawRow(const SuiteFigure& figure, const SuiteCapture& capture,
                              MethodSet& methods, std::size_t i) {
  const SuiteMethod& method = methods.at(i);
  if (figure.kind == FigureKind::kAttention) return DrawAttentions(capture, method);
  const MethodResult result = methods.Run(i, capture, 2);
  if (figure.kind == FigureKind::kLabels) return DrawLabels(capture, result, method.name);
  return DrawClouds(capture, result, figure.stage, method.name);
}

const SuiteItem* FindItem(const std::vector<SuiteItem>& items, const std::string& capture) {
  const auto found = std::find_if(items.begin(), items.end(),
                                  [&](const SuiteItem& item) { return item.capture == capture; });
  return found == items.end() ? nullptr : &*found;
}

}  // namespace

RgbImage DrawAttention(const DepthImage& depth, const Image<float>& attention) {
  if (attention.width() != depth.width() || attention.height() != depth.height())
    throw Error("DrawAttention: the depth and the attention have different sizes");
  const Image<float> shades = ShadeDepth(depth);
  RgbImage picture(depth.width(), depth.height());
  for (std::size_t i = 0; i < picture.size(); ++i) {
    const Rgb colour = DepthColour(1 - static_cast<double>(attention[i]));
    const double shade = depth[i] > 0 ? shades[i] : kNoDepthShade;
    picture[i] = {static_cast<std::uint8_t>(colour.r * shade),
                  static_cast<std::uint8_t>(colour.g * shade),
                  static_cast<std::uint8_t>(colour.b * shade)};
  }
  return picture;
}

void AddToCloud(const SensorView& view, const LabelImage& labels, const Structure& structure,
                const Pose& structure_from_sensor, ErrorCloud* cloud) {
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (labels(u, v) == 0 || !(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      cloud->points.push_back(p);
      cloud->distances.push_back(DistanceToSurface(structure, p).distance);
    }
  }
}

RgbImage DrawCloud(const ErrorCloud& cloud, const Structure& structure, double phi_deg) {
  const double phi = phi_deg * kDegree;
  const Eigen::Vector3d towards(std::cos(phi), 0, std::sin(phi));  // the onlooker
  const Eigen::Vector3d right = Eigen::Vector3d::UnitY().cross(towards);
  double reach = 0;
  for (const Side& side : structure.sides())
    reach = std::max(reach, Eigen::Vector2d(side.centre.x(), side.centre.z()).norm() +
                                std::max(side.half_u, side.half_v));
  const double low = structure.FloorHeight() - kMargin;
  const int width = static_cast<int>(2 * (reach + kMargin) / kPixel);
  const int height = static_cast<int>((structure.Height() + 2 * kMargin) / kPixel);
  // ColourDepth has near values yellow, and large errors should be yellow.
  DepthImage values(width, height, 0.0F);
  Image<double> nearness(width, height, -std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const Eigen::Vector3d& p = cloud.points[i];
    const int u = static_cast<int>((right.dot(p) + reach + kMargin) / kPixel);
    const int v = height - 1 - static_cast<int>((p.y() - low) / kPixel);
    for (int dv = -kBlot; dv <= kBlot; ++dv) {
      for (int du = -kBlot; du <= kBlot; ++du) {
        if (!values.Contains(u + du, v + dv)) continue;
        if (towards.dot(p) <= nearness(u + du, v + dv)) continue;
        nearness(u + du, v + dv) = towards.dot(p);
        values(u + du, v + dv) =
            static_cast<float>(2 * kWorst - std::min(cloud.distances[i], kWorst));
      }
    }
  }
  return ColourDepth(values, kWorst, 2 * kWorst);
}

std::vector<std::filesystem::path> WriteFigures(const SuiteConfig& suite, const SuiteRun& run) {
  MethodSet methods(suite, run.program);
  const Structure structure = ReadStructure(Rig().structure);
  WorkerRenderer renderer(run.make_renderer);
  std::vector<std::filesystem::path> files;
  for (const SuiteFigure& figure : suite.figures) {
    std::vector<SuiteItem> items;
    for (const SuiteDataset& dataset : suite.datasets) {
      for (SuiteItem& item : SuiteItems(dataset, structure, methods.HasMarkers(), 0))
        items.push_back(std::move(item));
    }
    const SuiteItem* item = FindItem(items, figure.capture);
    if (!item) {
      throw ConfigError(
          fmt::format("figures: {} is of {}, which no dataset has", figure.name, figure.capture));
    }
    const SuiteCapture capture = LoadSuiteCapture(*item, suite, renderer);
    std::vector<RgbImage> pictures;
    std::size_t columns = 0;
    for (const std::string& name : figure.methods) {
      for (std::size_t i = 0; i < methods.size(); ++i) {
        if (methods.at(i).name != name || !methods.Applies(i, *item)) continue;
        const std::vector<RgbImage> row = DrawRow(figure, capture, methods, i);
        pictures.insert(pictures.end(), row.begin(), row.end());
        columns = std::max(columns, row.size());
      }
    }
    if (pictures.empty()) continue;
    files.push_back(run.output / "figures" / (figure.name + ".png"));
    WritePng(files.back(), Montage(pictures, static_cast<int>(columns)));
  }
  return files;
}

}  // namespace volalign
