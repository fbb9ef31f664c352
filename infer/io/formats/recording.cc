#include "infer/io/formats/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <fstream>

#include "core/error.h"

namespace volalign {

namespace {

constexpr char kBagMagic[] = "#ROSBAG V";
constexpr char kSqliteMagic[] = "SQLite format 3";
constexpr char kEbmlMagic[] = "\x1a\x45\xdf\xa3";

std::string FirstBytes(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return "";
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(16, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(stream.gcount()));
  return bytes;
}

bool IsBag(const std::string& bytes) { return bytes.rfind(kBagMagic, 0) == 0; }
bool IsRos2(const std::string& bytes) { return bytes.rfind(kSqliteMagic, 0) == 0; }
bool IsMkv(const std::string& bytes) { return bytes.rfind(kEbmlMagic, 0) == 0; }

}  // namespace

bool IsRecording(const std::filesystem::path& path) {
  const std::string bytes = FirstBytes(path);
  return IsBag(bytes) || IsRos2(bytes) || IsMkv(bytes);
}

std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames) {
  const std::string bytes = FirstBytes(path);
  if (bytes.empty()) throw IoError(path.string() + ": cannot be read, or is no file");
  if (!IsBag(bytes) && !IsRos2(bytes) && !IsMkv(bytes)) {
    throw DataError(fmt::format(
        "{}: neither a bag of ROS 1 or 2 (.bag, .db3) nor a Matroska file; expected a recording of "
        "these",
        path.string()));
  }
  std::vector<RecordedDepth> streams =
      IsBag(bytes)    ? formats_internal::ReadBagRecording(path, max_frames)
      : IsRos2(bytes) ? formats_internal::ReadRos2Recording(path, max_frames)
                      : formats_internal::ReadMkvRecording(path, max_frames);
  if (streams.empty())
    throw DataError(path.string() + ": the recording has no depth stream with a frame");
  return streams;
}

namespace formats_internal {

std::string KindOfDevice(const std::string& device) {
  std::string name = device;
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  // The pool's RealSense; others have lenses of their own.
  return name.find("realsense d415") != std::string::npos ? "realsense_d415" : "";
}

}  // namespace formats_internal

}  // namespace volalign
