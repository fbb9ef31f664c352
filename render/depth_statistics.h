#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"

namespace volalign {

/// Statistics of depth frames without labels, to compare rendered and real frames.
/// docs/sensor-models.md has those of real frames as "measured". Frames of one sensor kind are
/// pooled with Add.
///
/// Local residual: 9x9 windows without holes. A plane is fitted to inverse depth (a plane in space
/// is one in 1/z, at the pixels' places without a lens). The residual is in mm at the window's
/// depth. A bin has the lower quartile over its windows, which excludes edges and bent surfaces.
///
/// Whole faces: planes grow from the flattest windows and are refitted meanwhile. They take all
/// pixels within 12 mm, or more for the noise of stereo. Residuals are those of the plane's pixels
/// and of its 7x7 means.
///
/// Edges: runs of zeros between two valid pixels of a row or column whose depths differ by more
/// than 300 mm.
class DepthStatistics {
 public:
  struct Options {
    /// Noise grows with z^2, so the tolerance of planes does, too.
    bool stereo = false;
  };
  explicit DepthStatistics(const Options& options) : options_(options) {}

  /// `depth` in m, 0 for no measurement. Throws Error if the sizes differ from the intrinsics'.
  void Add(const DepthImage& depth, const Intrinsics& intrinsics);

  /// Sides of the structure of at least 0.3 % of the image. A plane is fitted to the pixels of each
  /// side label without its border and without outliers beyond 40 mm. `labels` has the size of
  /// `measured`.
  void AddSides(const DepthImage& measured, const LabelImage& labels, const Intrinsics& intrinsics);

  const Options& options() const { return options_; }
  int frames() const { return frames_; }
  double valid_share() const;
  /// Holes inside the convex hull of the valid pixels. `hull_share` is the hull's share of the
  /// image.
  double hole_share() const;
  double hull_share() const;

  /// Lower edges of the distance bins, m; the last entry closes the last bin.
  static constexpr std::array<double, 6> kDistances{1.0, 1.5, 2.0, 2.5, 3.5, 5.5};
  /// Lower edges of the incidence bins, deg.
  static constexpr std::array<double, 4> kIncidences{0, 40, 60, 80};
  /// mm; negative if the bin has fewer than 60 windows.
  double LocalResidual(std::size_t distance, std::size_t incidence) const;
  /// Correlation of neighbouring residuals along rows, in the same windows; 0 without windows.
  double LocalCorrelation(std::size_t distance, std::size_t incidence) const;

  struct Plane {
    double distance = 0;  ///< m, median
    int pixels = 0;
    double rms_mm = 0;     ///< of the pixels
    double smooth_mm = 0;  ///< of 7x7 means
  };
  const std::vector<Plane>& planes() const { return planes_; }
  /// Median over the planes of a distance bin, mm; negative if there is none.
  double PlaneResidual(std::size_t distance, bool smooth) const;
  int PlaneCount(std::size_t distance) const;

  /// Residuals to the fitted planes of the structure's sides.
  const std::vector<Plane>& sides() const { return sides_; }
  /// Median over the sides of all distances, in mm or in disparity, where the noise of stereo is
  /// constant. Disparity is in px of a D415's native resolution (f B = 51.9 px m). Negative without
  /// sides.
  double SideResidual(bool in_disparity) const;

  /// Shares of the edges with a gap of 0, 1, 2, 3, 4-12 and more px.
  std::array<double, 6> GapShares() const;
  /// Share of jumps between two pixels with a pixel at mid-depth (20-80 %) between them.
  double FlyingShare() const;

 private:
  struct Window {
    double rms_mm, correlation;
  };
  void AddHoles(const DepthImage& depth);
  void AddEdges(const DepthImage& depth);
  void AddSurfaces(const DepthImage& measured, const Intrinsics& intrinsics);

  Options options_;
  int frames_ = 0;
  double pixels_ = 0, valid_ = 0, hull_ = 0;
  std::array<double, 6> gaps_{};
  double flying_ = 0;
  std::array<std::array<std::vector<Window>, 3>, 5> windows_;
  std::vector<Plane> planes_, sides_;
};

/// Markdown table with a column per set; names and sets are parallel.
std::string StatisticsTable(const std::vector<std::string>& names,
                            const std::vector<const DepthStatistics*>& sets);

}  // namespace volalign
