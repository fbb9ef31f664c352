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
/// structure), structure.glb and, per sensor, NAME_Depth.png (16 bits, mm) and NAME_labels.png (8
/// bits, what the noise left); contact_sheet.png shows clean depth, depth and labels of every
/// sensor, turned upright. Throws IoError.
void WriteCapture(const std::filesystem::path& dir, const RigCapture& capture);

/// Appends three pictures for a contact sheet, turned upright, each below `name` and what it is:
/// clean depth, depth and labels.
void AppendPictures(const std::string& name, const DepthImage& clean, const DepthImage& depth,
                    const LabelImage& labels, const Pose& structure_from_sensor,
                    std::vector<RgbImage>* pictures);

/// The depths of contact sheets in colours, from 0.5 to 6 m.
RgbImage ColourSheetDepth(const DepthImage& depth);

/// Writes these pictures as one, with the scale of the depths; `columns` a row, 0: 6, or 3 where
/// there are few. Throws IoError.
void WriteContactSheet(const std::filesystem::path& path, const std::vector<RgbImage>& pictures,
                       int columns = 0);

}  // namespace volalign
