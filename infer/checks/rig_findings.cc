#include "infer/checks/rig_findings.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "core/base/odds.h"
#include "core/geometry/visibility.h"
#include "infer/checks/verdict.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

using Kind = RefinedQuantity::Kind;

/// The name of a kind of quantity for a person, and how to find the cause.
struct Meaning {
  RigCode code;
  const char* name;  ///< "{}" is the name of the box or of the sensor
  const char* unit;
  double scale;  ///< from the quantity to the unit
  const char* hint;
};

constexpr char kCheckDepth[] =
    "let this sensor warm up. Check its depth_scale, its intrinsics, and whether its depth file is "
    "that of another sensor";

Meaning MeaningOf(Kind kind) {
  static constexpr char kMeasureBox[] =
      "measure where this box stands and how long its edges are, and correct the structure file";
  switch (kind) {
    case Kind::kSize:
      break;
    case Kind::kBoxX:
      return {RigCode::kBoxOff, "the place of box {} along x", "mm", 1000, kMeasureBox};
    case Kind::kBoxZ:
      return {RigCode::kBoxOff, "the place of box {} along z", "mm", 1000, kMeasureBox};
    case Kind::kBoxYaw:
      return {RigCode::kBoxOff, "the turn of box {} about the vertical", "deg", 1 / kDegree,
              kMeasureBox};
    case Kind::kDepthGain:
      return {RigCode::kDepthOff, "the depth gain of {}", "%", 100, kCheckDepth};
    case Kind::kDepthOffset:
      return {RigCode::kDepthOff, "the depth offset of {}", "mm", 1000, kCheckDepth};
  }
  return {RigCode::kSizeOff, "the size of all boxes", "%", 100,
          "measure the boxes with a tape; if they are as described, the depth_scale is wrong"};
}

std::string NameOfEdge(int axis) {
  return axis == 1 ? "height" : fmt::format("length along its {}", axis == 0 ? "x" : "z");
}

std::string DescribeEdge(const RefinedEdge& edge, const Structure& structure) {
  return fmt::format(
      "the {} of box {} is {:.0f} mm {} than described (sigma {:.1f} mm)", NameOfEdge(edge.axis),
      structure.boxes()[static_cast<std::size_t>(edge.box)].name, 1000 * std::abs(edge.change),
      edge.change > 0 ? "more" : "less", 1000 * edge.sigma);
}

/// Does it explain the frames better than another size of all boxes, and is it more than an error
/// of a tape?
bool IsLikely(const RefinedEdge& edge) {
  return edge.log_odds > std::log(kDecisiveOdds) &&
         std::abs(edge.change) > std::max(kSamePlace / 2, kClearly * edge.sigma);
}

/// A single box that explains why frames contradict each other or all boxes have another size.
RigFinding ExplainByBox(const RefinedEdge& edge, const Structure& structure) {
  const Box& box = structure.boxes()[static_cast<std::size_t>(edge.box)];
  std::string hint =
      "measure this box first, and correct the structure file. Then measure the others";
  for (int other = 0; other < 3; ++other) {
    const double exchanged = box.size[other] - box.size[edge.axis];
    if (other == edge.axis ||
        std::abs(exchanged - edge.change) > std::max(kSamePlace / 2, kClearly * edge.sigma))
      continue;
    hint +=
        fmt::format(". Its {} has that length, so it may {}", NameOfEdge(other),
                    other == 1 || edge.axis == 1 ? "lie on another edge" : "be turned by 90 deg");
  }
  return {RigCode::kBoxOff,
          {box.name},
          fmt::format("{}. This explains the frames better than one error of size that all boxes "
                      "share (odds {})",
                      DescribeEdge(edge, structure), FormatOdds(edge.log_odds)),
          std::move(hint)};
}

RigFinding Explain(const RefinedQuantity& quantity, const std::string& name) {
  const Meaning meaning = MeaningOf(quantity.kind);
  RigFinding finding{
      meaning.code,
      {},
      fmt::format(
          "{} differs by {:+.1f} {} from its description; differences of {:.1f} {} are usual",
          fmt::format(fmt::runtime(meaning.name), name), meaning.scale * quantity.value,
          meaning.unit, meaning.scale * quantity.prior_sigma, meaning.unit),
      meaning.hint};
  if (!name.empty()) finding.about = {name};
  if (quantity.kind == Kind::kSize)
    finding.hint += fmt::format(", and multiplied by {:.4f} it fits", 1 / (1 + quantity.value));
  return finding;
}

}  // namespace

std::vector<RigFinding> ExplainQuantities(const RefineResult& refined,
                                          const std::vector<std::string>& sensors,
                                          const Structure& structure) {
  std::vector<RigFinding> findings;
  const std::optional<RefinedEdge>& edge = refined.wrong_edge;
  const bool by_box = edge && IsLikely(*edge);
  if (by_box) findings.push_back(ExplainByBox(*edge, structure));
  for (const RefinedQuantity& quantity : refined.quantities) {
    if (!(quantity.Sigmas() > kClearly)) continue;
    const auto of = static_cast<std::size_t>(quantity.of);
    const bool of_box = MeaningOf(quantity.kind).code == RigCode::kBoxOff;
    if (by_box && (quantity.kind == Kind::kSize || (of_box && quantity.of == edge->box))) continue;
    findings.push_back(Explain(quantity, quantity.kind == Kind::kSize ? ""
                                         : of_box                     ? structure.boxes()[of].name
                                                                      : sensors[of]));
  }
  return findings;
}

namespace {

/// Does a point lie closely above an upper side, and not on the structure?
bool StandsOn(const Side& side, const Structure& structure, const Eigen::Vector3d& point) {
  const double above = side.normal.dot(point - side.centre);
  return side.normal.y() > kSameNormal && above > kRoughPose && above < kFarthestOff &&
         side.Beyond(point) < -kRoughPose &&
         DistanceToSurface(structure, point).distance > kRoughPose;
}

/// For each label, how many frames measure something that stands on the side.
std::vector<int> CountStanding(const std::vector<std::pair<const SensorView*, Pose>>& frames,
                               const Structure& structure) {
  std::vector<int> standing(static_cast<std::size_t>(structure.num_classes()), 0);
  for (const auto& [view, pose] : frames) {
    std::vector<std::size_t> points(standing.size(), 0);
    view->VisitMeasured(1, [&, &from_sensor = pose, &seen = *view](int u, int v) {
      const Eigen::Vector3d point = from_sensor * seen.Point(u, v);
      for (int label = 1; label < structure.num_classes(); ++label) {
        if (StandsOn(structure.SideOfLabel(label), structure, point))
          ++points[static_cast<std::size_t>(label)];
      }
    });
    for (std::size_t label = 1; label < standing.size(); ++label)
      standing[label] += points[label] >= kFewProbes ? 1 : 0;
  }
  return standing;
}

}  // namespace

std::vector<RigFinding> FindCoveredSides(
    const std::vector<std::pair<const SensorView*, Pose>>& frames, const Structure& structure) {
  struct Shown {
    int frames = 0, pixels = 0, hidden = 0;
  };
  std::vector<Shown> of_label(static_cast<std::size_t>(structure.num_classes()));
  for (const auto& [full, pose] : frames) {
    const SensorView view = Decimate(*full, StrideForRays(full->depth.size(), kCoarseRays));
    const ExpectedView expected = CastView(structure, view.rays, pose);
    std::vector<std::size_t> pixels(of_label.size(), 0);
    for (std::size_t i = 0; i < view.depth.size(); ++i) {
      const std::uint8_t label = expected.labels[i];
      if (label == 0 || !(view.depth[i] > 0)) continue;
      ++pixels[label];
      ++of_label[label].pixels;
      of_label[label].hidden += expected.depth[i] - view.depth[i] >= kRoughPose ? 1 : 0;
    }
    for (std::size_t label = 1; label < of_label.size(); ++label)
      of_label[label].frames += 4 * pixels[label] >= kFewProbes ? 1 : 0;
  }
  const std::vector<int> standing = CountStanding(frames, structure);
  std::vector<RigFinding> findings;
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Shown& shown = of_label[static_cast<std::size_t>(label)];
    const int on_it = standing[static_cast<std::size_t>(label)];
    const bool hidden = shown.frames >= 2 && shown.hidden >= (1 - 2 * kLeastShown) * shown.pixels;
    if (!hidden && on_it < 2) continue;
    const Side& side = structure.SideOfLabel(label);
    findings.push_back(
        {RigCode::kBoxOff,
         {structure.boxes()[static_cast<std::size_t>(side.box)].name},
         hidden ? fmt::format("{1} sensors should see {0}, but something nearer hides most of it",
                              side.name, shown.frames)
                : fmt::format("something stands on {}, as {} sensors show", side.name, on_it),
         "look for a box that the structure file does not have, or take away what stands there"});
  }
  return findings;
}

namespace {

/// A finding about a sensor if each of its pairs is apart, as compared with all pairs without it.
std::optional<RigFinding> FindApart(const RefineResult& refined, int sensor,
                                    const std::string& name) {
  std::vector<double> own, others;  // distances over their predictions
  for (const RefinedPair& pair : refined.pairs) {
    const double ratio = pair.rms / pair.predicted_rms;
    if (ratio > 0) (pair.a == sensor || pair.b == sensor ? own : others).push_back(ratio);
  }
  if (own.size() < 2 || others.size() < own.size()) return std::nullopt;
  const Eigen::Map<const Eigen::ArrayXd> rest(others.data(),
                                              static_cast<Eigen::Index>(others.size()));
  const double usual = rest.mean() + kClearly * std::sqrt((rest - rest.mean()).square().mean());
  const auto [least, most] = std::minmax_element(own.begin(), own.end());
  if (!(*least > std::max(1.0, usual))) return std::nullopt;
  return RigFinding{
      RigCode::kPairApart,
      {name},
      fmt::format(
          "where {} and others see the same surface, their points are {:.1f} to {:.1f} times as "
          "far apart as predicted. Points of other pairs are {:.1f} times as far apart on average",
          name, *least, *most, rest.mean()),
      kCheckDepth};
}

}  // namespace

std::vector<RigFinding> FindPairsApart(const RefineResult& refined,
                                       const std::vector<std::string>& sensors) {
  std::vector<RigFinding> findings;
  for (const RefinedPair& pair : refined.pairs) {
    if (!(pair.rms > kClearly * pair.predicted_rms)) continue;
    const std::string &a = sensors[static_cast<std::size_t>(pair.a)],
                      &b = sensors[static_cast<std::size_t>(pair.b)];
    findings.push_back({RigCode::kPairApart,
                        {a, b},
                        fmt::format("where {} and {} see the same surface, their points are {:.1f} "
                                    "mm RMS apart; {:.1f} mm are predicted",
                                    a, b, 1000 * pair.rms, 1000 * pair.predicted_rms),
                        "check that the depth file of each is its own, then the intrinsics of "
                        "both, then whether anything moved between their frames"});
  }
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    if (std::optional<RigFinding> apart = FindApart(refined, static_cast<int>(i), sensors[i]))
      findings.push_back(std::move(*apart));
  }
  return findings;
}

}  // namespace volalign
