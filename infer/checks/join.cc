#include "infer/checks/join.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <variant>

namespace volalign {

namespace {

/// Two poses of one sensor from two captures are the same within these. Each is by a single view,
/// and a placement turns the error of one sensor's direction into another's place.
constexpr double kSamePosition = 0.2;   // m
constexpr double kSameOrientation = 6;  // deg
constexpr double kOpenToDoubt = 0.5;    // weight of a pose that is ambiguous or by neighbours

/// A located frame.
struct Sighting {
  FrameId frame;
  std::size_t sensor;
  Pose structure_from_sensor = Pose::Identity();
  double weight = 1;
};

/// A sensor's pose by one capture.
struct Estimate {
  Pose first_from_sensor = Pose::Identity();
  double weight = 1;
  const Sighting* by = nullptr;
};
using Estimates = std::map<std::size_t, std::vector<Estimate>>;  // by sensor

bool IsSame(const Pose& a, const Pose& b) {
  const PoseError apart = ComparePoses(a, b);
  return apart.translation_m < kSamePosition && apart.rotation_deg < kSameOrientation;
}

std::vector<Sighting> SightingsIn(const Seen& seen, const PerFrame<LocateResult>& results) {
  std::vector<Sighting> all;
  for (const FrameId id : results.Ids()) {
    const auto* located = std::get_if<LocatedFrame>(&results[id]);
    if (!located) continue;
    const bool doubtful = !seen.labelled[id].other_pose.empty();
    all.push_back({id, seen.input->sensor_of[id], located->own_pose, doubtful ? kOpenToDoubt : 1});
  }
  return all;
}

/// The weight of the sensors that stand where they are known to if the stack stood at `placement`.
double Support(const std::vector<Sighting>& sightings, std::size_t capture, const Pose& placement,
               const Estimates& stands) {
  double support = 0;
  for (const Sighting& sighting : sightings) {
    const auto known = stands.find(sighting.sensor);
    if (sighting.frame.capture != capture || known == stands.end()) continue;
    const Pose here = placement * sighting.structure_from_sensor;
    double best = 0;
    for (const Estimate& stand : known->second) {
      if (IsSame(here, stand.first_from_sensor)) best = std::max(best, stand.weight);
    }
    support += best * sighting.weight;
  }
  return support;
}

struct Found {
  std::size_t capture = 0;
  Pose first_from_placement = Pose::Identity();
  double support = 0;
};

/// The capture, not yet joined, whose place has the most support.
std::optional<Found> FindNext(const std::vector<Sighting>& sightings,
                              const std::vector<char>& joined, const Estimates& stands) {
  std::optional<Found> best;
  for (const Sighting& sighting : sightings) {
    const auto known = stands.find(sighting.sensor);
    if (joined[sighting.frame.capture] || known == stands.end()) continue;
    for (const Estimate& stand : known->second) {
      const Pose placement = stand.first_from_sensor * sighting.structure_from_sensor.inverse();
      const double support = Support(sightings, sighting.frame.capture, placement, stands);
      if (!best || support > best->support)
        best = Found{sighting.frame.capture, placement, support};
    }
  }
  return best;
}

/// The pose of a sensor that most of its captures agree on.
const Estimate& MostAgreed(const std::vector<Estimate>& stands) {
  const Estimate* best = &stands.front();
  double most = -1;
  for (const Estimate& stand : stands) {
    double weight = 0;
    for (const Estimate& other : stands) {
      if (IsSame(stand.first_from_sensor, other.first_from_sensor)) weight += other.weight;
    }
    if (weight <= most) continue;
    most = weight;
    best = &stand;
  }
  return *best;
}

Finding Contradiction(const Estimate& odd, const Estimate& agreed,
                      const std::vector<Capture>& captures) {
  const PoseError apart = ComparePoses(odd.first_from_sensor, agreed.first_from_sensor);
  return {SensorCode::kDisagrees,
          fmt::format("the sensors that {0} and {3} have in common show that it moved between the "
                      "two, by {1:.2f} m and {2:.0f} deg",
                      captures[odd.by->frame.capture].name, apart.translation_m, apart.rotation_deg,
                      captures[agreed.by->frame.capture].name),
          "between captures, move only the boxes, and stack them in the same way. Or leave this "
          "sensor out of one capture"};
}

Finding Unconnected(const Capture& capture, const Capture& first, bool first_has_poses) {
  if (!first_has_poses) {
    return {
        SensorCode::kUnconnected,
        fmt::format("no sensor was placed in {}, the capture in whose frame all poses are given",
                    first.name),
        fmt::format(
            "name another capture first, for example {}. Or calibrate {} alone to see why it fails",
            capture.name, first.name)};
  }
  return {SensorCode::kUnconnected,
          fmt::format("it sees the stack in {}, but nothing connects this capture with {}: no "
                      "sensor sees the stack in both, not even through other captures",
                      capture.name, first.name),
          "add a capture with the stack at a place where this sensor and one of the others see it"};
}

}  // namespace

Stood JoinCaptures(const Seen& seen, const PerFrame<LocateResult>& results) {
  const std::vector<Capture>& captures = seen.input->captures;
  Stood stood{std::vector<Pose>(captures.size(), Pose::Identity()), {}};
  const std::vector<Sighting> sightings = SightingsIn(seen, results);
  std::vector<char> joined(captures.size(), 0);
  Estimates stands;
  const auto join = [&](std::size_t capture, const Pose& placement) {
    joined[capture] = 1;
    stood.first_from_stack[capture] = placement;
    for (const Sighting& sighting : sightings) {
      if (sighting.frame.capture != capture) continue;
      stands[sighting.sensor].push_back(
          {placement * sighting.structure_from_sensor, sighting.weight, &sighting});
    }
  };
  join(0, Pose::Identity());
  while (const std::optional<Found> next = FindNext(sightings, joined, stands))
    join(next->capture, next->first_from_placement);

  for (const auto& [sensor, all] : stands) {
    const Estimate& agreed = MostAgreed(all);
    for (const Estimate& stand : all) {
      if (IsSame(stand.first_from_sensor, agreed.first_from_sensor)) continue;
      stood.contradicted[stand.by->frame] = Contradiction(stand, agreed, captures);
    }
  }
  for (const Sighting& sighting : sightings) {
    if (joined[sighting.frame.capture]) continue;
    stood.contradicted[sighting.frame] =
        Unconnected(captures[sighting.frame.capture], captures.front(), !stands.empty());
  }
  return stood;
}

}  // namespace volalign
