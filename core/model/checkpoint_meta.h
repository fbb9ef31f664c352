#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "core/model/network_options.h"

namespace volalign {

/// Description of a network for calibration and validation: all that they need beside the weights.
struct CheckpointMeta {
  StructureNetOptions network;
  Structure structure;
  std::pair<double, double> focal_px{0, 0};      ///< least and largest focal length in training, px
  std::vector<std::pair<int, int>> image_sizes;  ///< width, height
  std::vector<double> roll_offsets_deg;          ///< mounting rolls in training (PoseConfig), deg
  /// Those of the recipe's sensors in training; empty in older files.
  std::vector<IntrinsicsPoolEntry> intrinsics;
  std::int64_t samples = 0;  ///< number of training samples, including those of run.init
  std::string config_yaml;   ///< the resolved training configuration
  std::string renderer;      ///< program that drew the training samples, for people
  // SaveCheckpoint fills these in. date and libraries are "" in files of 0.1.0.
  std::string tool, date;  ///< see core/base/provenance.h
  std::string libraries;   ///< "LibTorch 1.13.1"
};

/// The metadata as JSON text, as in every format of a network.
std::string MetaToJson(const CheckpointMeta& meta);

/// Reads that text. Throws DataError or ConfigError for any other text, for invalid options and for
/// a structure with another number of classes than the network.
CheckpointMeta MetaFromJson(const std::string& text);

/// Mounting of the sensors in training: "portrait" if all rolls are 90 or 270 deg, "landscape" if
/// they are 0 or 180 deg, else "any".
std::string OrientationOf(const CheckpointMeta& meta);

/// Throws DataError unless the structure has the network's number of classes.
void RequireClasses(const CheckpointMeta& meta);

/// Throws ConfigError, with the file `what`, unless the network is of the paper's kind. An export
/// has to write how a network is computed, which is unknown for other kinds.
void RequirePaperNet(const CheckpointMeta& meta, const std::string& what);

/// Throws DataError unless `structure` has the side names and labels of the model's training.
/// Dimensions and placements may differ.
void CheckStructure(const CheckpointMeta& meta, const Structure& structure);

}  // namespace volalign
