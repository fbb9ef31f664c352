// Depth streams of a bag: of the recorders of RealSense and Orbbec, and depth images of ROS 1.

#include <bzlib.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/read_budget.h"
#include "infer/formats/recording.h"
#include "infer/formats/ros_depth.h"
#include "infer/formats/unpack.h"

namespace volalign::formats_internal {

namespace {

constexpr char kBagMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxChunk = std::uint32_t{1} << 28;  // bytes, packed or unpacked
constexpr std::uint32_t kMaxHeader = std::uint32_t{1} << 20;
constexpr std::size_t kMaxConnections = 1000;

// The kind of a record: its header's field "op".
enum Op : std::uint8_t {
  kMessageRecord = 2,
  kHeaderRecord = 3,
  kChunkRecord = 5,
  kConnectionRecord = 7
};

/// The fields of a record's header.
using Fields = std::map<std::string, std::string>;

Fields ParseFields(std::string_view header, const std::string& name) {
  Fields fields;
  ByteReader reader(header, name);
  while (reader.left() > 0) {
    const std::string_view field = reader.Block();
    const std::size_t equals = field.find('=');
    if (equals == std::string_view::npos) throw DataError(name + ": damaged: a field without =");
    fields[std::string(field.substr(0, equals))] = std::string(field.substr(equals + 1));
  }
  return fields;
}

template <class T>
T Field(const Fields& fields, const std::string& key, const std::string& name) {
  const auto found = fields.find(key);
  if (found == fields.end() || found->second.size() != sizeof(T))
    throw DataError(fmt::format("{}: damaged: a record without {}", name, key));
  T value;
  std::memcpy(&value, found->second.data(), sizeof(T));
  return value;
}

std::string TextField(const Fields& fields, const std::string& key) {
  const auto found = fields.find(key);
  return found == fields.end() ? "" : found->second;
}

std::string UnpackBz2(const std::string& packed, std::uint32_t size, const std::string& name) {
  std::string bytes(size, '\0');
  unsigned int length = size;
  if (BZ2_bzBuffToBuffDecompress(bytes.data(), &length, const_cast<char*>(packed.data()),
                                 static_cast<unsigned int>(packed.size()), 0, 0) != BZ_OK ||
      length != size) {
    throw DataError(name + ": damaged: a bz2 chunk cannot be unpacked");
  }
  return bytes;
}

std::string Unpack(const Fields& header, std::string data, const std::string& name,
                   ReadBudget* budget) {
  const std::string compression = TextField(header, "compression");
  const auto size = Field<std::uint32_t>(header, "size", name);
  if (size > kMaxChunk)
    throw DataError(fmt::format("{}: damaged: a chunk of {} bytes", name, size));
  budget->Unpack(size, name);
  if (compression == "none") return data;
  if (compression == "bz2") return UnpackBz2(data, size, name);
  if (compression == "lz4") return UnpackLz4(data, size, name);
  throw DataError(fmt::format("{}: chunks are packed by \"{}\", which is unknown", name,
                              Shortened(compression)));
}

struct BagConnection {
  std::string topic;
  std::string type;  ///< "sensor_msgs/Image"
};

/// A bag of ROS 1, format 2.0 (wiki.ros.org/Bags/Format/2.0). All functions throw DataError if the
/// file is damaged. They trust no length that it states.
class RosBag {
 public:
  /// Throws IoError or DataError.
  RosBag(const std::filesystem::path& path, const RosReading& reading);

  /// Reads the chunks, in the file's order, until nothing more is to come.
  RosContent Read();

 private:
  struct Record;
  bool ReadRecord(Record* record);
  void AddConnection(const Fields& header, std::string_view data);
  void TakeChunk(const Record& chunk);
  bool IsComplete() const;

  const RosReading& reading_;
  const std::string& name_;
  std::ifstream stream_;
  std::uint64_t size_ = 0, at_ = 0, first_record_ = 0;
  bool has_index_ = false;  ///< else it was cut off: further connections may still come
  /// Those in the index at the file's end, and those of the messages so far.
  std::map<std::uint32_t, BagConnection> connections_;
  RosContent content_;
};

struct RosBag::Record {
  std::uint8_t op = 0;
  Fields header;
  std::string data;
};

RosBag::RosBag(const std::filesystem::path& path, const RosReading& reading)
    : reading_(reading), name_(reading.name) {
  std::error_code error;
  size_ = std::filesystem::file_size(path, error);
  stream_.open(path, std::ios::binary);
  if (error || !stream_) throw IoError(name_ + ": cannot be read");
  std::string magic(sizeof(kBagMagic) - 1, '\0');
  stream_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (magic != kBagMagic)
    throw DataError(name_ + ": a bag of another version than 2.0; `rosbag fix` writes 2.0");
  at_ = magic.size();
  Record first;
  if (!ReadRecord(&first) || first.op != kHeaderRecord)
    throw DataError(name_ + ": damaged: no header");
  first_record_ = at_;
  // 0 if the recorder was killed: connections are then in the chunks alone.
  at_ = Field<std::uint64_t>(first.header, "index_pos", name_);
  Record record;
  while (at_ >= first_record_ && at_ < size_ && ReadRecord(&record) &&
         record.op == kConnectionRecord)
    AddConnection(record.header, record.data);
  has_index_ = !connections_.empty();
}

bool RosBag::ReadRecord(Record* record) {
  if (at_ >= size_) return false;
  stream_.clear();
  stream_.seekg(static_cast<std::streamoff>(at_));
  const auto block = [&](std::string* bytes, std::uint32_t most) {
    std::uint32_t length = 0;
    stream_.read(reinterpret_cast<char*>(&length), sizeof(length));
    at_ += sizeof(length);
    if (!stream_ || length > size_ - at_) return false;
    if (length > most)
      throw DataError(fmt::format("{}: damaged: a record of {} bytes", name_, length));
    bytes->resize(length);
    stream_.read(bytes->data(), length);
    at_ += length;
    return static_cast<bool>(stream_);
  };
  std::string header;
  // A recording that was cut off ends in the middle of a record; the whole records still serve.
  if (!block(&header, kMaxHeader) || !block(&record->data, kMaxChunk)) {
    at_ = size_;
    return false;
  }
  record->header = ParseFields(header, name_);
  record->op = Field<std::uint8_t>(record->header, "op", name_);
  return true;
}

void RosBag::AddConnection(const Fields& header, std::string_view data) {
  connections_[Field<std::uint32_t>(header, "conn", name_)] = {
      BoundedText(TextField(header, "topic"), name_, kMostTopicBytes),
      BoundedText(TextField(ParseFields(data, name_), "type"), name_, kMostTopicBytes)};
  if (connections_.size() > kMaxConnections) {
    throw DataError(
        fmt::format("{}: more than the {} topics that are read of a bag", name_, kMaxConnections));
  }
}

void RosBag::TakeChunk(const Record& chunk) {
  const std::string bytes = Unpack(chunk.header, chunk.data, name_, reading_.budget);
  ByteReader reader(bytes, name_);
  while (reader.left() > 0) {
    reading_.budget->Unpack(kRecordCost, name_);
    const Fields header = ParseFields(reader.Block(), name_);
    const std::string_view data = reader.Block();
    const auto op = Field<std::uint8_t>(header, "op", name_);
    if (op == kConnectionRecord) {
      AddConnection(header, data);
    } else if (op == kMessageRecord) {
      const auto found = connections_.find(Field<std::uint32_t>(header, "conn", name_));
      if (found == connections_.end())
        throw DataError(name_ + ": damaged: a message of an unknown connection");
      CollectRos1(found->second.topic, found->second.type, data, reading_, &content_);
    }
  }
}

RosContent RosBag::Read() {
  at_ = first_record_;
  Record record;
  while (!IsComplete() && ReadRecord(&record)) {
    if (record.op == kConnectionRecord) AddConnection(record.header, record.data);
    if (record.op == kChunkRecord) TakeChunk(record);
  }
  return std::move(content_);
}

/// Is nothing more to come? Every image topic that may be depth then has all its frames, and a
/// message of each topic that describes them was seen.
bool RosBag::IsComplete() const {
  if (!has_index_ || content_.streams.empty()) return false;
  for (const auto& [id, connection] : connections_) {
    const std::string& topic = connection.topic;
    const bool describes =
        connection.type == "sensor_msgs/CameraInfo" || !OrbbecProfileNumber(topic).empty() ||
        topic == kOrbbecDevice || topic == kStaticTransforms ||
        (connection.type == "geometry_msgs/Transform" && IsStreamTransform(topic));
    if (describes && content_.contents.count(topic) == 0) return false;
    const bool is_depth =
        connection.type == "sensor_msgs/Image" && !IsNamedOtherwise(topic) &&
        (Lower(topic).find("depth") != std::string::npos || OrbbecStream(topic) == kOrbbecDepth);
    if (is_depth && content_.streams.count(topic) == 0) return false;
  }
  return HasAllFrames(content_, reading_.max_frames);
}

class BagReader : public ByteReader {
 public:
  BagReader(std::string_view bytes, const std::string& name)
      : ByteReader(bytes, name), name_(name) {}
  std::string_view Bytes() { return Block(); }
  std::string Text() { return BoundedText(Block(), name_); }
  /// std_msgs/Header.
  std::string Header() {
    Take(3 * sizeof(std::uint32_t));  // seq, stamp
    return Text();                    // frame_id
  }

 private:
  const std::string& name_;
};

OrbbecProfile ReadOrbbecProfile(std::string_view message, const std::string& name) {
  enum Model : std::uint8_t { kNone = 0, kBrownConrady = 3, kRational = 4 };
  BagReader reader(message, name);
  reader.Header();
  reader.Take(2);  // type of the stream, format
  const auto take = [&](auto* values) {
    for (float& value : *values) value = reader.Value<float>();
  };
  std::array<float, 9> r;  // row by row
  std::array<float, 3> t;  // mm
  take(&r);
  take(&t);
  OrbbecProfile profile;
  profile.intrinsics.width = reader.Value<std::uint16_t>();
  profile.intrinsics.height = reader.Value<std::uint16_t>();
  reader.Value<std::uint16_t>();  // frames per second
  std::array<float, 4> f;         // fx fy cx cy
  std::array<float, 8> d;         // k1 ... k6 p1 p2
  take(&f);
  take(&d);
  const auto model = reader.Value<std::uint8_t>();
  profile.intrinsics.fx = f[0];
  profile.intrinsics.fy = f[1];
  profile.intrinsics.cx = f[2];
  profile.intrinsics.cy = f[3];
  const bool is_zero = std::all_of(d.begin(), d.end(), [](float x) { return x == 0; });
  if (model == kNone || is_zero) {
    profile.intrinsics.distortion.assign(5, 0.0);
  } else if (model == kBrownConrady || model == kRational) {
    profile.intrinsics.distortion = {d[0], d[1], d[6], d[7], d[2], d[3], d[4], d[5]};
  } else {
    profile.lens = fmt::format(
        "the lens model {} of the Orbbec SDK (modified or inverse Brown-Conrady, Kannala-Brandt) "
        "is not OpenCV's; record with the SDK's rectification, or give \"intrinsics\"",
        model);
  }
  // The recorder leaves zeros if the streams had no extrinsics.
  if (std::any_of(r.begin(), r.end(), [](float x) { return x != 0; })) {
    try {
      profile.colour_from_stream = PoseFromRotation(
          Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(r.data()).cast<double>(),
          1e-3 * Eigen::Map<const Eigen::Vector3f>(t.data()).cast<double>(),
          name + ": a stream profile");
    } catch (const DataError&) {
      // Depth does not need it.
    }
  }
  return profile;
}

/// custom_msg/property: a header, the property's number (include/libobsensor/h/Property.h of
/// OrbbecSDK v2) and its bytes.
void ReadOrbbecProperty(std::string_view message, const std::string& name,
                        OrbbecProperties* properties) {
  enum Number : std::uint32_t {
    kDepthPrecisionLevel = 75,  // int, a place in kUnits
    kDisparityToDepth = 85,     // bool: the device itself makes depth of its disparities
    kFlexibleDepthUnit = 176,   // float, mm: Gemini 330
  };
  // mm, in the order of OBDepthPrecisionLevel.
  constexpr std::array<double, 7> kUnits = {1, 0.8, 0.4, 0.1, 0.2, 0.5, 0.05};
  BagReader reader(message, name);
  reader.Header();
  const auto number = reader.Value<std::uint32_t>();
  BagReader data(reader.Bytes(), name);
  if (number == kDisparityToDepth) {
    properties->frames_are_disparity = data.Value<std::uint8_t>() == 0;
  } else if (number == kFlexibleDepthUnit) {
    properties->unit = 1e-3 * data.Value<float>();
  } else if (number == kDepthPrecisionLevel) {
    const auto level = data.Value<std::uint32_t>();
    if (level < kUnits.size()) properties->unit = 1e-3 * kUnits[level];
  }
}

}  // namespace

void CollectRos1(const std::string& topic, const std::string& type, std::string_view message,
                 const RosReading& reading, RosContent* content) {
  const std::string& name = reading.name;
  content->contents.emplace(topic, type);
  if (CollectCommon<BagReader>(topic, type, message, reading, content)) return;
  if (const std::string number = OrbbecProfileNumber(topic); !number.empty()) {
    content->profiles.emplace(number, ReadOrbbecProfile(message, name));
  } else if (topic == kOrbbecDevice) {
    BagReader reader(message, name);
    reader.Header();
    AddDevicePair("name", reader.Text(), &content->devices[topic]);
  } else if (topic == kOrbbecProperty) {
    ReadOrbbecProperty(message, name, &content->properties);
  } else if (type == "std_msgs/Float32" && IsDepthUnits(topic)) {
    content->units[topic] = BagReader(message, name).Value<float>();
  } else if (type == "geometry_msgs/Transform" && IsStreamTransform(topic)) {
    BagReader reader(message, name);
    AddStreamTransform(topic, ReadTransform(&reader), &content->transforms);
  } else if (type == "diagnostic_msgs/KeyValue" && IsDeviceInfo(topic)) {
    BagReader reader(message, name);
    const std::string key = reader.Text();
    AddDevicePair(key, reader.Text(), &content->devices[topic]);
  }
}

Recording ReadBagRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget) {
  const RosReading reading{name, max_frames, budget};
  return DescribeStreams(RosBag(path, reading).Read(), name);
}

}  // namespace volalign::formats_internal
