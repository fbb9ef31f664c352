#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/structure.h"
#include "core/model/network_options.h"

namespace volalign {

/// What a network was trained on: all that calibration and validation have to know beside the
/// weights.
struct CheckpointMeta {
  StructureNetOptions network;
  Structure structure;
  std::pair<double, double> focal_px{0, 0};      ///< least and largest focal length in training, px
  std::vector<std::pair<int, int>> image_sizes;  ///< width, height
  std::vector<double> roll_offsets_deg;          ///< mounting rolls in training (PoseConfig), deg
  std::int64_t samples = 0;  ///< number of training samples, those of run.init included
  std::string config_yaml;   ///< the resolved training configuration
  std::string tool;          ///< "volalign 0.1.0"; filled by SaveCheckpoint
};

/// The metadata as JSON text, as every format of a network holds it.
std::string MetaToJson(const CheckpointMeta& meta);

/// Reads that text. Throws DataError or ConfigError for another one, for invalid options and for a
/// structure with another number of classes than the network.
CheckpointMeta MetaFromJson(const std::string& text);

/// How sensors were mounted in training: "portrait" where all rolls are quarter turns (90, 270
/// deg), "landscape" where they are 0 or 180 deg, else "any".
std::string OrientationOf(const CheckpointMeta& meta);

/// Throws DataError unless the structure has the network's number of classes.
void RequireClasses(const CheckpointMeta& meta);

/// Throws ConfigError, which names the file `what`, unless the network is of the paper's kind: an
/// export writes down how it is computed, which of another kind is not known.
void RequirePaperNet(const CheckpointMeta& meta, const std::string& what);

/// Throws DataError unless `structure` has the side names and labels that the model was trained on;
/// dimensions and placements may differ.
void CheckStructure(const CheckpointMeta& meta, const Structure& structure);

}  // namespace volalign
