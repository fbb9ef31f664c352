#pragma once

// Bags of ROS 1, written after wiki.ros.org/Bags/Format/2.0.

#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace volalign::bag_writer {

template <class T>
std::string Bytes(T value) {
  return std::string(reinterpret_cast<const char*>(&value), sizeof(value));
}

inline std::string Block(const std::string& bytes) {
  return Bytes(static_cast<std::uint32_t>(bytes.size())) + bytes;
}

using Fields = std::initializer_list<std::pair<std::string, std::string>>;

inline std::string Header(const Fields& fields) {
  std::string bytes;
  for (const auto& [name, value] : fields) bytes += Block(name + "=" + value);
  return bytes;
}

inline std::string Record(const Fields& fields, const std::string& data) {
  return Block(Header(fields)) + Block(data);
}

inline std::string Connection(std::uint32_t number, const std::string& topic,
                              const std::string& type) {
  return Record({{"op", "\x07"}, {"conn", Bytes(number)}, {"topic", topic}},
                Header({{"type", type}}));
}

inline std::string Message(std::uint32_t connection, const std::string& data) {
  return Record({{"op", "\x02"}, {"conn", Bytes(connection)}}, data);
}

/// A message on a connection of its own.
struct Topic {
  std::string name, type, data;
};
inline std::string Records(const std::vector<Topic>& topics) {
  std::string records;
  for (std::uint32_t i = 0; i < topics.size(); ++i)
    records += Connection(i, topics[i].name, topics[i].type) + Message(i, topics[i].data);
  return records;
}

/// What the messages of ROS 1 begin with.
inline std::string MessageHeader(const std::string& frame = "") {
  return std::string(12, '\0') + Block(frame);
}

/// `data` is `content` as `compression` packs it.
inline std::string PackedChunk(const std::string& content, const std::string& compression,
                               const std::string& data) {
  return Record({{"op", "\x05"},
                 {"compression", compression},
                 {"size", Bytes(static_cast<std::uint32_t>(content.size()))}},
                data);
}
inline std::string Chunk(const std::string& content, const std::string& compression = "none") {
  return PackedChunk(content, compression, content);
}

inline std::string Bag(const std::string& records, const std::string& index = "") {
  const std::string magic = "#ROSBAG V2.0\n";
  const auto begin = [&](std::uint64_t index_pos) {
    return magic + Record({{"op", "\x03"}, {"index_pos", Bytes(index_pos)}}, "");
  };
  const std::uint64_t at = begin(0).size() + records.size();
  return begin(index.empty() ? 0 : at) + records + index;
}

}  // namespace volalign::bag_writer
