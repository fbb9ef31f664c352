// Depth streams of a bag of ROS 2 in SQLite (.db3): what RealSense's recorder writes today,
// and depth images of `ros2 bag record`. Messages are CDR, little-endian.

#include <fmt/format.h>
#include <sqlite3.h>

#include <cstdlib>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/formats/image_io.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/ros_depth.h"

namespace volalign::formats_internal {

namespace {

constexpr char kLittleEndian[] = "\x00\x01\x00\x00";  // the encapsulation's header
constexpr std::size_t kHeader = 4;
constexpr int kMaxLength = 1 << 28;  // bytes of a message
constexpr std::size_t kMaxTopics = 1000;
constexpr int kStepsAtATime = 1000;
/// Of compressed_depth_image_transport, before the PNG: a number and two floats.
constexpr std::size_t kDepthHeader = 12;

/// A message's values, each aligned to its size.
class CdrReader {
 public:
  CdrReader(std::string_view message, const std::string& name)
      : reader_(message, name), size_(message.size()) {
    if (reader_.Take(kHeader) != std::string_view(kLittleEndian, kHeader))
      throw DataError(name + ": a message that is not little-endian CDR");
  }
  template <class T>
  T Value() {
    const std::size_t over = (size_ - kHeader - reader_.left()) % sizeof(T);
    if (over != 0) reader_.Take(sizeof(T) - over);
    return reader_.Value<T>();
  }
  std::string_view Bytes() { return reader_.Take(Value<std::uint32_t>()); }
  std::string Text() {
    std::string text(Bytes());
    while (!text.empty() && text.back() == '\0') text.pop_back();
    return text;
  }
  /// std_msgs/Header.
  std::string Header() {
    Value<std::int32_t>();
    Value<std::uint32_t>();
    return Text();
  }

 private:
  ByteReader reader_;
  std::size_t size_;
};

/// sensor_msgs/CompressedImage with "16UC1; compressedDepth png".
StoredDepth ParseCompressed(std::string_view message, const std::string& name) {
  CdrReader reader(message, name);
  reader.Header();
  const std::string format = reader.Text();
  if (format.rfind("16UC1", 0) != 0 || format.find("rvl") != std::string::npos)
    throw DataError(fmt::format("{}: depth compressed as \"{}\"; only PNG of 16UC1 is read", name,
                                Shortened(format)));
  ByteReader data(reader.Bytes(), name);
  data.Take(kDepthHeader);
  const Image16 png = DecodeDepth(std::string(data.Take(data.left())), name);
  RequireSize(png.width(), png.height(), name);
  StoredDepth depth{Image<float>(png.width(), png.height()), /*whole_numbers=*/true};
  std::copy(png.begin(), png.end(), depth.values.begin());
  return depth;
}

/// "Name=Intel RealSense D415;Serial Number=9185".
std::map<std::string, std::string> ParsePairs(const std::string& text) {
  std::map<std::string, std::string> pairs;
  for (const std::string& pair : Split(text, ';')) {
    const std::size_t equals = pair.find('=');
    if (equals != std::string::npos) pairs.emplace(pair.substr(0, equals), pair.substr(equals + 1));
  }
  return pairs;
}

/// "rotation=1,0,...;translation=0.015,0,0", the rotation column by column, metres.
Pose ParseStreamTransform(const std::string& text, const std::string& name) {
  const auto pairs = ParsePairs(text);
  const auto numbers = [&](const char* key, std::size_t count) {
    std::vector<double> values;
    const auto found = pairs.find(key);
    for (const std::string& word : Split(found == pairs.end() ? "" : found->second, ',')) {
      char* end = nullptr;
      values.push_back(std::strtod(word.c_str(), &end));
      if (word.empty() || *end != '\0') values.clear();
    }
    if (values.size() != count)
      throw DataError(fmt::format("{}: {} of a stream is no list of {} numbers", name, key, count));
    return values;
  };
  const std::vector<double> r = numbers("rotation", 9), t = numbers("translation", 3);
  return PoseFromRotation(Eigen::Map<const Eigen::Matrix3d>(r.data()),
                          Eigen::Map<const Eigen::Vector3d>(t.data()), name + ": a stream");
}

struct Topic {
  std::string name, type;
};

/// The topic of images that a compressed one belongs to.
std::string Uncompressed(const std::string& topic) {
  const std::string end = "/compressedDepth";
  const std::size_t at = topic.rfind(end);
  return at != std::string::npos && at + end.size() == topic.size() ? topic.substr(0, at) : "";
}

}  // namespace

void CollectRos2(const std::string& topic, const std::string& type, std::string_view message,
                 int max_frames, const std::string& name, RosContent* content) {
  content->contents.insert(fmt::format("{} ({})", topic, type));
  const auto add = [&](const std::string& stream, auto decode) {
    RecordedDepth& depth = content->streams[stream];
    depth.stream = stream;
    if (static_cast<int>(depth.frames.size()) < max_frames) depth.frames.push_back(decode());
  };
  if (type == "sensor_msgs/msg/Image") {
    const RosImage image = ReadImage(CdrReader(message, name));
    if (!IsDepth(topic, image.encoding)) return;
    add(topic, [&] { return DecodeImage(image, name); });
    if (image.encoding == "32FC1") content->streams[topic].depth_scale = 1;
  } else if (type == "sensor_msgs/msg/CompressedImage" && !Uncompressed(topic).empty()) {
    add(Uncompressed(topic), [&] { return ParseCompressed(message, name); });
  } else if (type == "sensor_msgs/msg/CameraInfo") {
    content->infos.emplace(topic, ReadCameraInfo(CdrReader(message, name), name));
  } else if (type == "std_msgs/msg/String" && IsDepthUnits(topic)) {
    const std::string text = CdrReader(message, name).Text();
    content->units[topic] = std::strtod(text.c_str(), nullptr);
  } else if (type == "tf2_msgs/msg/TFMessage" && IsStaticTransform(topic)) {
    for (RosTransform& transform : ReadTransforms(CdrReader(message, name), name))
      content->transforms.push_back(std::move(transform));
  } else if (type == "std_msgs/msg/String" && IsStreamTransform(topic)) {
    content->transforms.push_back(
        StreamTransform(topic, ParseStreamTransform(CdrReader(message, name).Text(), name)));
  } else if (type == "std_msgs/msg/String" && IsDeviceInfo(topic)) {
    content->devices.emplace(topic, ParsePairs(CdrReader(message, name).Text()));
  }
}

namespace {

/// A statement, with the values of its `?`, whose rows `use` takes. Throws DataError, with SQLite's
/// words.
template <class Use>
void ForEachRow(sqlite3* database, const char* sql, const std::vector<sqlite3_int64>& values,
                const std::string& name, Use use) {
  sqlite3_stmt* raw = nullptr;
  int status = sqlite3_prepare_v2(database, sql, -1, &raw, nullptr);
  const std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> statement(raw, sqlite3_finalize);
  for (std::size_t i = 0; i < values.size() && status == SQLITE_OK; ++i)
    status = sqlite3_bind_int64(raw, static_cast<int>(i) + 1, values[i]);
  while (status == SQLITE_OK || status == SQLITE_ROW) {
    status = sqlite3_step(raw);
    if (status == SQLITE_ROW) use(raw);
  }
  if (status != SQLITE_DONE)
    throw DataError(fmt::format("{}: not a readable bag of ROS 2: {}", name,
                                Shortened(sqlite3_errmsg(database))));
}

std::string Column(sqlite3_stmt* row, int column) {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(row, column));
  const int size = sqlite3_column_bytes(row, column);
  return bytes ? std::string(bytes, static_cast<std::size_t>(size)) : std::string();
}

/// Limits what a database may cost, and what of it may run: a view, or what a column is made of.
/// The limits hold as long as `steps`.
void Restrain(sqlite3* database, std::int64_t* steps, const std::string& name) {
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, kMaxLength);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_progress_handler(
      database, kStepsAtATime,
      [](void* left) { return (*static_cast<std::int64_t*>(left) -= kStepsAtATime) < 0 ? 1 : 0; },
      steps);
  std::set<std::string> tables;
  ForEachRow(database, "SELECT name, sql FROM sqlite_master WHERE type = 'table'", {}, name,
             [&](sqlite3_stmt* row) {
               if (Column(row, 1).rfind("CREATE TABLE", 0) == 0) tables.insert(Column(row, 0));
             });
  for (const char* table : {"topics", "messages"}) {
    if (tables.count(table) == 0) {
      throw DataError(
          fmt::format("{}: not a bag of ROS 2: it has no table {} (a view is none)", name, table));
    }
  }
}

}  // namespace

Recording ReadRos2Recording(const std::filesystem::path& path, int max_frames,
                            std::int64_t most_steps) {
  const std::string name = path.string();
  sqlite3* raw = nullptr;
  const int opened = sqlite3_open_v2(path.c_str(), &raw, SQLITE_OPEN_READONLY, nullptr);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> database(raw, sqlite3_close);
  if (opened != SQLITE_OK) throw IoError(name + ": cannot be opened as a bag of ROS 2");
  Restrain(raw, &most_steps, name);
  std::vector<std::pair<sqlite3_int64, Topic>> topics;
  ForEachRow(raw, "SELECT id, name, type, serialization_format FROM topics", {}, name,
             [&](sqlite3_stmt* row) {
               if (sqlite3_column_type(row, 0) != SQLITE_INTEGER)
                 throw DataError(name + ": a topic whose id is no whole number");
               if (Column(row, 3) == "cdr")
                 topics.push_back({sqlite3_column_int64(row, 0), {Column(row, 1), Column(row, 2)}});
               if (topics.size() > kMaxTopics) {
                 throw DataError(fmt::format("{}: more than the {} topics that are read of a bag",
                                             name, kMaxTopics));
               }
             });
  RosContent content;
  for (const auto& [id, topic] : topics) {
    // Streams of every frame of a long recording are not gone through.
    ForEachRow(raw, "SELECT data FROM messages WHERE topic_id = ? ORDER BY timestamp, id LIMIT ?",
               {id, max_frames}, name, [&, &topic = topic](sqlite3_stmt* row) {
                 CollectRos2(topic.name, topic.type, Column(row, 0), max_frames, name, &content);
               });
  }
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
