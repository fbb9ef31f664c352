#include "core/geometry/sensor_kind.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/config/config.h"
#include "core/geometry/shipped_intrinsics.h"

namespace volalign {

namespace {

constexpr char kUnknown[] = "unknown";

/// An entry in the file.
struct KindEntry {
  std::string kind, like;
  std::vector<double> distortion;
  std::vector<double> lens_sigmas;
  double own_focal_sigma = 0;
  DepthErrorModel errors;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("kind", kind, "with which the names of its sensors begin");
    ar("like", like, "an earlier kind, whose keys this one has where it does not give its own");
    ar("distortion", distortion, "k1 k2 p1 p2 k3 k4 k5 k6, or none: rectified");
    ar("lens_sigmas", lens_sigmas,
       "by which lenses of the kind differ: standard deviations of the logarithm of the focal "
       "length, of k1 and of k2; none: the lens is not known",
       AtLeast(0));
    ar("own_focal_sigma", own_focal_sigma,
       "by which the focal length of one device differs from that of others of a rig, beyond what "
       "the capture says: standard deviation of its logarithm",
       AtLeast(0));
    ar("errors", errors, "how its depths err");
  }
};

KindEntry ReadEntry(const ConfigSource& source, const std::vector<KindEntry>& earlier) {
  KindEntry start;
  if (const auto* like = source.Find("like")) {
    const std::string name = FlowText(*like);
    const auto found = std::find_if(earlier.begin(), earlier.end(),
                                    [&](const KindEntry& entry) { return entry.kind == name; });
    if (found == earlier.end()) {
      throw ConfigError(
          fmt::format("like = {} is no kind before this one ({})", name, source.WhereOf("like")));
    }
    start = *found;
  }
  KindEntry entry = ReadConfig(source, start);
  const std::string place = source.WhereOf("kind");
  const std::size_t coefficients = entry.distortion.size(), sigmas = entry.lens_sigmas.size();
  if ((coefficients != 0 && coefficients != 8) || (sigmas != 0 && sigmas != 3) ||
      (coefficients > 0 && sigmas == 0)) {
    throw ConfigError(fmt::format(
        "{}: {} wants distortion with 8 numbers or none, and with it lens_sigmas with 3", place,
        entry.kind));
  }
  if (!(entry.errors.smooth_rad > 0 && entry.errors.seam_reach_m > 0 &&
        entry.errors.bounce_reach_m > 0)) {
    throw ConfigError(
        fmt::format("{}: {} wants errors with smooth_rad, seam_reach_m and bounce_reach_m, or to "
                    "be like another kind",
                    place, entry.kind));
  }
  return entry;
}

SensorKind KindOf(const KindEntry& entry) {
  SensorKind kind{entry.kind, std::nullopt, entry.errors};
  if (!entry.lens_sigmas.empty()) {
    kind.lens.emplace();
    kind.lens->distortion = entry.distortion;
    std::copy(entry.lens_sigmas.begin(), entry.lens_sigmas.end(), kind.lens->sigmas.begin());
    kind.lens->own_focal_sigma = entry.own_focal_sigma;
  }
  return kind;
}

const std::vector<SensorKind>& Shipped() {
  static const std::vector<SensorKind> shipped =
      ParseSensorKinds(shipped::kIntrinsics, "configs/intrinsics.yaml");
  return shipped;
}

bool IsUnknown(const SensorKind& kind) { return kind.name == kUnknown; }

}  // namespace

std::vector<SensorKind> ParseSensorKinds(const std::string& yaml, const std::string& path) {
  std::vector<KindEntry> entries;
  for (const ConfigSource& source : ConfigSource::ListFromString(yaml, path)) {
    if (source.Find("kind") != nullptr) entries.push_back(ReadEntry(source, entries));
  }
  std::vector<SensorKind> kinds;
  kinds.reserve(entries.size());
  for (const KindEntry& entry : entries) kinds.push_back(KindOf(entry));
  return kinds;
}

const std::vector<SensorKind>& SensorKinds() {
  static const std::vector<SensorKind> known = [] {
    std::vector<SensorKind> kinds = Shipped();
    kinds.erase(std::remove_if(kinds.begin(), kinds.end(), IsUnknown), kinds.end());
    return kinds;
  }();
  return known;
}

const SensorKind* FindSensorKind(const std::string& sensor) {
  const SensorKind* found = nullptr;
  for (const SensorKind& kind : SensorKinds()) {
    if (sensor.rfind(kind.name, 0) == 0 && (!found || kind.name.size() > found->name.size()))
      found = &kind;
  }
  return found;
}

void RequireSensorKind(const std::string& sensor, const std::string& what) {
  if (FindSensorKind(sensor) != nullptr) return;
  std::vector<std::string> names;
  for (const SensorKind& kind : SensorKinds()) names.push_back(kind.name);
  throw ConfigError(fmt::format("{} = {} is no kind of sensor that is known: names begin with {}",
                                what, sensor, fmt::join(names, ", ")));
}

const DepthErrorModel& ErrorsOf(const std::string& sensor) {
  if (const SensorKind* kind = FindSensorKind(sensor)) return kind->errors;
  return std::find_if(Shipped().begin(), Shipped().end(), IsUnknown)->errors;
}

}  // namespace volalign
