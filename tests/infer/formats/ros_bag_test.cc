// A bag written by hand, after wiki.ros.org/Bags/Format/2.0.

#include "infer/formats/ros_bag.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/formats/bag_writer.h"

namespace volalign::formats_internal::ros_bag_test {
namespace {

using namespace bag_writer;

/// "topic type message" of each.
std::vector<std::string> MessagesOf(RosBag& bag, std::size_t most = 100) {
  std::vector<std::string> messages;
  bag.ForEachMessage([&](const BagConnection& connection, std::string_view message) {
    messages.push_back(connection.topic + " " + connection.type + " " + std::string(message));
    return messages.size() < most;
  });
  return messages;
}

TEST(RosBag, GivesTheMessagesOfItsChunksInOrder) {
  const TempFolder folder;
  const std::string depth = Connection(0, "/depth", "sensor_msgs/Image");
  const std::string info = Connection(3, "/info", "sensor_msgs/CameraInfo");
  const std::string chunks =
      Chunk(depth + Message(0, "one")) + Chunk(info + Message(3, "two") + Message(0, "three"));
  const std::vector<std::string> all = {"/depth sensor_msgs/Image one",
                                        "/info sensor_msgs/CameraInfo two",
                                        "/depth sensor_msgs/Image three"};
  ReadBudget budget;
  RosBag indexed(folder.Write("a.bag", Bag(chunks, depth + info)), "a.bag", &budget);
  ASSERT_EQ(indexed.connections().size(), 2u);
  EXPECT_EQ(indexed.connections().at(3).topic, "/info");
  EXPECT_EQ(MessagesOf(indexed), all);
  EXPECT_EQ(MessagesOf(indexed), all);  // again from the start
  EXPECT_EQ(MessagesOf(indexed, 2), std::vector<std::string>(all.begin(), all.begin() + 2));
  // Cut off before the index and in the middle of a chunk: what is whole serves.
  const std::string bytes = Bag(chunks);
  RosBag cut(folder.Write("b.bag", bytes.substr(0, bytes.size() - 3)), "b.bag", &budget);
  EXPECT_TRUE(cut.connections().empty());
  EXPECT_EQ(MessagesOf(cut), std::vector<std::string>{all[0]});
}

TEST(RosBag, LimitsConnections) {
  const TempFolder folder;
  std::string records;
  for (std::uint32_t i = 0; i < 1001; ++i) records += Connection(i, "/a", "b/C");
  ReadBudget budget;
  RosBag bag(folder.Write("a.bag", Bag(records)), "a.bag", &budget);
  ExpectError<DataError>([&] { MessagesOf(bag); }, {"a.bag", "1000 topics"});
}

TEST(RosBag, SaysWhatIsDamaged) {
  const TempFolder folder;
  ReadBudget budget;
  const auto expect = [&](const std::string& records, const std::string& part) {
    RosBag bag(folder.Write("c.bag", Bag(records)), "c.bag", &budget);
    ExpectError<DataError>([&] { MessagesOf(bag); }, {"c.bag", part});
  };
  expect(Chunk(Message(5, "one")), "unknown connection");
  expect(Chunk("x", "zip"), "\"zip\"");
  expect(Chunk("no stream of bz2", "bz2"), "bz2");
  expect(Chunk("no frame of lz4", "lz4"), "lz4");
  expect(Chunk(Bytes<std::uint32_t>(1000)), "1000 bytes are announced");
  const auto open = [&](const std::string& bytes) {
    RosBag(folder.Write("d.bag", bytes), "d.bag", &budget);
  };
  EXPECT_THROW(open("#ROSBAG V1.2\n"), DataError);
  EXPECT_THROW(open("#ROSBAG V2.0\n" + Chunk("")), DataError);
  EXPECT_THROW(RosBag(folder / "none.bag", "none.bag", &budget), IoError);
}

}  // namespace
}  // namespace volalign::formats_internal::ros_bag_test
