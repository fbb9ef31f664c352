// Depth streams of an MCAP file (mcap.dev/spec): messages of ROS 1 or of ROS 2. It is read from the
// front, without its index, so that a file that was cut off still gives its frames.

#include <fmt/format.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/recording.h"
#include "infer/formats/ros_depth.h"
#include "infer/formats/unpack.h"

namespace volalign::formats_internal {

namespace {

constexpr std::size_t kMagic = 8;                             // bytes
constexpr std::uint64_t kMaxRecord = std::uint64_t{1} << 28;  // bytes, packed or unpacked
constexpr std::size_t kMaxChannels = 1000;

enum Opcode : std::uint8_t {
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kDataEnd = 0x0F
};

struct Channel {
  std::uint16_t schema = 0;
  std::string topic, encoding;
};

std::uint32_t Crc32(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

class McapReader {
 public:
  McapReader(const std::filesystem::path& path, const std::string& name, int max_frames,
             ReadBudget* budget)
      : name_(name), reading_{name_, max_frames, budget}, stream_(path, std::ios::binary) {
    std::error_code error;
    size_ = std::filesystem::file_size(path, error);
    if (!stream_ || error) throw IoError(name_ + ": cannot be read");
  }

  RosContent Read() {
    stream_.seekg(kMagic);
    std::uint64_t at = kMagic;
    constexpr std::uint64_t kHead = 1 + sizeof(std::uint64_t);
    Skipped skipped;
    while (size_ >= at + kHead) {
      std::string head(kHead, '\0');
      stream_.read(head.data(), kHead);
      at += kHead;
      std::uint64_t length = 0;
      std::memcpy(&length, head.data() + 1, sizeof(length));
      const auto opcode = static_cast<std::uint8_t>(head[0]);
      // There is no opcode 0: the file has a hole, or became shorter.
      if (opcode == 0 || opcode == kDataEnd || opcode == kFooter) break;
      // The last record of a recording that was cut off.
      if (length > size_ - at) break;
      if (opcode == kChunk) skipped = {at, complete_ ? length : 0};
      if (opcode == kMessageIndex && skipped.length > 0 && NamesNewChannel(length)) {
        Take(kChunk, ReadRecord(skipped.at, skipped.length), /*within_chunk=*/false);
        skipped.length = 0;
      }
      if (IsWanted(opcode)) Take(opcode, ReadRecord(at, length), /*within_chunk=*/false);
      at += length;
      Seek(at);
    }
    return std::move(content_);
  }

 private:
  /// A chunk that was not read; of length 0 if there is none.
  struct Skipped {
    std::uint64_t at = 0, length = 0;  // bytes
  };

  /// Once all streams have their frames, only records outside chunks are.
  bool IsWanted(std::uint8_t opcode) const {
    return opcode == kSchema || opcode == kChannel || opcode == kMessage ||
           (opcode == kChunk && !complete_);
  }

  /// Is the record of an index, which stands next, of a channel without a message so far?
  bool NamesNewChannel(std::uint64_t length) {
    std::uint16_t id = 0;
    if (length < sizeof(id)) return false;
    stream_.read(reinterpret_cast<char*>(&id), sizeof(id));
    return heard_.count(id) == 0;
  }

  void Seek(std::uint64_t at) {
    const auto to = static_cast<std::streamoff>(at);
    if (stream_.tellg() != to) stream_.seekg(to);  // which discards what is buffered
  }

  std::string ReadRecord(std::uint64_t at, std::uint64_t length) {
    if (length > kMaxRecord)
      throw DataError(fmt::format("{}: damaged: a record of {} bytes", name_, length));
    std::string record(length, '\0');
    Seek(at);
    stream_.read(record.data(), static_cast<std::streamsize>(length));
    if (!stream_) throw IoError(name_ + ": cannot be read");
    return record;
  }

  void Take(std::uint8_t opcode, std::string_view record, bool within_chunk) {
    ByteReader reader(record, name_);
    if (opcode == kSchema) {
      const auto id = reader.Value<std::uint16_t>();
      schemas_.emplace(id, BoundedText(reader.Block(), name_, kMostTopicBytes));
    } else if (opcode == kChannel) {
      const auto id = reader.Value<std::uint16_t>();
      Channel channel;
      channel.schema = reader.Value<std::uint16_t>();
      channel.topic = BoundedText(reader.Block(), name_, kMostTopicBytes);
      channel.encoding = BoundedText(reader.Block(), name_, kMostTopicBytes);
      channels_.emplace(id, std::move(channel));
      if (channels_.size() > kMaxChannels) {
        throw DataError(
            fmt::format("{}: more than the {} topics that are read of a bag", name_, kMaxChannels));
      }
    } else if (opcode == kMessage) {
      TakeMessage(&reader);
    } else if (opcode == kChunk && !within_chunk) {
      TakeChunk(&reader);
    }
  }

  void TakeMessage(ByteReader* reader) {
    const auto channel = channels_.find(reader->Value<std::uint16_t>());
    if (channel == channels_.end()) throw DataError(name_ + ": damaged: a message of no channel");
    heard_.insert(channel->first);
    reader->Take(sizeof(std::uint32_t) + 2 * sizeof(std::uint64_t));  // sequence, two times
    const std::string_view message = reader->Take(reader->left());
    const auto schema = schemas_.find(channel->second.schema);
    const std::string type = schema == schemas_.end() ? "" : schema->second;
    const std::string& topic = channel->second.topic;
    if (channel->second.encoding == "ros1") {
      CollectRos1(topic, type, message, reading_, &content_);
    } else if (channel->second.encoding == "cdr") {
      CollectRos2(topic, type, message, reading_, &content_);
    } else {
      content_.contents.emplace(topic,
                                fmt::format("{}, encoded as {}", type, channel->second.encoding));
    }
  }

  void TakeChunk(ByteReader* reader) {
    reader->Take(2 * sizeof(std::uint64_t));  // times of the first and the last message
    const auto size = reader->Value<std::uint64_t>();
    const auto crc = reader->Value<std::uint32_t>();
    const std::string_view compression = reader->Block();
    const std::string_view packed = reader->Take(reader->Value<std::uint64_t>());
    if (size > kMaxRecord)
      throw DataError(fmt::format("{}: damaged: a chunk of {} bytes", name_, size));
    std::string unpacked;
    std::string_view records = packed;
    if (!compression.empty()) {
      if (compression != "zstd" && compression != "lz4") {
        throw DataError(fmt::format("{}: a chunk is compressed as \"{}\"; zstd and lz4 are read",
                                    name_, Shortened(std::string(compression))));
      }
      if (compression == "zstd") {
        unpacked = UnpackZstd(packed, size, name_, reading_.budget);
      } else {
        reading_.budget->Unpack(size, name_);
        unpacked = UnpackLz4(packed, size, name_);
      }
      records = unpacked;
    }
    if (records.size() != size || (crc != 0 && Crc32(records) != crc))
      throw DataError(name_ + ": damaged: a chunk's size or checksum (CRC-32) is not as stated");
    ByteReader inner(records, name_);
    while (inner.left() > 0) {
      reading_.budget->Unpack(kRecordCost, name_);
      const auto opcode = inner.Value<std::uint8_t>();
      const auto length = inner.Value<std::uint64_t>();
      Take(opcode, inner.Take(length), /*within_chunk=*/true);
    }
    // The rest of a long recording is skipped once every depth stream has its frames and a camera,
    // but for chunks whose index names a new channel.
    complete_ = HasAllFrames(content_, reading_.max_frames) && HaveCameras(content_);
  }

  std::string name_;
  RosReading reading_;
  std::ifstream stream_;
  std::uint64_t size_ = 0;
  bool complete_ = false;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::set<std::uint16_t> heard_;  // channels with messages
  RosContent content_;
};

}  // namespace

Recording ReadMcapRecording(const std::filesystem::path& path, const std::string& name,
                            int max_frames, ReadBudget* budget) {
  return DescribeStreams(McapReader(path, name, max_frames, budget).Read(), name);
}

}  // namespace volalign::formats_internal
