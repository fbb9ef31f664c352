#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "infer/report/extrinsics.h"
#include "infer/rigcheck/movement.h"

namespace volalign {

inline constexpr char kRigCheckFormat[] = "volalign.check/1";

/// The content of check.json (docs/formats.md): a calibration against a later capture of the same
/// rig.
struct RigCheck {
  /// A sensor without two poses to compare.
  struct NotCompared {
    std::string name;
    std::string reason;  ///< part of a sentence: "it failed now (no_depth): ..."
  };
  std::string tool;
  std::string last;  ///< extrinsics.json
  std::vector<std::string> captures;
  bool same_structure = true;      ///< both have the same description
  std::vector<std::string> moved;  ///< MovementOptions::moved
  Movements movements;
  std::vector<Exchanged> exchanged;  ///< may explain why sensors moved
  std::vector<NotCompared> not_compared;

  /// Has a sensor moved by more than these limits, or is one undecided?
  bool MovedBeyond(double translation_m, double rotation_deg) const;
};

/// Compares two calibrations. `last` was read from `last_file`. Throws DataError if they have no
/// sensor in common, or not each of MovementOptions::moved.
RigCheck CheckRig(const std::string& last_file, const Extrinsics& last, const Extrinsics& now,
                  const MovementOptions& options = {});

/// The text of check.json. `where` begins every message.
std::string RigCheckText(const RigCheck& check, const std::string& where);

/// Writes RigCheckText to a file, atomically. Throws IoError.
void WriteRigCheck(const std::filesystem::path& path, const RigCheck& check);

/// The result in sentences; the first is the headline.
std::vector<std::string> RigCheckSentences(const RigCheck& check);

/// A table of the sensors, and sentences on movements, for a terminal.
std::string FormatRigCheck(const RigCheck& check);

/// `last` with new poses of the sensors that moved and of those that only `now` places. All are in
/// the structure frame of `last`, and sensors that stayed keep every digit. The metrics are left
/// out, because they are of the earlier rig. Throws DataError if it is undecided what moved, or if
/// no sensor stayed.
Extrinsics UpdateExtrinsics(const Extrinsics& last, const Extrinsics& now, const RigCheck& check);

/// Which sensors have a new pose in it, and which of the new capture have none.
std::string UpdateSentence(const Extrinsics& last, const Extrinsics& now, const RigCheck& check);

}  // namespace volalign
