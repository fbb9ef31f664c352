#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "render/rig.h"

namespace volalign {

/// m, of one step of the depth images that are written.
inline constexpr double kDepthScale = 0.001;

/// Writes a capture folder (docs/formats.md): capture.json with ground truth (left out without a
/// structure), structure.yaml and, per sensor, NAME_depth.png (16 bits, mm), NAME_intrinsics.json,
/// as they are for frames of one's own, and NAME_labels.png (8 bits, what the noise left);
/// contact_sheet.png shows clean depth, depth and labels of every sensor, turned upright.
/// `renderer` says in words what drew it (Renderers::description).
/// Throws IoError.
void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture,
                  const std::string& renderer);

/// For a contact sheet: clean depth, depth and labels side by side, turned upright, each below
/// `name` and what it is.
RgbImage SheetPicture(const std::string& name, const DepthImage& clean, const DepthImage& depth,
                      const LabelImage& labels, const Pose& structure_from_sensor);

/// The depths of contact sheets in colours, from 0.5 to 6 m.
RgbImage ColourSheetDepth(const DepthImage& depth);

/// Writes a picture with the scale of these depths below it. Throws IoError.
void WriteContactSheet(const std::filesystem::path& path, const RgbImage& sheet);

/// The same of SheetPictures side by side, in rows as wide as two of them; as one, of up to three.
void WriteContactSheet(const std::filesystem::path& path, const std::vector<RgbImage>& pictures);

}  // namespace volalign
