#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "render/noise.h"

namespace volalign {

/// A face of the scene in a sensor's frame.
struct SeenFace {
  Eigen::Vector3f normal;  ///< unit, sensor frame, towards the sensor
  float height = 0;        ///< distance of the sensor from the plane, m
  std::array<Eigen::Vector3f, 4>
      beside;                        ///< a ray r goes through the face where all r . beside >= 0
  Eigen::Vector3f corner;            ///< the first of the face's, sensor frame, m
  Eigen::Vector3f along_u, along_v;  ///< from there to its neighbours, m
  float bulge = 0;                   ///< m, outwards, in the middle
  const SceneObject* object = nullptr;
  std::uint8_t label = 0;
};

/// The scene along rays between those of a view's pixels: the nearest of the faces that the pixel
/// and its eight neighbours show. Faces smaller than a pixel that no pixel shows are not found.
class Subpixels {
 public:
  explicit Subpixels(const NoiseInput& input);

  /// `index`: of the SceneFace.
  const SeenFace& face(int index) const { return faces_[static_cast<std::size_t>(index)]; }
  /// Do the pixel and its neighbours show one face, or none?
  bool IsUniform(int u, int v) const;
  /// The ray of the point (x, y) of the picture, px. Pixel centres are whole numbers.
  Eigen::Vector3f Ray(double x, double y) const;
  /// Index of the face that the ray meets; -1 if none. (u, v): the nearest pixel.
  int FaceAlong(const Eigen::Vector3f& ray, int u, int v) const;
  /// Depth, m, where the ray meets the face. Sides of the structure's boxes bulge like those of
  /// cardboard, by half a sine along both edges, and equally for all sensors. Meshes do not.
  float Depth(int index, const Eigen::Vector3f& ray) const;

 private:
  const RenderedView& view_;
  std::vector<SeenFace> faces_;
};

}  // namespace volalign
