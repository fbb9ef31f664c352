#pragma once

#include <cstdint>

namespace volalign {

// The largest size in bytes that is read of each kind of file. Larger files, also sparse ones, are
// refused before memory is allocated. So a file takes no more than a small multiple of these.

/// Files that people write: recipes, structures, rigs, pools and files of intrinsics, capture.json.
inline constexpr std::uint64_t kMaxTextBytes = std::uint64_t{4} << 20;
/// Files that programs write: extrinsics.json, poses, evaluations, glTF.
inline constexpr std::uint64_t kMaxResultBytes = std::uint64_t{64} << 20;
/// Depth, labels and pictures.
inline constexpr std::uint64_t kMaxImageBytes = std::uint64_t{512} << 20;
/// metrics.jsonl and samples.jsonl.
inline constexpr std::uint64_t kMaxLogBytes = std::uint64_t{1} << 30;
/// Checkpoints, states of training, and the program itself. It is the limit of Zip archives without
/// ZIP64.
inline constexpr std::uint64_t kMaxModelBytes = (std::uint64_t{1} << 32) - 1;
/// Networks as ONNX. It is the limit of Protocol Buffers.
inline constexpr std::uint64_t kMaxOnnxBytes = (std::uint64_t{1} << 31) - 1;
/// Recordings that are read whole for their hash.
inline constexpr std::uint64_t kMaxRecordingBytes = std::uint64_t{1} << 34;

}  // namespace volalign
