#pragma once

#include <cstdint>

namespace volalign {

// The most bytes that are read of a file of each kind. What is larger is refused before memory is
// taken, so that no file, a sparse one neither, costs more than a small multiple of these.

/// What people write: recipes, structures, rigs, pools and files of intrinsics, capture.json.
inline constexpr std::uint64_t kMaxTextBytes = std::uint64_t{4} << 20;
/// What programs write: extrinsics.json, poses, evaluations, glTF.
inline constexpr std::uint64_t kMaxResultBytes = std::uint64_t{64} << 20;
/// Depth, labels and pictures.
inline constexpr std::uint64_t kMaxImageBytes = std::uint64_t{512} << 20;
/// metrics.jsonl and samples.jsonl.
inline constexpr std::uint64_t kMaxLogBytes = std::uint64_t{1} << 30;
/// Checkpoints, states of training, and the program itself. Zip archives without ZIP64 end here.
inline constexpr std::uint64_t kMaxModelBytes = (std::uint64_t{1} << 32) - 1;
/// Networks as ONNX: Protocol Buffers end here.
inline constexpr std::uint64_t kMaxOnnxBytes = (std::uint64_t{1} << 31) - 1;
/// Recordings, where they are read whole for their hash.
inline constexpr std::uint64_t kMaxRecordingBytes = std::uint64_t{1} << 34;

}  // namespace volalign
