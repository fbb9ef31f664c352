#include "infer/refine/parameters.h"

#include <cmath>
#include <utility>

#include "infer/refine/pose_manifold.h"

namespace volalign::refine_internal {

Eigen::MatrixXd FrameColumns::InTangentSpace(const Eigen::MatrixXd& over_blocks,
                                             const double* pose) {
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
  LeftPoseManifold().PlusJacobian(pose, plus.data());
  Eigen::MatrixXd columns(over_blocks.rows(), over_blocks.cols() - 1);
  columns.leftCols<6>() = over_blocks.leftCols<7>() * plus;
  columns.rightCols(columns.cols() - 6) = over_blocks.rightCols(over_blocks.cols() - 7);
  return columns;
}

Priors PriorsOf(const RefineOptions& options, std::size_t boxes) {
  Priors priors;
  priors.offset = options.depth_offset_sigma_m;
  if (options.depth_gain_sigma_percent >= 0) priors.gain = options.depth_gain_sigma_percent / 100;
  priors.edge_shift = options.edge_shift_sigma_px;
  priors.size = options.size_sigma_percent / 100;
  priors.box = boxes > 1 ? options.box_sigma_m : 0;
  priors.yaw = boxes > 1 ? options.box_sigma_deg * kDegree : 0;
  priors.bulge = options.bulge_sigma_m;
  return priors;
}

Eigen::VectorXd SharedPriorSigmas(const Priors& priors, const DepthErrorModel& errors,
                                  const BuildSize& build) {
  SensorErrorVector of_sensor;
  of_sensor << FrameErrorSigmas(errors), errors.seam_m, priors.gain.value_or(errors.unit_gain),
      priors.focal, priors.edge_shift, priors.edge_shift;
  const Eigen::Vector3d of_box(priors.box, priors.box, priors.yaw);
  Eigen::VectorXd sigmas(FrameColumns::kBoxes - FrameColumns::kOffset + build.parameters());
  sigmas << priors.offset, of_sensor, priors.lens, priors.size, of_box.replicate(build.boxes, 1),
      Eigen::VectorXd::Constant(build.sides, priors.bulge);
  return sigmas;
}

Eigen::VectorXd SharedValues(const FrameParameters& parameters, const BuildSize& build) {
  Eigen::VectorXd values(FrameColumns::kBoxes - FrameColumns::kOffset + build.parameters());
  values << *parameters.offset, Eigen::Map<const SensorErrorVector>(parameters.errors),
      LensChange::Zero(), *parameters.build.size,
      Eigen::Map<const Eigen::VectorXd>(parameters.build.boxes, Eigen::Index{3} * build.boxes),
      Eigen::Map<const Eigen::VectorXd>(parameters.build.bulges, build.sides);
  return values;
}

void State::UpdateBuilt(const BuildModel& model) {
  for (std::size_t capture = 0; capture < built.size(); ++capture)
    built[capture] = model.Built(Build(capture));
}

State NominalState(const Structure& structure, const std::vector<Pose>& poses,
                   const std::vector<SensorLens>& lenses, std::vector<FrameOf> frame_of,
                   const std::vector<Pose>& placements) {
  State state;
  state.frame_of = std::move(frame_of);
  for (const Pose& pose : poses) state.poses.emplace_back(pose);
  for (const Pose& placement : placements) state.placements.emplace_back(placement);
  std::size_t sensors = 0;
  for (const FrameOf& of : state.frame_of) sensors = std::max(sensors, of.sensor + 1);
  state.offsets.assign(poses.size(), 0);
  state.errors.assign(sensors, SensorErrorVector::Zero());
  for (const SensorLens& lens : lenses) state.lenses.push_back(lens.change);
  state.boxes.assign(placements.size(), std::vector<double>(3 * structure.boxes().size(), 0));
  const auto sides = static_cast<std::size_t>(BuildModel(structure).size().sides);
  state.bulges.assign(placements.size(), std::vector<double>(sides, 0));
  state.built.assign(placements.size(), structure);
  return state;
}

FreeSet AskedFor(const EstimateSet& asked, const Priors& priors, std::size_t frames,
                 const std::vector<SensorLens>& lenses) {
  FreeSet free;
  free.boxes = asked.boxes && priors.box > 0;
  free.size = asked.size && priors.size > 0;
  free.gain = asked.depth_gain && priors.gain != 0.0;
  free.offset = asked.depth_offset && priors.offset > 0;
  for (const SensorLens& lens : lenses) {
    // The boxes' size and place and the sensor's depth errors explain a single view as well as a
    // lens does.
    const bool identifiable = frames > 1 || lens.evidence.information.trace() > 0;
    free.lens.push_back(asked.lens && identifiable && lens.prior_sigmas.maxCoeff() > 0);
  }
  return free;
}

ParameterLayout::ParameterLayout(std::vector<FrameOf> frame_of, std::size_t captures,
                                 const BuildSize& build, std::size_t lenses)
    : frame_of_(std::move(frame_of)), build_(build), captures_(captures), lenses_(lenses) {
  for (const FrameOf& of : frame_of_) sensors_ = std::max(sensors_, of.sensor + 1);
}

std::vector<ParameterLayout::Block> ParameterLayout::Blocks(State* state) const {
  std::vector<Block> blocks;
  for (std::size_t i = 0; i < frames(); ++i)
    blocks.push_back({state->poses[i].values, Pose(i), 7, 6});
  for (std::size_t capture = 1; capture < captures_; ++capture)
    blocks.push_back({state->placements[capture].values, Placement(capture), 7, 6});
  for (std::size_t i = 0; i < frames(); ++i)
    blocks.push_back({&state->offsets[i], Offset(i), 1, 1});
  for (std::size_t s = 0; s < sensors_; ++s)
    blocks.push_back({state->errors[s].data(), ErrorsOfSensor(s), kSensorErrors, kSensorErrors});
  for (std::size_t lens = 0; lens < lenses_; ++lens)
    blocks.push_back({state->lenses[lens].data(), Lens(lens), kLensParameters, kLensParameters});
  blocks.push_back({&state->size, Size(), 1, 1});
  for (std::size_t capture = 0; capture < captures_; ++capture)
    blocks.push_back(
        {state->boxes[capture].data(), Boxes(capture), 3 * build_.boxes, 3 * build_.boxes});
  for (std::size_t capture = 0; capture < captures_; ++capture)
    blocks.push_back({state->bulges[capture].data(), Bulges(capture), build_.sides, build_.sides});
  blocks.push_back({state->world.values, World(), 7, 6});
  blocks.push_back({&state->world_scale, WorldScale(), 1, 1});
  return blocks;
}

Eigen::VectorXd ParameterLayout::PriorSigmas(const Priors& priors,
                                             const std::vector<DepthErrorModel>& errors,
                                             const std::vector<SensorLens>& lenses) const {
  Eigen::VectorXd sigmas = Eigen::VectorXd::Constant(size(), kPoseSigma);
  std::vector<double> counts(sensors_, 0);
  for (std::size_t i = 0; i < frames(); ++i) {
    ++counts[frame_of_[i].sensor];
    Priors own = priors;
    own.focal = lenses[frame_of_[i].lens].own_focal_sigma;
    sigmas.segment<kSensorErrors>(ErrorsOfSensor(frame_of_[i].sensor)) =
        SharedPriorSigmas(own, errors[i], {})
            .segment<kSensorErrors>(FrameColumns::kErrors - FrameColumns::kOffset);
  }
  // The offsets of n frames are nearly equal: their n priors together count as one.
  for (std::size_t i = 0; i < frames(); ++i)
    sigmas[Offset(i)] = priors.offset * std::sqrt(counts[frame_of_[i].sensor]);
  for (std::size_t lens = 0; lens < lenses_; ++lens)
    sigmas.segment<kLensParameters>(Lens(lens)) = lenses[lens].prior_sigmas;
  const Eigen::VectorXd build = SharedPriorSigmas(priors, {}, build_).tail(1 + build_.parameters());
  sigmas[Size()] = build[0];
  for (std::size_t capture = 0; capture < captures_; ++capture) {
    sigmas.segment(Boxes(capture), 3 * build_.boxes) = build.segment(1, 3 * build_.boxes);
    sigmas.segment(Bulges(capture), build_.sides) = build.tail(build_.sides);
  }
  return sigmas.unaryExpr(&Positive);
}

std::vector<Eigen::Index> ParameterLayout::ColumnsOf(std::size_t frame) const {
  std::vector<Eigen::Index> columns;
  const auto add = [&](Eigen::Index first, Eigen::Index count) {
    for (Eigen::Index k = 0; k < count; ++k) columns.push_back(first + k);
  };
  const FrameOf& of = frame_of_[frame];
  add(Pose(frame), 6);
  add(Offset(frame), 1);
  add(ErrorsOfSensor(of.sensor), kSensorErrors);
  add(Lens(of.lens), kLensParameters);
  add(Size(), 1);
  add(Boxes(of.capture), Eigen::Index{3} * build_.boxes);
  add(Bulges(of.capture), build_.sides);
  return columns;
}

std::vector<char> ParameterLayout::Constant(const FreeSet& free,
                                            const std::vector<char>& fixed) const {
  std::vector<char> constant(static_cast<std::size_t>(size()), 0);
  const auto hold = [&](Eigen::Index first, int count) {
    std::fill_n(constant.begin() + first, count, 1);
  };
  std::vector<char> is_moved(sensors_, fixed.empty());
  for (std::size_t i = 0; i < frames(); ++i) {
    if (!free.offset) hold(Offset(i), 1);
    if (!free.gain) hold(Error(i, kGain), 1);
    if (!free.lens[frame_of_[i].lens]) hold(Error(i, kFocal), 1);
    if (fixed.empty()) continue;
    if (fixed[i]) {
      hold(Pose(i), 6);
      hold(Offset(i), 1);
    } else {
      is_moved[frame_of_[i].sensor] = 1;
    }
  }
  for (std::size_t s = 0; s < sensors_; ++s) {
    if (!is_moved[s]) hold(ErrorsOfSensor(s), kSensorErrors);
  }
  for (std::size_t lens = 0; lens < lenses_; ++lens) {
    if (!free.lens[lens]) hold(Lens(lens), kLensParameters);
  }
  if (!free.size) hold(Size(), 1);
  if (!free.boxes) hold(Boxes(0), static_cast<int>(Bulges(0) - Boxes(0)));
  return constant;
}

std::optional<PriorGroup> ParameterLayout::GroupOf(Eigen::Index column) const {
  if (column == Size()) return kSizes;
  if (column >= Boxes(0) && column < Bulges(0))
    return (column - Boxes(0)) % 3 == BuildModel::Yaw(0) ? kTurns : kPlaces;
  if (column >= Offset(0) && column < ErrorsOfSensor(0)) return kOffsets;
  if (column < ErrorsOfSensor(0) || column >= Lens(0)) return std::nullopt;
  switch ((column - ErrorsOfSensor(0)) % kSensorErrors) {
    case kGain:
      return kGains;
    case kDiffuseMultipath:
      return kDiffuseMultipaths;
    default:
      return std::nullopt;
  }
}

Eigen::VectorXd ParameterLayout::Scales(const PriorScales& scales) const {
  Eigen::VectorXd of = Eigen::VectorXd::Ones(size());
  for (Eigen::Index k = 0; k < size(); ++k) {
    if (const auto group = GroupOf(k)) of[k] = scales[*group];
  }
  return of;
}

Eigen::VectorXd ParameterLayout::Values(const State& state) const {
  Eigen::VectorXd values = Eigen::VectorXd::Zero(size());
  State copy = state;
  for (const Block& block : Blocks(&copy)) {
    if (block.size != block.tangent_size) continue;
    for (int k = 0; k < block.size; ++k) values[block.column + k] = block.values[k];
  }
  return values;
}

}  // namespace volalign::refine_internal
