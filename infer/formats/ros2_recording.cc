// Depth streams of a bag of ROS 2 in SQLite (.db3), of today's recorder of RealSense, and depth
// images of `ros2 bag record`. Messages are CDR, little-endian.

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/formats/image_io.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/ros_depth.h"
#include "infer/formats/unpack.h"

namespace volalign::formats_internal {

namespace {

constexpr char kLittleEndian[] = "\x00\x01\x00\x00";  // the encapsulation's header
constexpr std::size_t kHeader = 4;
constexpr int kMaxLength = 1 << 28;  // bytes of a message
constexpr std::size_t kMaxTopics = 1000;
constexpr int kStepsAtATime = 1000;
/// Bytes of compressed_depth_image_transport before the PNG: a number and two floats.
constexpr std::size_t kDepthHeader = 12;

/// A message's values, each aligned to its size.
class CdrReader {
 public:
  CdrReader(std::string_view message, const std::string& name)
      : reader_(message, name), name_(name), size_(message.size()) {
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
    std::string text = BoundedText(Bytes(), name_);
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
  const std::string& name_;
  std::size_t size_;
};

/// The PNG of a sensor_msgs/CompressedImage with "16UC1; compressedDepth png".
StoredDepth DecodeCompressed(std::string_view data, const std::string& name) {
  ByteReader reader(data, name);
  reader.Take(kDepthHeader);
  const Image16 png = DecodeDepth(std::string(reader.Take(reader.left())), name);
  RequireSize(png.width(), png.height(), name);
  return FromImage16(png);
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

/// The numbers of "0.015,0,0"; none if any is no number.
std::vector<double> ParseNumbers(const std::map<std::string, std::string>& pairs, const char* key) {
  std::vector<double> values;
  const auto found = pairs.find(key);
  for (const std::string& word : Split(found == pairs.end() ? "" : found->second, ',')) {
    const std::optional<double> value = NumberOf(word);
    if (!value) return {};
    values.push_back(*value);
  }
  return values;
}

/// "rotation=1,0,...;translation=0.015,0,0", the rotation column by column, metres. None if it is
/// no rigid motion, because depth does not need it.
std::optional<Pose> ParseStreamTransform(const std::string& text) {
  const auto pairs = ParsePairs(text);
  const std::vector<double> r = ParseNumbers(pairs, "rotation"),
                            t = ParseNumbers(pairs, "translation");
  if (r.size() != 9 || t.size() != 3) return std::nullopt;
  try {
    return PoseFromRotation(Eigen::Map<const Eigen::Matrix3d>(r.data()),
                            Eigen::Map<const Eigen::Vector3d>(t.data()), "");
  } catch (const DataError&) {
    return std::nullopt;
  }
}

/// "width=320;height=180;fx=235.07;ppx=166.44;fy=235.15;ppy=88.96;model=Brown
/// Conrady;coeffs=0,0,0,0,0" of librealsense 2.58. Missing values are 0, as for a camera that is
/// not calibrated.
CameraInfo ParseCameraText(const std::string& text) {
  const auto pairs = ParsePairs(text);
  const auto number = [&](const char* key) {
    const std::vector<double> numbers = ParseNumbers(pairs, key);
    return numbers.size() == 1 ? numbers[0] : 0;
  };
  const auto pixels = [&](const char* key) {
    return static_cast<int>(std::clamp<double>(number(key), 0, kMaxSide + 1));
  };
  CameraInfo info;
  info.raw = {pixels("width"),
              pixels("height"),
              number("fx"),
              number("fy"),
              number("ppx"),
              number("ppy"),
              ParseNumbers(pairs, "coeffs")};
  if (const auto model = pairs.find("model"); model != pairs.end()) info.model = model->second;
  return info;
}

struct Topic {
  std::string name, type;
};

/// The topic of the images of a compressed topic; "" for others.
std::string Uncompressed(const std::string& topic) {
  const std::string end = "/compressedDepth";
  const std::size_t at = topic.rfind(end);
  return at != std::string::npos && at + end.size() == topic.size() ? topic.substr(0, at) : "";
}

}  // namespace

void CollectRos2(const std::string& topic, const std::string& type, std::string_view message,
                 const RosReading& reading, RosContent* content) {
  const std::string& name = reading.name;
  // This is never CDR, whose first byte is 0.
  std::string unpacked;
  if (IsZstd(message)) {
    unpacked = UnpackZstd(message, kMaxLength, name, reading.budget);
    message = unpacked;
  }
  content->contents.emplace(topic, type);
  std::string of_ros1 = type;
  if (const std::size_t at = type.find("/msg/"); at != std::string::npos) of_ros1.erase(at, 4);
  if (CollectCommon<CdrReader>(topic, of_ros1, message, reading, content)) return;
  const bool is_text = type == "std_msgs/msg/String";
  const auto text = [&] { return CdrReader(message, name).Text(); };
  if (type == "sensor_msgs/msg/CompressedImage" && !Uncompressed(topic).empty()) {
    CdrReader image(message, name);
    const std::string frame = image.Header(), format = image.Text();
    RosStream& stream = content->streams[topic];
    stream.stream = Uncompressed(topic);
    if (format.rfind("16UC1", 0) != 0 || format.find("rvl") != std::string::npos) {
      stream.problem = fmt::format(
          "depth compressed as \"{}\"; only PNG of 16UC1 is read: record the raw topic, or "
          "republish this one with image_transport (compressedDepth to raw)",
          Shortened(format));
    }
    AddFrame(
        reading, frame, [&] { return DecodeCompressed(image.Bytes(), name); }, &stream);
  } else if (is_text && IsStreamCamera(topic)) {
    content->infos.emplace(topic, ParseCameraText(text()));
  } else if (is_text && IsDepthUnits(topic)) {
    content->units[topic] = NumberOf(text()).value_or(0);
  } else if (is_text && IsStreamTransform(topic)) {
    AddStreamTransform(topic, ParseStreamTransform(text()), &content->transforms);
  } else if (is_text && IsDeviceInfo(topic)) {
    for (const auto& [key, value] : ParsePairs(text()))
      AddDevicePair(key, value, &content->devices[topic]);
  }
}

namespace {

/// Runs a statement, with the values of its `?`, and passes its rows to `use`. Throws DataError,
/// with SQLite's words.
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

/// Limits a database's cost and code: neither views nor computed columns run. The limits apply as
/// long as `budget` exists.
void Restrain(sqlite3* database, ReadBudget* budget, const std::string& name) {
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, kMaxLength);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_progress_handler(
      database, kStepsAtATime,
      [](void* left) { return static_cast<ReadBudget*>(left)->Spend(kStepsAtATime) ? 0 : 1; },
      budget);
  std::set<std::string> tables;
  ForEachRow(database, "SELECT name, sql FROM sqlite_master WHERE type = 'table'", {}, name,
             [&](sqlite3_stmt* row) {
               if (Column(row, 1).rfind("CREATE TABLE", 0) == 0) tables.insert(Column(row, 0));
             });
  for (const char* table : {"topics", "messages"}) {
    if (tables.count(table) == 0) {
      throw DataError(fmt::format(
          "{}: not a bag of ROS 2: it has no table {} (a view does not count)", name, table));
    }
    // A computed column: each row may ask for 256 MiB of which the file has nothing.
    constexpr int kHidden = 6;  // index of "hidden" in a row of PRAGMA table_xinfo
    ForEachRow(database, fmt::format("PRAGMA table_xinfo({})", table).c_str(), {}, name,
               [&](sqlite3_stmt* row) {
                 if (sqlite3_column_int(row, kHidden) == 0) return;
                 throw DataError(fmt::format(
                     "{}: not a bag of ROS 2: the column {} of its table {} is computed", name,
                     Shortened(Column(row, 1)), table));
               });
  }
}

/// Is there a file that begins with these bytes, or that is not empty if there are none?
bool HasContent(const std::filesystem::path& path, std::string_view begin) {
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(std::max<std::size_t>(begin.size(), 1), '\0');
  return static_cast<bool>(stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) &&
         (begin.empty() || bytes == begin);
}

using Database = std::unique_ptr<sqlite3, int (*)(sqlite3*)>;

/// Opens a database and leaves nothing beside it. If a recorder left it with a write-ahead log, it
/// is read with the log, and the log's index is in memory. It is opened alone (locking_mode
/// EXCLUSIVE) and without locks, which need the right to write (the VFS unix-none). The log is not
/// moved into the database at the end. Any other database is read as one that nobody changes
/// (immutable).
Database Open(const std::filesystem::path& path, const std::string& name, ReadBudget* budget) {
  const std::string file = std::filesystem::canonical(path).string();
  constexpr std::string_view kJournalMagic = "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7";
  if (HasContent(file + "-journal", kJournalMagic)) {
    throw DataError(name +
                    ": its recorder was stopped while it wrote (a journal is beside it); copy both "
                    "files and open the copy once by `sqlite3 COPY .tables`, which repairs it");
  }
  const bool has_log = HasContent(file + "-wal", "");
  if (has_log) budget->Open(file + "-wal");
  std::string uri = "file:";
  for (const char c : file) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '/';
    uri += plain ? std::string(1, c) : fmt::format("%{:02x}", static_cast<unsigned char>(c));
  }
  if (!has_log) uri += "?immutable=1";
  sqlite3* raw = nullptr;
  const int opened = sqlite3_open_v2(uri.c_str(), &raw, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI,
                                     has_log ? "unix-none" : nullptr);
  Database database(raw, sqlite3_close);
  if (opened != SQLITE_OK) throw IoError(name + ": cannot be opened as a bag of ROS 2");
  sqlite3_db_config(raw, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  ForEachRow(raw, "PRAGMA locking_mode = EXCLUSIVE", {}, name, [](sqlite3_stmt*) {});
  return database;
}

}  // namespace

Recording ReadRos2Recording(const std::filesystem::path& path, const std::string& name,
                            int max_frames, ReadBudget* budget) {
  const auto database = Open(path, name, budget);
  sqlite3* const raw = database.get();
  Restrain(raw, budget, name);
  std::vector<std::pair<sqlite3_int64, Topic>> topics;
  ForEachRow(raw, "SELECT id, name, type, serialization_format FROM topics", {}, name,
             [&](sqlite3_stmt* row) {
               if (sqlite3_column_type(row, 0) != SQLITE_INTEGER)
                 throw DataError(name + ": a topic whose id is no whole number");
               if (Column(row, 3) == "cdr") {
                 topics.push_back({sqlite3_column_int64(row, 0),
                                   {BoundedText(Column(row, 1), name, kMostTopicBytes),
                                    BoundedText(Column(row, 2), name, kMostTopicBytes)}});
               }
               if (topics.size() > kMaxTopics) {
                 throw DataError(fmt::format("{}: more than the {} topics that are read of a bag",
                                             name, kMaxTopics));
               }
             });
  RosContent content;
  const RosReading reading{name, max_frames, budget};
  for (const auto& [id, topic] : topics) {
    // A long recording is not read to its end. Only numbers are sorted, because SQLite would put
    // the messages themselves into a file.
    std::vector<sqlite3_int64> rows;
    ForEachRow(raw, "SELECT rowid FROM messages WHERE topic_id = ? ORDER BY timestamp, id LIMIT ?",
               {id, max_frames}, name,
               [&](sqlite3_stmt* row) { rows.push_back(sqlite3_column_int64(row, 0)); });
    for (const sqlite3_int64 message : rows) {
      ForEachRow(raw, "SELECT data FROM messages WHERE rowid = ?", {message}, name,
                 [&, &topic = topic](sqlite3_stmt* row) {
                   const std::string data = Column(row, 0);
                   budget->Unpack(data.size() + kRecordCost, name);
                   CollectRos2(topic.name, topic.type, data, reading, &content);
                 });
    }
  }
  return DescribeStreams(std::move(content), name);
}

}  // namespace volalign::formats_internal
