#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "infer/formats/read_budget.h"

namespace volalign::formats_internal {

struct BagConnection {
  std::string topic;
  std::string type;  ///< "sensor_msgs/Image"
};

/// A bag of ROS 1, format 2.0 (wiki.ros.org/Bags/Format/2.0). All functions throw DataError if the
/// file is damaged. They trust no length that it states.
class RosBag {
 public:
  /// `name` begins every message. Throws IoError or DataError.
  RosBag(const std::filesystem::path& path, std::string name, ReadBudget* budget);

  /// The connections in the index at the file's end, and those of the messages visited so far.
  const std::map<std::uint32_t, BagConnection>& connections() const { return connections_; }

  /// False if a recording was cut off before its index: further connections may still come.
  bool has_index() const { return has_index_; }

  using Visit = std::function<bool(const BagConnection&, std::string_view message)>;
  /// Calls `visit` with each message, in the file's order, until it returns false.
  void ForEachMessage(const Visit& visit);

  /// The fields of a record's header.
  using Fields = std::map<std::string, std::string>;

 private:
  struct Record;
  bool ReadRecord(Record* record);
  void AddConnection(const Fields& header, std::string_view data);
  /// False if `visit` wanted no more.
  bool VisitChunk(const Record& chunk, const Visit& visit);

  std::string name_;
  ReadBudget* budget_;
  std::ifstream stream_;
  std::uint64_t size_ = 0, at_ = 0, first_record_ = 0;
  bool has_index_ = false;
  std::map<std::uint32_t, BagConnection> connections_;
};

}  // namespace volalign::formats_internal
