#include "infer/refine/build_model.h"

#include <Eigen/Geometry>
#include <vector>

namespace volalign::refine_internal {

Pose BuildModel::Offset(const BuildParameters& build, int box) const {
  const Eigen::Vector3d centre =
      structure_->boxes()[static_cast<std::size_t>(box)].structure_from_box.translation();
  const Eigen::Vector3d shift(build.boxes[X(box)], *build.size * (centre.y() - floor_),
                              build.boxes[Z(box)]);
  Pose offset = Pose::Identity();
  offset.linear() =
      Eigen::AngleAxisd(build.boxes[Yaw(box)], Eigen::Vector3d::UnitY()).toRotationMatrix();
  offset.translation() = centre - offset.linear() * centre + shift;
  return offset;
}

Structure BuildModel::Built(const BuildParameters& build) const {
  std::vector<Pose> offsets;
  offsets.reserve(structure_->boxes().size());
  for (int b = 0; b < static_cast<int>(structure_->boxes().size()); ++b)
    offsets.push_back(Offset(build, b));
  return structure_->Displaced(offsets, 1 + *build.size);
}

}  // namespace volalign::refine_internal
