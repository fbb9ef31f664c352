#include "core/geometry/camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/config/config.h"
#include "core/geometry/shipped_intrinsics.h"

namespace volalign {

void Intrinsics::Validate(const std::string& what) const {
  const auto require = [&](bool holds, const std::string& text) {
    if (!holds) throw DataError(fmt::format("{}: {}", what, text));
  };
  require(width > 0 && height > 0,
          fmt::format("image size {}x{} violates width > 0 and height > 0", width, height));
  require(
      std::isfinite(fx) && std::isfinite(fy) && fx > 0 && fy > 0,
      fmt::format("focal lengths fx = {}, fy = {} violate 0 < fx, fy < infinity (pixels)", fx, fy));
  require(
      cx > -width && cx < 2.0 * width && cy > -height && cy < 2.0 * height,
      fmt::format("principal point ({}, {}) is not near the {}x{} image", cx, cy, width, height));
  const std::size_t n = distortion.size();
  require(n == 0 || n == 4 || n == 5 || n == 8,
          fmt::format("{} distortion coefficients; OpenCV's 0, 4, 5 or 8 are expected", n));
  for (const double k : distortion) {
    require(std::isfinite(k), fmt::format("a distortion coefficient is {}", k));
  }
}

Intrinsics Intrinsics::Resized(int new_width, int new_height) const {
  const double sx = static_cast<double>(new_width) / width;
  const double sy = static_cast<double>(new_height) / height;
  Intrinsics out = *this;
  out.width = new_width;
  out.height = new_height;
  out.fx = fx * sx;
  out.fy = fy * sy;
  out.cx = (cx + 0.5) * sx - 0.5;
  out.cy = (cy + 0.5) * sy - 0.5;
  return out;
}

Intrinsics Intrinsics::Turned(int quarter_turns) const {
  Intrinsics out = *this;
  for (int i = ((quarter_turns % 4) + 4) % 4; i > 0; --i) {
    const Intrinsics in = out;
    out.width = in.height;
    out.height = in.width;
    out.fx = in.fy;
    out.fy = in.fx;
    out.cx = in.height - 1 - in.cy;
    out.cy = in.cx;
    // The image's x axis becomes its y axis, and its y axis the opposite of its x axis. The radial
    // part is the same in all directions.
    if (!in.distortion.empty()) {
      out.distortion[2] = in.distortion[3];   // p1
      out.distortion[3] = -in.distortion[2];  // p2
    }
  }
  return out;
}

bool operator==(const Intrinsics& a, const Intrinsics& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
         a.cx == b.cx && a.cy == b.cy && a.distortion == b.distortion;
}

namespace {

/// An entry of a pool in the file.
struct PoolEntry {
  std::string sensor;
  std::array<int, 2> resolution{};
  std::vector<double> distortion;
  std::vector<std::array<double, 4>> intrinsics;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("sensor", sensor, "name of the sensor's model", Required());
    ar("resolution", resolution, "[width, height]", Required());
    ar("distortion", distortion, "[k1, k2, p1, p2, ...], of all of them");
    ar("intrinsics", intrinsics, "[fx, fy, cx, cy] of each device", Required());
  }
};

/// Reads text like that of `configs/intrinsics.yaml`; `path` begins messages.
std::vector<IntrinsicsPoolEntry> ParseIntrinsicsPool(const std::string& text,
                                                     const std::string& path) {
  std::vector<IntrinsicsPoolEntry> pool;
  for (const ConfigSource& source : ConfigSource::ListFromString(text, path)) {
    if (source.Find("kind") != nullptr) continue;  // core/geometry/sensor_kind.h
    const auto read = ReadConfig<PoolEntry>(source);
    if (read.intrinsics.empty()) {
      throw ConfigError(
          fmt::format("{}: {} has no intrinsics", source.WhereOf("intrinsics"), read.sensor));
    }
    IntrinsicsPoolEntry& entry = pool.emplace_back();
    entry.sensor = read.sensor;
    for (const std::array<double, 4>& k : read.intrinsics) {
      entry.intrinsics.push_back(
          {read.resolution[0], read.resolution[1], k[0], k[1], k[2], k[3], read.distortion});
      try {
        entry.intrinsics.back().Validate(
            source.WhereOf(fmt::format("intrinsics[{}]", entry.intrinsics.size() - 1)));
      } catch (const DataError& e) {
        throw ConfigError(e.what());
      }
    }
  }
  if (pool.empty()) throw ConfigError(path + ": no sensors in the intrinsics pool");
  return pool;
}

const std::vector<IntrinsicsPoolEntry>& Pool() {
  static const std::vector<IntrinsicsPoolEntry> pool =
      ParseIntrinsicsPool(shipped::kIntrinsics, "configs/intrinsics.yaml");
  return pool;
}

Intrinsics Mean(const IntrinsicsPoolEntry& entry) {
  const Intrinsics& first = entry.intrinsics.front();
  Intrinsics mean{first.width, first.height, 0, 0, 0, 0, {}};
  for (const Intrinsics& device : entry.intrinsics) {
    const double share = 1.0 / static_cast<double>(entry.intrinsics.size());
    mean.fx += share * device.fx;
    mean.fy += share * device.fy;
    mean.cx += share * device.cx;
    mean.cy += share * device.cy;
  }
  return mean;
}

/// More than the difference of devices of a kind, as a share.
constexpr double kOther = 0.05;

bool IsNear(double a, double b) { return std::abs(std::log(a / b)) < kOther; }

}  // namespace

std::vector<IntrinsicsPoolEntry> ReadIntrinsicsPool(const std::string& path) {
  return ParseIntrinsicsPool(ReadFile(FindInputFile(path), kMaxTextBytes), path);
}

std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height) {
  for (const IntrinsicsPoolEntry& entry : Pool()) {
    const Intrinsics& first = entry.intrinsics.front();
    if (entry.sensor == sensor && first.width * height == first.height * width)
      return Mean(entry).Resized(width, height);
  }
  return std::nullopt;
}

std::optional<Intrinsics> OfAnotherSize(const std::string& sensor, const Intrinsics& given) {
  std::optional<Intrinsics> other;
  for (const IntrinsicsPoolEntry& entry : Pool()) {
    if (entry.sensor != sensor) continue;
    const Intrinsics mean = Mean(entry);
    const double scale = given.fx / mean.fx;
    const Intrinsics full = mean.Resized(std::max(1, static_cast<int>(scale * mean.width + 0.5)),
                                         std::max(1, static_cast<int>(scale * mean.height + 0.5)));
    if (IsNear(full.width, given.width) && IsNear(full.height, given.height)) return std::nullopt;
    if (IsNear(full.fy, given.fy) && std::abs(full.cx - given.cx) < kOther * given.fx &&
        std::abs(full.cy - given.cy) < kOther * given.fy)
      other = full;
  }
  return other;
}

ImageSize ParseImageSize(const std::string& text) {
  ImageSize size;
  int used = 0;
  if (std::sscanf(text.c_str(), "%4dx%4d%n", &size.width, &size.height, &used) != 2 ||
      used != static_cast<int>(text.size()) || size.width < 16 || size.height < 16 ||
      size.width > 4096 || size.height > 4096) {
    throw ConfigError(fmt::format(
        "image size \"{}\" is not WIDTHxHEIGHT with 16 <= size <= 4096, such as 160x144", text));
  }
  return size;
}

bool SameAspect(const Intrinsics& intrinsics, ImageSize size) {
  constexpr double kTolerance = 0.02;
  const double pool = static_cast<double>(intrinsics.width) / intrinsics.height;
  const double image = static_cast<double>(size.width) / size.height;
  return std::abs(pool / image - 1) <= kTolerance;
}

}  // namespace volalign
