#include "infer/formats/recording.h"

#include <fmt/format.h>

#include <fstream>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

namespace {

/// A kind of recording: what its files begin with, and its reader.
struct Kind {
  const char* magic;
  std::vector<RecordedDepth> (*read)(const std::filesystem::path& path, int max_frames);
};
std::vector<RecordedDepth> ReadRos2(const std::filesystem::path& path, int max_frames) {
  // Of a bag of a million messages and a hundred topics.
  constexpr std::int64_t kMostSteps = 1'000'000'000;
  return formats_internal::ReadRos2Recording(path, max_frames, kMostSteps);
}

constexpr Kind kKinds[] = {{"#ROSBAG V", formats_internal::ReadBagRecording},
                           {"SQLite format 3", ReadRos2},
                           {"\x1a\x45\xdf\xa3", formats_internal::ReadMkvRecording}};

std::string FirstBytes(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return "";
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(16, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(stream.gcount()));
  return bytes;
}

/// Null for a file of another kind.
const Kind* KindOf(const std::string& bytes) {
  for (const Kind& kind : kKinds) {
    if (bytes.rfind(kind.magic, 0) == 0) return &kind;
  }
  return nullptr;
}

}  // namespace

bool IsRecording(const std::filesystem::path& path) { return KindOf(FirstBytes(path)) != nullptr; }

std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames) {
  const std::string bytes = FirstBytes(path);
  if (bytes.empty()) throw IoError(path.string() + ": cannot be read, or is no file");
  const Kind* const kind = KindOf(bytes);
  if (!kind) {
    throw DataError(fmt::format(
        "{}: neither a bag of ROS 1 or 2 (.bag, .db3) nor a Matroska file; expected a recording of "
        "these",
        path.string()));
  }
  std::vector<RecordedDepth> streams = kind->read(path, max_frames);
  if (streams.empty())
    throw DataError(path.string() + ": the recording has no depth stream with a frame");
  // They are printed.
  for (RecordedDepth& stream : streams) {
    for (std::string* text : {&stream.stream, &stream.device, &stream.serial})
      *text = Shortened(*text);
  }
  return streams;
}

namespace formats_internal {

std::string KindOfDevice(const std::string& device) {
  // The pool's RealSense; others have lenses of their own.
  return Lower(device).find("realsense d415") != std::string::npos ? "realsense_d415" : "";
}

}  // namespace formats_internal

}  // namespace volalign
