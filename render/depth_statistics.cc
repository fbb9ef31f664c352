#include "render/depth_statistics.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/base/statistics.h"
#include "core/geometry/lens.h"

namespace volalign {
namespace {

// Parameters of the method; the header explains them.
constexpr double kFocalBaseline = 51.9;  // px m, D415 at 1280x720
// Windows, for the noise of single pixels.
constexpr int kWindow = 9, kHalfWindow = kWindow / 2, kWindowStep = 4;  // px
constexpr std::size_t kLeastWindows = 60;  // least number for a cell of the table
// Depth edges.
constexpr float kJump = 0.3F;    // m
constexpr int kLongestGap = 60;  // px; longer runs of zeros are no gap of an edge
constexpr float kFlyingLow = 0.2F,
                kFlyingHigh = 0.8F;  // depth of a flying pixel between two others
// Planes, for smooth errors: regions grow from the flattest windows.
constexpr double kPlaneTolerance = 0.012;      // m from the plane
constexpr double kPlaneDisparityNoise = 0.15;  // px, of stereo; 3.5 of it may be off
constexpr int kPlaneGrowths = 12;              // refits of a growing plane
constexpr std::size_t kFirstGrowth = 300,
                      kGrowthFactor = 4;  // most pixels of the first, next growth
constexpr std::size_t kLeastRegion = 30;  // pixels that a refit needs
constexpr double kPlaneShare = 0.006;     // of the image, least size of a plane
// Sides of the structure.
constexpr double kSideOutlier = 0.04;  // m from the side's plane
constexpr double kSideShare = 0.003;   // of the image, least size of a side
constexpr int kSidePasses = 3;         // refits without outliers

/// Inverse depth 1/z = a u + b v + c at straight places (StraightPlaces).
struct InversePlane {
  double a = 0, b = 0, c = 0;
  double Depth(const Eigen::Vector2d& p) const { return 1 / (a * p.x() + b * p.y() + c); }
};

/// Weighted so that residuals count in depth: d(1/z) = -dz / z^2.
class PlaneFit {
 public:
  void Add(const Eigen::Vector2d& p, double z) {
    const Eigen::Vector3d row(p.x() - u0_, p.y() - v0_, 1);
    const double w = z * z * z * z;
    normal_ += w * row * row.transpose();
    right_ += w / z * row;
  }
  void SetOrigin(const Eigen::Vector2d& p) { u0_ = p.x(), v0_ = p.y(); }
  InversePlane Solve() const {
    const Eigen::Vector3d x = normal_.ldlt().solve(right_);
    return {x.x(), x.y(), x.z() - x.x() * u0_ - x.y() * v0_};
  }

 private:
  double u0_ = 0, v0_ = 0;
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right_ = Eigen::Vector3d::Zero();
};

/// The place of each pixel for a camera of the same focal length without a lens. There a plane is a
/// plane in inverse depth.
class StraightPlaces {
 public:
  explicit StraightPlaces(const Intrinsics& k) : width_(k.width) {
    const RayTable rays = ComputeRays(k);
    places_.reserve(rays.rays.size());
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const Eigen::Vector2f& ray = rays.at(u, v);
        places_.push_back(k.distortion.empty()
                              ? Eigen::Vector2d(u, v)
                              : Eigen::Vector2d(k.fx * ray.x() + k.cx, k.fy * ray.y() + k.cy));
      }
    }
  }
  /// NaN where the lens has folded over.
  const Eigen::Vector2d& operator()(int u, int v) const {
    return places_[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(u)];
  }
  /// The depths of the pixels that have a place.
  DepthImage Clean(DepthImage depth) const {
    for (std::size_t i = 0; i < depth.size(); ++i) {
      if (!places_[i].allFinite()) depth[i] = 0;
    }
    return depth;
  }

 private:
  int width_;
  std::vector<Eigen::Vector2d> places_;
};

/// A window without holes and the plane through it.
struct FlatWindow {
  int u, v;           // its middle
  double mean_depth;  // m
  InversePlane plane;
  double rms;          // m
  double correlation;  // of neighbouring residuals along rows
};

using Region = std::vector<std::pair<int, int>>;

/// The plane through a region's pixels; its origin is for the numbers' sake.
InversePlane FitRegion(const DepthImage& depth, const StraightPlaces& places, const Region& region,
                       std::pair<int, int> origin) {
  PlaneFit fit;
  fit.SetOrigin(places(origin.first, origin.second));
  for (const auto& [u, v] : region) fit.Add(places(u, v), depth(u, v));
  return fit.Solve();
}

/// Nothing if a pixel has no depth.
std::optional<FlatWindow> FitWindow(const DepthImage& depth, const StraightPlaces& places, int u,
                                    int v) {
  PlaneFit fit;
  fit.SetOrigin(places(u, v));
  double mean = 0;
  for (int y = v - kHalfWindow; y <= v + kHalfWindow; ++y) {
    for (int x = u - kHalfWindow; x <= u + kHalfWindow; ++x) {
      const double z = depth(x, y);
      if (z <= 0) return std::nullopt;
      fit.Add(places(x, y), z);
      mean += z;
    }
  }
  constexpr double kPixels = kWindow * kWindow;
  FlatWindow window{u, v, mean / kPixels, fit.Solve(), 0, 0};
  double squares = 0, products = 0;
  for (int y = v - kHalfWindow; y <= v + kHalfWindow; ++y) {
    double before = 0;
    for (int x = u - kHalfWindow; x <= u + kHalfWindow; ++x) {
      const double e = depth(x, y) - window.plane.Depth(places(x, y));
      squares += e * e;
      products += e * before;
      before = e;
    }
  }
  window.rms = std::sqrt(squares / (kPixels - 3));
  window.correlation = squares > 0 ? products / squares * kWindow / (kWindow - 1) : 0;
  return window;
}

/// Largest distance, m, from a plane of a pixel with depth z (m) that belongs to it.
double PlaneTolerance(bool stereo, double z) {
  if (!stereo) return kPlaneTolerance;
  return std::max(kPlaneTolerance, 3.5 * kPlaneDisparityNoise * z * z / kFocalBaseline);
}

/// Pixels of the plane of `seed` that no other plane has taken.
Region GrowPlane(const DepthImage& depth, const StraightPlaces& places, bool stereo,
                 const Image<std::uint8_t>& taken, const FlatWindow& seed) {
  Region region;
  InversePlane plane = seed.plane;
  std::size_t before = 0;
  for (int growth = 0; growth < kPlaneGrowths; ++growth) {
    // Limits the growth beyond the fit: a few hundred pixels do not show where a wall ends.
    const std::size_t limit = std::max(kGrowthFactor * before, kFirstGrowth);
    Image<std::uint8_t> seen(depth.width(), depth.height());
    region.assign(1, {seed.u, seed.v});
    seen(seed.u, seed.v) = 1;
    for (std::size_t next = 0; next < region.size() && region.size() < limit; ++next) {
      const auto [u, v] = region[next];
      for (const auto& [du, dv] : kBeside) {
        const int x = u + du, y = v + dv;
        if (!depth.Contains(x, y) || seen(x, y) || taken(x, y)) continue;
        const double z = depth(x, y);
        if (z <= 0 || std::abs(z - plane.Depth(places(x, y))) > PlaneTolerance(stereo, z)) continue;
        seen(x, y) = 1;
        region.emplace_back(x, y);
      }
    }
    if (region.size() < kLeastRegion) break;
    plane = FitRegion(depth, places, region, {seed.u, seed.v});
    if (growth > 3 && region.size() <= before + before / 50) break;
    before = region.size();
  }
  return region;
}

/// Angle between the plane's normal and the ray through a straight place, deg. In space, 1/z = n.r
/// / h.
double Incidence(const InversePlane& p, const Intrinsics& k, const Eigen::Vector2d& place) {
  const Eigen::Vector3d n(p.a * k.fx, p.b * k.fy, p.c + p.a * k.cx + p.b * k.cy);
  const Eigen::Vector3d ray((place.x() - k.cx) / k.fx, (place.y() - k.cy) / k.fy, 1);
  const double cosine = std::abs(n.normalized().dot(ray.normalized()));
  return std::acos(std::min(cosine, 1.0)) * 57.29577951308232;
}

template <std::size_t N>
int Bin(const std::array<double, N>& edges, double x) {
  if (!(x >= edges.front()) || x >= edges.back()) return -1;
  return static_cast<int>(std::upper_bound(edges.begin(), edges.end(), x) - edges.begin()) - 1;
}

/// -1 for no values.
double QuantileOrNone(std::vector<double> values, double q) {
  return values.empty() ? -1 : Quantile(std::move(values), q);
}

/// RMS residual of a region's pixels, and of its 7x7 means, to the plane fitted to them.
DepthStatistics::Plane Residuals(const DepthImage& depth, const StraightPlaces& places,
                                 const Region& region) {
  const int width = depth.width(), height = depth.height();
  const InversePlane plane = FitRegion(depth, places, region, region.front());
  Image<float> residual(width, height);
  Image<std::uint8_t> inside(width, height);
  std::vector<double> depths;
  double squares = 0;
  for (const auto& [u, v] : region) {
    const double e = depth(u, v) - plane.Depth(places(u, v));
    residual(u, v) = static_cast<float>(e);
    inside(u, v) = 1;
    squares += e * e;
    depths.push_back(depth(u, v));
  }
  double smooth = 0, count = 0;
  for (const auto& [u, v] : region) {
    if (u % 3 != 0 || v % 3 != 0) continue;
    double sum = 0, n = 0;
    for (int y = std::max(v - 3, 0); y <= std::min(v + 3, height - 1); ++y) {
      for (int x = std::max(u - 3, 0); x <= std::min(u + 3, width - 1); ++x) {
        if (!inside(x, y)) continue;
        sum += residual(x, y);
        ++n;
      }
    }
    smooth += sum / n * sum / n;
    ++count;
  }
  DepthStatistics::Plane out;
  out.distance = QuantileOrNone(depths, 0.5);
  out.pixels = static_cast<int>(region.size());
  out.rms_mm = 1000 * std::sqrt(squares / static_cast<double>(region.size()));
  out.smooth_mm = count > 0 ? 1000 * std::sqrt(smooth / count) : 0;
  return out;
}

/// Area in pixels of the convex hull of the row spans (Andrew's monotone chain).
double HullArea(const std::vector<std::pair<double, double>>& sorted_points) {
  std::vector<std::pair<double, double>> hull;
  const auto extend = [&](const auto& point, std::size_t least) {
    while (hull.size() >= least) {
      const auto& [ax, ay] = hull[hull.size() - 2];
      const auto& [bx, by] = hull.back();
      if ((bx - ax) * (point.second - ay) - (by - ay) * (point.first - ax) > 0) break;
      hull.pop_back();
    }
    hull.push_back(point);
  };
  for (const auto& point : sorted_points) extend(point, 2);
  const std::size_t lower = hull.size() + 1;
  for (auto it = sorted_points.rbegin(); it != sorted_points.rend(); ++it) extend(*it, lower);
  double twice = 0;
  for (std::size_t i = 0; i + 1 < hull.size(); ++i) {
    twice += hull[i].first * hull[i + 1].second - hull[i + 1].first * hull[i].second;
  }
  return 0.5 * std::abs(twice);
}

}  // namespace

void DepthStatistics::Add(const DepthImage& depth, const Intrinsics& intrinsics) {
  if (depth.width() != intrinsics.width || depth.height() != intrinsics.height) {
    throw Error(fmt::format("depth statistics: the frame is {}x{}, its intrinsics {}x{}",
                            depth.width(), depth.height(), intrinsics.width, intrinsics.height));
  }
  ++frames_;
  AddHoles(depth);
  AddEdges(depth);
  AddSurfaces(depth, intrinsics);
}

void DepthStatistics::AddHoles(const DepthImage& depth) {
  std::vector<std::pair<double, double>> corners;
  for (int u = 0; u < depth.width(); ++u) {
    int first = -1, last = -1;
    for (int v = 0; v < depth.height(); ++v) {
      if (depth(u, v) <= 0) continue;
      ++valid_;
      if (first < 0) first = v;
      last = v;
    }
    if (first < 0) continue;
    for (const double x : {u - 0.5, u + 0.5}) {
      corners.emplace_back(x, first - 0.5);
      corners.emplace_back(x, last + 0.5);
    }
  }
  pixels_ += static_cast<double>(depth.size());
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  if (corners.size() > 2) hull_ += HullArea(corners);
}

void DepthStatistics::AddEdges(const DepthImage& depth) {
  const auto scan = [&](int length, const std::function<float(int)>& at) {
    int last = -1;  // the latest valid pixel
    for (int i = 0; i < length; ++i) {
      const float z = at(i);
      if (z <= 0) continue;
      if (last >= 0 && i - last <= kLongestGap) {
        const int gap = i - last - 1;
        const float before = at(last);
        if (std::abs(z - before) > kJump) {
          ++gaps_[gap <= 3 ? static_cast<std::size_t>(gap) : gap <= 12 ? 4U : 5U];
        }
        if (gap == 0 && last > 0) {
          const float a = at(last - 1), share = (before - a) / (z - a);
          if (a > 0 && std::abs(z - a) > kJump && share > kFlyingLow && share < kFlyingHigh) {
            ++flying_;
            if (std::abs(z - before) <= kJump && std::abs(before - a) <= kJump) ++gaps_[0];
          }
        }
      }
      last = i;
    }
  };
  for (int v = 0; v < depth.height(); ++v) {
    scan(depth.width(), [&](int u) { return depth(u, v); });
  }
  for (int u = 0; u < depth.width(); ++u) {
    scan(depth.height(), [&](int v) { return depth(u, v); });
  }
}

void DepthStatistics::AddSurfaces(const DepthImage& measured, const Intrinsics& intrinsics) {
  const StraightPlaces places(intrinsics);
  const DepthImage depth = places.Clean(measured);
  std::vector<FlatWindow> seeds;
  for (int v = kHalfWindow; v + kHalfWindow < depth.height(); v += kWindowStep) {
    for (int u = kHalfWindow; u + kHalfWindow < depth.width(); u += kWindowStep) {
      const std::optional<FlatWindow> window = FitWindow(depth, places, u, v);
      if (!window) continue;
      const int d = Bin(kDistances, window->mean_depth);
      const int i = Bin(kIncidences, Incidence(window->plane, intrinsics, places(u, v)));
      if (d >= 0 && i >= 0) {
        windows_[static_cast<std::size_t>(d)][static_cast<std::size_t>(i)].push_back(
            {1000 * window->rms, window->correlation});
      }
      if (window->rms < 0.5 * PlaneTolerance(options_.stereo, window->mean_depth))
        seeds.push_back(*window);
    }
  }
  std::sort(seeds.begin(), seeds.end(),
            [](const FlatWindow& a, const FlatWindow& b) { return a.rms < b.rms; });
  Image<std::uint8_t> taken(depth.width(), depth.height());
  const auto least = static_cast<std::size_t>(kPlaneShare * static_cast<double>(depth.size()));
  for (const FlatWindow& seed : seeds) {
    if (taken(seed.u, seed.v)) continue;
    const Region region = GrowPlane(depth, places, options_.stereo, taken, seed);
    for (const auto& [u, v] : region) taken(u, v) = 1;
    if (region.size() >= least) planes_.push_back(Residuals(depth, places, region));
  }
}

void DepthStatistics::AddSides(const DepthImage& measured, const LabelImage& labels,
                               const Intrinsics& intrinsics) {
  if (measured.width() != labels.width() || measured.height() != labels.height() ||
      measured.width() != intrinsics.width || measured.height() != intrinsics.height) {
    throw Error(fmt::format("depth statistics: the frame is {}x{}, its labels {}x{}",
                            measured.width(), measured.height(), labels.width(), labels.height()));
  }
  const StraightPlaces places(intrinsics);
  const DepthImage depth = places.Clean(measured);
  std::array<Region, 256> regions;
  for (int v = 1; v + 1 < depth.height(); ++v) {
    for (int u = 1; u + 1 < depth.width(); ++u) {
      const std::uint8_t label = labels(u, v);
      if (label == 0 || depth(u, v) <= 0 || labels(u - 1, v) != label ||
          labels(u + 1, v) != label || labels(u, v - 1) != label || labels(u, v + 1) != label) {
        continue;
      }
      regions[label].emplace_back(u, v);
    }
  }
  const auto least = static_cast<std::size_t>(kSideShare * static_cast<double>(depth.size()));
  for (Region& region : regions) {
    for (int pass = 0; pass < kSidePasses && region.size() > least; ++pass) {
      const InversePlane plane = FitRegion(depth, places, region, region.front());
      region.erase(std::remove_if(region.begin(), region.end(),
                                  [&](const std::pair<int, int>& p) {
                                    return std::abs(depth(p.first, p.second) -
                                                    plane.Depth(places(p.first, p.second))) >
                                           kSideOutlier;
                                  }),
                   region.end());
    }
    if (region.size() > least) sides_.push_back(Residuals(depth, places, region));
  }
}

double DepthStatistics::valid_share() const { return pixels_ > 0 ? valid_ / pixels_ : 0; }
double DepthStatistics::hull_share() const { return pixels_ > 0 ? hull_ / pixels_ : 0; }
double DepthStatistics::hole_share() const { return hull_ > 0 ? 1 - valid_ / hull_ : 0; }

double DepthStatistics::LocalResidual(std::size_t distance, std::size_t incidence) const {
  const std::vector<Window>& windows = windows_[distance][incidence];
  if (windows.size() < kLeastWindows) return -1;
  std::vector<double> values;
  values.reserve(windows.size());
  for (const Window& w : windows) values.push_back(w.rms_mm);
  return QuantileOrNone(std::move(values), 0.25);
}

double DepthStatistics::LocalCorrelation(std::size_t distance, std::size_t incidence) const {
  const double quartile = LocalResidual(distance, incidence);
  std::vector<double> values;
  for (const Window& w : windows_[distance][incidence]) {
    if (w.rms_mm <= quartile) values.push_back(w.correlation);
  }
  return values.empty() ? 0 : Quantile(std::move(values), 0.5);
}

double DepthStatistics::PlaneResidual(std::size_t distance, bool smooth) const {
  std::vector<double> values;
  for (const Plane& plane : planes_) {
    if (Bin(kDistances, plane.distance) == static_cast<int>(distance)) {
      values.push_back(smooth ? plane.smooth_mm : plane.rms_mm);
    }
  }
  return QuantileOrNone(std::move(values), 0.5);
}

int DepthStatistics::PlaneCount(std::size_t distance) const {
  return static_cast<int>(std::count_if(planes_.begin(), planes_.end(), [&](const Plane& plane) {
    return Bin(kDistances, plane.distance) == static_cast<int>(distance);
  }));
}

double DepthStatistics::SideResidual(bool in_disparity) const {
  std::vector<double> values;
  for (const Plane& side : sides_) {
    values.push_back(in_disparity
                         ? 0.001 * side.rms_mm * kFocalBaseline / (side.distance * side.distance)
                         : side.rms_mm);
  }
  return QuantileOrNone(std::move(values), 0.5);
}

std::array<double, 6> DepthStatistics::GapShares() const {
  double sum = 0;
  for (const double gap : gaps_) sum += gap;
  std::array<double, 6> shares{};
  for (std::size_t i = 0; sum > 0 && i < shares.size(); ++i) shares[i] = gaps_[i] / sum;
  return shares;
}

double DepthStatistics::FlyingShare() const {
  double sum = 0;
  for (const double gap : gaps_) sum += gap;
  return sum > 0 ? flying_ / sum : 0;
}

std::string StatisticsTable(const std::vector<std::string>& names,
                            const std::vector<const DepthStatistics*>& sets) {
  std::string table = "| figure |";
  for (const std::string& name : names) table += fmt::format(" {} |", name);
  table += "\n|---|";
  for (std::size_t i = 0; i < names.size(); ++i) table += "---|";
  const auto row = [&](const std::string& name,
                       const std::function<std::string(const DepthStatistics&)>& figure) {
    std::string line = fmt::format("\n| {} |", name);
    bool any = false;
    for (const DepthStatistics* set : sets) {
      const std::string text = figure(*set);
      any = any || !text.empty();
      line += fmt::format(" {} |", text.empty() ? "-" : text);
    }
    if (any) table += line;
  };
  const auto percent = [](double x) { return fmt::format("{:.1f}", 100 * x); };
  row("frames", [](const DepthStatistics& s) { return fmt::format("{}", s.frames()); });
  row("valid pixels, %", [&](const DepthStatistics& s) { return percent(s.valid_share()); });
  row("field of view (hull), %", [&](const DepthStatistics& s) { return percent(s.hull_share()); });
  row("holes inside it, %", [&](const DepthStatistics& s) { return percent(s.hole_share()); });
  constexpr std::array<const char*, 6> kGaps{"0", "1", "2", "3", "4-12", "> 12"};
  for (std::size_t i = 0; i < kGaps.size(); ++i) {
    row(fmt::format("edges with a gap of {} px, %", kGaps[i]),
        [&](const DepthStatistics& s) { return percent(s.GapShares()[i]); });
  }
  row("flying pixels a jump, %",
      [&](const DepthStatistics& s) { return percent(s.FlyingShare()); });
  for (std::size_t d = 0; d + 1 < DepthStatistics::kDistances.size(); ++d) {
    const std::string at = fmt::format("{:.1f}-{:.1f} m", DepthStatistics::kDistances[d],
                                       DepthStatistics::kDistances[d + 1]);
    for (std::size_t i = 0; i + 1 < DepthStatistics::kIncidences.size(); ++i) {
      row(fmt::format("local residual (correlation), {}, {:.0f}-{:.0f} deg, mm", at,
                      DepthStatistics::kIncidences[i], DepthStatistics::kIncidences[i + 1]),
          [&](const DepthStatistics& s) {
            const double x = s.LocalResidual(d, i);
            return x < 0 ? std::string()
                         : fmt::format("{:.2f} ({:.2f})", x, s.LocalCorrelation(d, i));
          });
    }
    row(fmt::format("whole faces: rms, smooth part (faces a frame), {}, mm", at),
        [&](const DepthStatistics& s) {
          const double x = s.PlaneResidual(d, false);
          return x < 0 ? std::string()
                       : fmt::format("{:.1f}, {:.1f} ({:.1f})", x, s.PlaneResidual(d, true),
                                     static_cast<double>(s.PlaneCount(d)) / s.frames());
        });
  }
  row("structure's sides: rms to their planes, mm", [](const DepthStatistics& s) {
    return s.sides().empty() ? std::string() : fmt::format("{:.1f}", s.SideResidual(false));
  });
  row("structure's sides: in disparity, px", [](const DepthStatistics& s) {
    return s.sides().empty() || !s.options().stereo ? std::string()
                                                    : fmt::format("{:.3f}", s.SideResidual(true));
  });
  return table + "\n";
}

}  // namespace volalign
