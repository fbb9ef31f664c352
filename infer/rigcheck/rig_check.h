#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "infer/report/extrinsics.h"
#include "infer/rigcheck/movement.h"

namespace volalign {

inline constexpr char kRigCheckFormat[] = "volalign.check/1";

/// check.json (docs/formats.md): a calibration against a later capture of the same rig.
struct RigCheck {
  /// A sensor of either that has not two poses to compare.
  struct NotCompared {
    std::string name;
    std::string reason;  ///< a part of a sentence, "it failed now (no_depth): ..."
  };
  std::string tool;
  std::string last;  ///< extrinsics.json
  std::vector<std::string> captures;
  bool same_structure = true;  ///< both are described alike
  Movements movements;
  std::vector<Exchanged> exchanged;  ///< the first that explains why sensors moved
  std::vector<NotCompared> not_compared;

  /// What has moved by more than these; where that is undecided, of something that has moved.
  bool MovedBeyond(double translation_m, double rotation_deg) const;
};

/// `last_file` is where `last` was read from. Throws DataError where they have no sensor in common.
RigCheck CheckRig(const std::string& last_file, const Extrinsics& last, const Extrinsics& now,
                  const MovementOptions& options = {});

/// check.json's text. `where` begins every message.
std::string RigCheckText(const RigCheck& check, const std::string& where);

/// Writes atomically. Throws IoError.
void WriteRigCheck(const std::filesystem::path& path, const RigCheck& check);

/// What was found, in sentences; the first is the headline.
std::vector<std::string> RigCheckSentences(const RigCheck& check);

/// A table of the sensors, and sentences on what moved; for a terminal.
std::string FormatRigCheck(const RigCheck& check);

/// `last` with new poses of the sensors that moved, and with those that only `now` places; all in
/// the structure frame of `last`, where the sensors that stayed keep every digit. Its metrics,
/// which are of another rig, are left out. Throws DataError where it is undecided what moved.
Extrinsics UpdateExtrinsics(const Extrinsics& last, const Extrinsics& now, const RigCheck& check);

}  // namespace volalign
