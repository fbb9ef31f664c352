#include "core/geometry/camera.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/config/bounded_yaml.h"
#include "core/config/config.h"
#include "core/geometry/typical_intrinsics.h"

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
    // The image's x axis has become its y axis, and its y axis the opposite of its x axis; the
    // radial part is the same in all directions.
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

/// Throws ConfigError for a key that a pool's entry does not have, or has twice.
void RequireKnownKeys(const YAML::Node& entry, const std::string& path) {
  static const std::vector<std::string> known = {"sensor", "resolution", "distortion",
                                                 "intrinsics"};
  std::set<std::string> seen;
  for (const auto& item : entry) {
    const auto key = item.first.as<std::string>();
    const std::string where = fmt::format("{}:{}", path, item.first.Mark().line + 1);
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      const std::string nearest = NearestKey(key, known);
      throw ConfigError(
          fmt::format("unknown key '{}' ({}){}", key, where,
                      nearest.empty() ? "" : fmt::format("; did you mean '{}'?", nearest)));
    }
    if (!seen.insert(key).second) {
      throw ConfigError(fmt::format("key '{}' stands twice ({})", key, where));
    }
  }
}

Intrinsics ParseIntrinsics(const YAML::Node& item, const std::vector<int>& size,
                           const std::vector<double>& distortion, const std::string& path) {
  const auto k = item.as<std::vector<double>>();
  const std::string where = fmt::format("{}:{}", path, item.Mark().line + 1);
  if (k.size() != 4) throw ConfigError(where + ": intrinsics want [fx, fy, cx, cy]");
  Intrinsics intrinsics{size[0], size[1], k[0], k[1], k[2], k[3], distortion};
  try {
    intrinsics.Validate(where);
  } catch (const DataError& e) {
    throw ConfigError(e.what());
  }
  return intrinsics;
}

}  // namespace

std::vector<IntrinsicsPoolEntry> ReadIntrinsicsPool(const std::string& path) {
  return ParseIntrinsicsPool(ReadFile(FindInputFile(path), kMaxTextBytes), path);
}

std::vector<IntrinsicsPoolEntry> ParseIntrinsicsPool(const std::string& text,
                                                     const std::string& path) {
  std::vector<IntrinsicsPoolEntry> pool;
  try {
    for (const YAML::Node& node : LoadYaml(text)) {
      if (node.IsMap() && node["kind"]) continue;  // core/geometry/sensor_kind.h
      RequireKnownKeys(node, path);
      IntrinsicsPoolEntry entry;
      entry.sensor = node["sensor"].as<std::string>();
      const auto size = node["resolution"].as<std::vector<int>>();
      if (size.size() != 2) {
        throw ConfigError(fmt::format("{}:{}: resolution wants [width, height]", path,
                                      node["resolution"].Mark().line + 1));
      }
      std::vector<double> distortion;
      if (node["distortion"]) distortion = node["distortion"].as<std::vector<double>>();
      for (const YAML::Node& item : node["intrinsics"]) {
        entry.intrinsics.push_back(ParseIntrinsics(item, size, distortion, path));
      }
      if (entry.intrinsics.empty()) {
        throw ConfigError(
            fmt::format("{}:{}: {} has no intrinsics", path, node.Mark().line + 1, entry.sensor));
      }
      pool.push_back(entry);
    }
  } catch (const YAML::Exception& e) {
    throw ConfigError(
        fmt::format("{}:{}: {}; a list of {{sensor, resolution: [w, h], intrinsics: [[fx, fy, cx, "
                    "cy], ...]}}, and perhaps distortion: [k1, k2, p1, p2, ...], is expected",
                    path, e.mark.line + 1, YamlProblem(e)));
  }
  if (pool.empty()) throw ConfigError(path + ": no sensors in the intrinsics pool");
  return pool;
}

}  // namespace volalign
