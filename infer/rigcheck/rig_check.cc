#include "infer/rigcheck/rig_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/json/json_archive.h"
#include "infer/rigcheck/movement_table.h"

namespace volalign {

namespace {

using Sensor = Extrinsics::Sensor;

const Sensor* Find(const Extrinsics& extrinsics, const std::string& name) {
  const auto found = std::find_if(extrinsics.sensors.begin(), extrinsics.sensors.end(),
                                  [&](const Sensor& sensor) { return sensor.name == name; });
  return found == extrinsics.sensors.end() ? nullptr : &*found;
}

bool IsComparable(const Sensor& sensor) {
  return sensor.structure_from_sensor && sensor.covariance.allFinite();
}

std::vector<SensorEstimate> EstimatesOf(const Extrinsics& extrinsics) {
  std::vector<SensorEstimate> estimates;
  for (const Sensor& sensor : extrinsics.sensors) {
    if (IsComparable(sensor))
      estimates.push_back({sensor.name, *sensor.structure_from_sensor, sensor.covariance});
  }
  return estimates;
}

/// Says why a sensor has no pose to compare; "" if it has one. `when`: "now" or "last time".
std::string Lacks(const Sensor* sensor, const std::string& when) {
  if (!sensor) return fmt::format("the rig does not have it {}", when);
  if (!sensor->structure_from_sensor) {
    return fmt::format("it failed {} ({}): {}", when, ToString(sensor->code), sensor->reason);
  }
  return IsComparable(*sensor) ? "" : fmt::format("its uncertainty {} is not known", when);
}

void TurnInto(const Pose& last_from_now, Sensor* sensor) {
  sensor->initial = last_from_now * sensor->initial;
  if (sensor->colour && sensor->colour->structure_from_colour) {
    Pose& colour = *sensor->colour->structure_from_colour;
    colour = last_from_now * colour;
  }
  if (sensor->together) sensor->together = last_from_now * *sensor->together;
  sensor->structure_from_sensor = last_from_now * *sensor->structure_from_sensor;
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Names of the sensors that UpdateExtrinsics takes from the new capture. One that is known to have
/// moved may have failed there: its last pose is wrong, and it has no other.
std::vector<std::string> Updated(const Extrinsics& last, const Extrinsics& now,
                                 const RigCheck& check) {
  std::vector<std::string> names;
  for (const SensorMovement& sensor : check.movements.sensors) {
    if (sensor.movement == Movement::kMoved) names.push_back(sensor.name);
  }
  for (const Sensor& sensor : now.sensors) {
    const Sensor* before = Find(last, sensor.name);
    const bool is_new = IsComparable(sensor) && !(before && IsComparable(*before));
    if (!Contains(names, sensor.name) && (is_new || Contains(check.moved, sensor.name)))
      names.push_back(sensor.name);
  }
  return names;
}

std::string MovementText(const Movements& movements) {
  return FormatTable(MovementTable(movements), TableFormat::kText) +
         "apart: how far it moved\nprobability: the chance of this without any movement\nfound: "
         "the smallest movement or turn that is noticed with 95 % probability\n";
}

/// "KA04 moved 12.1 mm, 0.62 deg"
std::string Moved(const SensorMovement& sensor) {
  return fmt::format("{} moved {:.1f} mm, {:.2f} deg", sensor.name, 1000 * sensor.translation_m,
                     sensor.rotation_deg);
}

std::string Sentence(const Movements& movements) {
  if (movements.sensors.empty()) return "nothing can be compared\n";
  if (!movements.last_from_now) {
    return movements.sensors.size() == 1 ? "the sensor or the stack may have moved: one sensor "
                                           "cannot show which. Compare two sensors or more\n"
                                         : "something moved, but it is unknown which sensors: no "
                                           "more than half of them agree with each other\n";
  }
  std::string moved, undecided, trusted;
  std::size_t stayed = 0;
  double apart_m = 0, apart_deg = 0, found_m = 0, found_deg = 0;
  for (const SensorMovement& sensor : movements.sensors) {
    if (sensor.movement == Movement::kMoved) {
      moved += (moved.empty() ? "" : "; ") + Moved(sensor);
    } else if (sensor.movement == Movement::kUndecided) {
      undecided += (undecided.empty() ? "" : ", ") + sensor.name;
    } else if (!std::isfinite(sensor.found_from_m)) {
      trusted = sensor.name;
    } else {
      ++stayed;
      apart_m = std::max(apart_m, sensor.translation_m);
      apart_deg = std::max(apart_deg, sensor.rotation_deg);
      found_m = std::max(found_m, sensor.found_from_m);
      found_deg = std::max(found_deg, sensor.found_from_deg);
    }
  }
  std::string text;
  if (!moved.empty()) text += moved + "; ";
  if (!trusted.empty())
    return text + trusted + " is trusted to have stayed: no other sensor can confirm it\n";
  if (!undecided.empty()) {
    text += fmt::format("some of {} moved, but it is unknown which; ", undecided);
  }
  text += fmt::format("{} {} agree within {:.1f} mm, {:.2f} deg\n",
                      text.empty() ? "nothing moved: all" : "the other", stayed, 1000 * apart_m,
                      apart_deg);
  return text + fmt::format(
                    "a movement of {:.0f} mm or {:.2f} deg of any of these would have been "
                    "found (95 %)\n",
                    1000 * found_m, found_deg);
}

/// Names sensors that stand where others stood; empty if none does.
std::string Exchange(const RigCheck& check) {
  std::string stand;
  for (const auto& [name, place_of] : check.exchanged) {
    stand +=
        fmt::format("{}{} stands now where {} stood", stand.empty() ? "" : ", ", name, place_of);
  }
  if (stand.empty()) return "";
  return stand +
         ": their depth files, or the sensors themselves, were exchanged. Correct the capture and "
         "check again\n";
}

std::string Circumstances(const RigCheck& check) {
  std::string text;
  for (const RigCheck::NotCompared& sensor : check.not_compared)
    text += fmt::format("{} is not compared: {}\n", sensor.name, sensor.reason);
  if (!check.same_structure) {
    text +=
        "the structure is not described as last time, so sensors are compared only with each "
        "other\n";
  }
  if (const std::optional<Pose>& moved = check.movements.last_from_now) {
    text += fmt::format("the stack stands {:.0f} mm and {:.1f} deg from where it stood\n",
                        1000 * moved->translation().norm(),
                        ComparePoses(Pose::Identity(), *moved).rotation_deg);
  }
  return text;
}

}  // namespace

template <class Archive>
void Describe(Archive& ar, SensorMovement& sensor) {
  std::string movement = ToString(sensor.movement);
  ar("name", sensor.name);
  ar("movement", movement);
  ar("translation_m", sensor.translation_m);
  ar("rotation_deg", sensor.rotation_deg);
  ar("probability", sensor.probability);
  ar.IfFinite("found_from_m", sensor.found_from_m);
  ar.IfFinite("found_from_deg", sensor.found_from_deg);
  ar("structure_from_sensor", sensor.structure_from_sensor);
  ar("covariance", sensor.covariance);
}

template <class Archive>
void Describe(Archive& ar, Exchanged& sensor) {
  ar("name", sensor.name);
  ar("place_of", sensor.place_of);
}

template <class Archive>
void Describe(Archive& ar, RigCheck::NotCompared& sensor) {
  ar("name", sensor.name);
  ar("reason", sensor.reason);
}

template <class Archive>
void Describe(Archive& ar, RigCheck& check) {
  ar.Constant("format", kRigCheckFormat);
  ar("tool", check.tool);
  ar("last", check.last);
  ar.OneOrList("capture", check.captures);
  ar("same_structure", check.same_structure);
  ar.Optional("moved", check.moved);
  ar.Optional("last_from_now", check.movements.last_from_now);
  ar("variance_factor", check.movements.variance_factor);
  ar("sensors", check.movements.sensors);
  ar.Optional("exchanged", check.exchanged);
  ar("not_compared", check.not_compared);
}

bool RigCheck::MovedBeyond(double translation_m, double rotation_deg) const {
  return std::any_of(
      movements.sensors.begin(), movements.sensors.end(), [&](const SensorMovement& sensor) {
        return sensor.movement == Movement::kUndecided ||
               (sensor.movement == Movement::kMoved &&
                (sensor.translation_m > translation_m || sensor.rotation_deg > rotation_deg));
      });
}

RigCheck CheckRig(const std::string& last_file, const Extrinsics& last, const Extrinsics& now,
                  const MovementOptions& options) {
  RigCheck check;
  check.tool = now.tool;
  check.last = last_file;
  check.captures = now.captures;
  check.moved = options.moved;
  for (const std::string& name : options.moved) {
    if (Find(last, name) && Find(now, name)) continue;
    throw DataError(fmt::format("the moved sensor \"{}\" is not in both, {} and the new capture",
                                name, last_file));
  }
  check.same_structure = last.structure.sha256 == now.structure.sha256;
  for (const Sensor& sensor : last.sensors) {
    std::string reason = Lacks(&sensor, "last time");
    if (reason.empty()) reason = Lacks(Find(now, sensor.name), "now");
    if (!reason.empty()) check.not_compared.push_back({sensor.name, reason});
  }
  bool common = false;
  for (const Sensor& sensor : now.sensors) {
    common = common || Find(last, sensor.name);
    if (!Find(last, sensor.name))
      check.not_compared.push_back({sensor.name, Lacks(nullptr, "last time")});
  }
  if (!common) {
    throw DataError(fmt::format(
        "{} and the capture have no sensor of the same name in common: they are two rigs",
        last_file));
  }
  check.movements = FindMovements(EstimatesOf(last), EstimatesOf(now), options);
  check.exchanged = FindExchanged(EstimatesOf(last), EstimatesOf(now));
  return check;
}

std::string RigCheckText(const RigCheck& check, const std::string& where) {
  return WriteDescribed(check, where, 2);
}

void WriteRigCheck(const std::filesystem::path& path, const RigCheck& check) {
  WriteFileAtomically(path, RigCheckText(check, path.string()));
}

Table MovementTable(const Movements& movements) {
  Table table;
  table.columns = {"sensor",
                   {"movement", "now"},
                   {"translation_m", "apart mm", 1000, 1},
                   {"rotation_deg", "deg", 1, 3},
                   {"probability", "probability"},
                   {"found_from_m", "found mm", 1000, 0},
                   {"found_from_deg", "deg", 1, 2}};
  for (const SensorMovement& sensor : movements.sensors) {
    std::vector<Table::Cell> row = {sensor.name, ToString(sensor.movement)};
    row.resize(table.columns.size());
    if (movements.last_from_now) {
      row = {sensor.name,          ToString(sensor.movement), sensor.translation_m,
             sensor.rotation_deg,  sensor.probability,        sensor.found_from_m,
             sensor.found_from_deg};
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::vector<std::string> RigCheckSentences(const RigCheck& check) {
  std::vector<std::string> sentences =
      Split(Exchange(check) + Sentence(check.movements) + Circumstances(check), '\n');
  sentences.erase(std::remove(sentences.begin(), sentences.end(), ""), sentences.end());
  return sentences;
}

std::string FormatRigCheck(const RigCheck& check) {
  return MovementText(check.movements) + Circumstances(check) + Exchange(check) +
         Sentence(check.movements);
}

Extrinsics UpdateExtrinsics(const Extrinsics& last, const Extrinsics& now, const RigCheck& check) {
  const Movements& movements = check.movements;
  if (!movements.last_from_now || std::any_of(movements.sensors.begin(), movements.sensors.end(),
                                              [](const SensorMovement& sensor) {
                                                return sensor.movement == Movement::kUndecided;
                                              })) {
    throw DataError(
        "it is unknown which sensors moved, so no pose can be updated. Name those that moved with "
        "--moved, or calibrate all sensors anew");
  }
  const std::vector<std::string> updated = Updated(last, now, check);
  Extrinsics out = last;
  out.tool = now.tool;
  const Matrix6d turn = Adjoint(*movements.last_from_now);
  for (const std::string& name : updated) {
    Sensor sensor = *Find(now, name);
    if (sensor.structure_from_sensor) {
      sensor.covariance = turn * sensor.covariance * turn.transpose() + movements.covariance;
      TurnInto(*movements.last_from_now, &sensor);
    }
    sensor.error.reset();
    sensor.initial_error.reset();
    const auto before = std::find_if(out.sensors.begin(), out.sensors.end(),
                                     [&](const Sensor& other) { return other.name == name; });
    if (before == out.sensors.end()) {
      out.sensors.push_back(std::move(sensor));
    } else {
      *before = std::move(sensor);
    }
  }
  out.verdict = out.findings.empty() ? SensorStatus::kOk : SensorStatus::kWeak;
  for (const Sensor& sensor : out.sensors) out.verdict = std::max(out.verdict, sensor.status);
  const auto is_of_updated = [&](const PairResult& pair) {
    return Contains(updated, pair.a) || Contains(updated, pair.b);
  };
  out.pairs.erase(std::remove_if(out.pairs.begin(), out.pairs.end(), is_of_updated),
                  out.pairs.end());
  for (PairResult pair : now.pairs) {
    if (!is_of_updated(pair)) continue;
    const bool both = Contains(updated, pair.a) && Contains(updated, pair.b);
    if (both) {
      pair.covariance = turn * pair.covariance * turn.transpose();
    } else {  // one of them is where it was before
      pair = {pair.a, pair.b, pair.overlap, pair.rms_m, pair.predicted_rms_m};
    }
    out.pairs.push_back(std::move(pair));
  }
  const auto is_updated = [&](const SensorAlternative& sensor) {
    return Contains(updated, sensor.name);
  };
  std::vector<RigAlternative>& others = out.alternatives;
  others.erase(std::remove_if(others.begin(), others.end(),
                              [&](const RigAlternative& other) {
                                return std::any_of(other.sensors.begin(), other.sensors.end(),
                                                   is_updated);
                              }),
               others.end());
  for (RigAlternative other : now.alternatives) {
    if (!std::all_of(other.sensors.begin(), other.sensors.end(), is_updated)) continue;
    for (SensorAlternative& sensor : other.sensors)
      sensor.structure_from_sensor = *movements.last_from_now * sensor.structure_from_sensor;
    others.push_back(std::move(other));
  }
  out.metrics.reset();
  out.timings_s = now.timings_s;
  out.captures.insert(out.captures.end(), now.captures.begin(), now.captures.end());
  for (Extrinsics::Placement placement : now.placements) {
    placement.first_from_placement = *movements.last_from_now * placement.first_from_placement;
    placement.covariance = turn * placement.covariance * turn.transpose() + movements.covariance;
    placement.sigma_translation_m = SigmaTranslation(placement.covariance);
    placement.sigma_rotation_deg = SigmaRotationDeg(placement.covariance);
    out.placements.push_back(std::move(placement));
  }
  return out;
}

std::string UpdateSentence(const Extrinsics& last, const Extrinsics& now, const RigCheck& check) {
  std::vector<std::string> placed, kept, missing;
  const std::vector<std::string> updated = Updated(last, now, check);
  for (const Sensor& sensor : now.sensors) {
    (sensor.structure_from_sensor ? Contains(updated, sensor.name) ? placed : kept : missing)
        .push_back(sensor.name);
  }
  const auto say = [](const std::vector<std::string>& names, const char* what) {
    return names.empty() ? "" : fmt::format("{}: {}. ", what, fmt::join(names, ", "));
  };
  std::string text = say(placed, "New poses") + say(missing, "No pose in the new capture") +
                     say(kept, "Compared with the last calibration, poses kept");
  text.pop_back();
  return text;
}

}  // namespace volalign
