#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "render/rig.h"

namespace volalign {

/// m, one step of the depth images.
inline constexpr double kDepthScale = 0.001;

/// Writes a capture folder (docs/formats.md): capture.json with ground truth (left out without a
/// structure), structure.yaml and contact_sheet.png. Per sensor: NAME_depth.png (16 bits, mm),
/// NAME_intrinsics.json, both as for recorded frames, and NAME_labels.png (8 bits, after noise).
/// The contact sheet has clean depth, depth and labels of every sensor, turned upright. `renderer`
/// describes the renderer (Renderers::description). Throws IoError.
void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture,
                  const std::string& renderer);

/// A picture for a contact sheet: clean depth, depth and labels side by side, turned upright, each
/// below `name` and its kind.
RgbImage SheetPicture(const std::string& name, const DepthImage& clean, const DepthImage& depth,
                      const LabelImage& labels, const Pose& structure_from_sensor);

/// Writes SheetPictures side by side, with the scale of their depths below them, in rows as wide as
/// two of them. Up to three are in one row. Throws IoError.
void WriteContactSheet(const std::filesystem::path& path, const std::vector<RgbImage>& pictures);

}  // namespace volalign
