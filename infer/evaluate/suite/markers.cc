#include "infer/evaluate/suite/markers.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/aruco.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/base/error.h"
#include "core/geometry/procrustes.h"

namespace volalign {

namespace {

constexpr int kDictionary = cv::aruco::DICT_4X4_50;
constexpr int kMarkerCount = 50;
constexpr int kBorderCells = 1;
constexpr double kCornerWindow = 0.05;  // half of it, of the marker's width
constexpr int kLargestWindow = 5;       // px, half of it
// Markers seen at over 75 deg are not used: their cells are too narrow to refine corners in, and
// their depth jumps from pixel to pixel.
constexpr double kLeastSlant = 0.25;
constexpr double kCover = 1e-3;  // m above a side where another box covers it

bool Covered(const Structure& structure, const Side& side) {
  return structure.Contains(side.centre + kCover * side.normal);
}

using MarkerCorners = std::vector<std::vector<cv::Point2f>>;

// OpenCV 4.7 has a new interface to markers.
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
int CellsOfSide() { return cv::aruco::getPredefinedDictionary(kDictionary)->markerSize; }

void Draw(int label, int cells, cv::Mat* drawn) {
  cv::aruco::drawMarker(cv::aruco::getPredefinedDictionary(kDictionary), label, cells, *drawn,
                        kBorderCells);
}

void Detect(const cv::Mat& image, MarkerCorners* corners, std::vector<int>* ids) {
  cv::aruco::detectMarkers(image, cv::aruco::getPredefinedDictionary(kDictionary), *corners, *ids);
}
#else
int CellsOfSide() { return cv::aruco::getPredefinedDictionary(kDictionary).markerSize; }

void Draw(int label, int cells, cv::Mat* drawn) {
  cv::aruco::generateImageMarker(cv::aruco::getPredefinedDictionary(kDictionary), label, cells,
                                 *drawn, kBorderCells);
}

void Detect(const cv::Mat& image, MarkerCorners* corners, std::vector<int>* ids) {
  const cv::aruco::ArucoDetector detector(cv::aruco::getPredefinedDictionary(kDictionary));
  detector.detectMarkers(image, *corners, *ids);
}
#endif

GreyImage Cells(int label) {
  const int cells = CellsOfSide() + 2 * kBorderCells;
  cv::Mat drawn;
  Draw(label, cells, &drawn);
  GreyImage image(cells, cells);
  for (int v = 0; v < cells; ++v) {
    for (int u = 0; u < cells; ++u) image(u, v) = drawn.at<std::uint8_t>(v, u);
  }
  return image;
}

/// The intersection of a quadrilateral's diagonals: the picture of a square's middle.
Eigen::Vector2d MeetingPoint(const std::array<Eigen::Vector2d, 4>& corners) {
  const Eigen::Vector2d a = corners[2] - corners[0], b = corners[3] - corners[1];
  const Eigen::Vector2d c = corners[1] - corners[0];
  const double s = (c.x() * b.y() - c.y() * b.x()) / (a.x() * b.y() - a.y() * b.x());
  return corners[0] + s * a;
}

/// A marker's picture, px: its longest edge, and its width at a right angle to it.
struct Extent {
  double length = 0, width = 0;
};
Extent ExtentOf(const std::vector<cv::Point2f>& corners) {
  Extent extent;
  for (std::size_t k = 0; k < 4; ++k)
    extent.length = std::max(extent.length, cv::norm(corners[k] - corners[(k + 1) % 4]));
  const cv::Point2f a = corners[2] - corners[0], b = corners[3] - corners[1];
  extent.width = 0.5 * std::abs(a.cross(b)) / extent.length;
  return extent;
}

/// Refines below a pixel, in windows with no edges but the corner's own. OpenCV does so from 4.7
/// on; here windows follow the marker's width, so that slanted markers are no exception.
void RefineCorners(const cv::Mat& image, std::vector<cv::Point2f>* corners) {
  const int window =
      std::clamp(static_cast<int>(kCornerWindow * ExtentOf(*corners).width), 1, kLargestWindow);
  cv::cornerSubPix(image, *corners, cv::Size(window, window), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01));
}

/// The point, sensor frame, at a position between pixel centres. Its ray and its inverse depth,
/// which is linear on a plane, are interpolated from the four pixels around it. Nothing if one of
/// them has no depth.
std::optional<Eigen::Vector3d> PointAt(const SensorView& view, const Eigen::Vector2d& pixel) {
  const int left = static_cast<int>(std::floor(pixel.x()));
  const int top = static_cast<int>(std::floor(pixel.y()));
  if (!view.depth.Contains(left, top) || !view.depth.Contains(left + 1, top + 1))
    return std::nullopt;
  Eigen::Vector2d ray = Eigen::Vector2d::Zero();
  double inverse = 0;
  for (int k = 0; k < 4; ++k) {
    const int u = left + k % 2, v = top + k / 2;
    if (!(view.depth(u, v) > 0)) return std::nullopt;
    const double weight = (1 - std::abs(pixel.x() - u)) * (1 - std::abs(pixel.y() - v));
    ray += weight * view.rays.at(u, v).cast<double>();
    inverse += weight / view.depth(u, v);
  }
  return Eigen::Vector3d(ray.x() / inverse, ray.y() / inverse, 1 / inverse);
}

}  // namespace

std::vector<MarkerPrint> StructureMarkers(const Structure& structure) {
  if (structure.num_classes() > kMarkerCount) {
    throw Error("StructureMarkers: more sides than the dictionary has markers (50)");
  }
  std::vector<MarkerPrint> prints;
  for (int label = 1; label < structure.num_classes(); ++label) {
    if (!Covered(structure, structure.SideOfLabel(label))) prints.push_back({label, Cells(label)});
  }
  return prints;
}

std::vector<FoundMarker> FindMarkers(const GreyImage& infrared, const Structure& structure) {
  const cv::Mat image(infrared.height(), infrared.width(), CV_8UC1,
                      const_cast<std::uint8_t*>(infrared.data()));
  MarkerCorners corners;
  std::vector<int> ids;
  Detect(image, &corners, &ids);
  std::vector<FoundMarker> found;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] < 1 || ids[i] >= structure.num_classes() ||
        Covered(structure, structure.SideOfLabel(ids[i]))) {
      continue;
    }
    const Extent extent = ExtentOf(corners[i]);
    if (extent.width < kLeastSlant * extent.length) continue;
    RefineCorners(image, &corners[i]);
    FoundMarker marker;
    marker.label = ids[i];
    for (std::size_t k = 0; k < 4; ++k) marker.corners[k] = {corners[i][k].x, corners[i][k].y};
    marker.centre = MeetingPoint(marker.corners);
    found.push_back(marker);
  }
  return found;
}

std::optional<Pose> EstimateMarkerPose(const SensorView& view, const Intrinsics& infrared,
                                       const std::vector<FoundMarker>& markers,
                                       const Structure& structure) {
  // Both images show the same field of view; pixel centres are at integers.
  const double scale_u = static_cast<double>(view.width()) / infrared.width;
  const double scale_v = static_cast<double>(view.height()) / infrared.height;
  std::vector<Eigen::Vector3d> source, target;
  for (const FoundMarker& marker : markers) {
    const Eigen::Vector2d pixel((marker.centre.x() + 0.5) * scale_u - 0.5,
                                (marker.centre.y() + 0.5) * scale_v - 0.5);
    const std::optional<Eigen::Vector3d> point = PointAt(view, pixel);
    if (!point) continue;
    source.push_back(*point);
    target.push_back(structure.SideOfLabel(marker.label).centre);
  }
  if (source.size() < 3 || !(SecondSingularValue(target) > kMinSecondSingularValue))
    return std::nullopt;
  return AlignPoints(source, target).target_from_source;
}

}  // namespace volalign
