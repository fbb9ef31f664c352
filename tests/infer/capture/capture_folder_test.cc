#include "infer/capture/capture_folder.h"

#include <gtest/gtest.h>

#include "infer/capture/capture.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::capture_folder_test {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> Names(const std::vector<fs::path>& paths) {
  std::vector<std::string> names;
  for (const fs::path& path : paths) names.push_back(path.filename().string());
  return names;
}

using Words = std::vector<std::string>;

TEST(LookInto, TellsFilesApartByNameAndContent) {
  const TempFolder folder;
  for (const char* image : {"frame_10.png", "frame_9.PNG", "frame_9b.tiff", "cam_ir_1.png",
                            "a-colour.png", "firing.png", "labels.png"})
    folder.Write(image, "");
  const std::string intrinsics =
      R"("width": 640, "height": 480, "fx": 1, "fy": 1, "cx": 1, "cy": 1)";
  folder.Write("one.bag", "#ROSBAG V2.0\n");
  folder.Write("k.json", "{" + intrinsics + "}");
  folder.Write("capture.json",
               "{\"format\": \"" + std::string(kCaptureFormat) + "\", " + intrinsics + "}");
  folder.Write("rig.json", "{\"sensors\": [{" + intrinsics + "}]}");
  folder.Write("k.dat", "{" + intrinsics + "}");
  folder.Write("notes.txt", "nothing");
  folder.Write("damaged.mcap", "nothing");
  fs::create_directory(folder / "sub.png");
  const FolderContent found = LookInto(folder.path());
  EXPECT_EQ(Names(found.images),
            (Words{"firing.png", "frame_9.PNG", "frame_9b.tiff", "frame_10.png"}));
  EXPECT_EQ(found.left_out, (Words{"a-colour.png", "cam_ir_1.png", "labels.png"}));
  EXPECT_EQ(Names(found.recordings), Words{"one.bag"});
  EXPECT_EQ(Names(found.intrinsics), Words{"k.json"});
  ASSERT_EQ(found.not_read.size(), 1u);
  EXPECT_EQ(found.not_read[0].rfind("damaged.mcap: ", 0), 0u);
  ASSERT_EQ(found.not_understood.size(), 1u);
  EXPECT_EQ(found.not_understood[0].rfind("notes.txt: ", 0), 0u);
}

TEST(IsNamedAsFrame, TellsFramesFromSensors) {
  for (const char* frame : {"000001", "000001_depth", "frame_7", "img3", "1623335560123",
                            "1305031102.160407", "frame-000000.depth"})
    EXPECT_TRUE(IsNamedAsFrame(frame)) << frame;
  for (const char* sensor : {"1", "01", "KA03", "cam_2", "918512071234", "918512071234_depth", "a"})
    EXPECT_FALSE(IsNamedAsFrame(sensor)) << sensor;
}

TEST(ComesBefore, CountsNumbersAsNumbers) {
  const Words order = {"a", "a1", "a02", "a2b", "a10", "a10b1", "a10b11", "b"};
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t j = 0; j < order.size(); ++j)
      EXPECT_EQ(ComesBefore(order[i], order[j]), i < j) << order[i] << " " << order[j];
  }
  EXPECT_TRUE(ComesBefore("z/a1", "b/a2"));  // the names alone
}

TEST(NameBesideDepth, IsTheSensorsOfTheFile) {
  EXPECT_EQ(NameBesideDepth("KA03_Depth_0007"), "KA03");
  EXPECT_EQ(NameBesideDepth("Left-depth"), "Left");
  EXPECT_EQ(NameBesideDepth("depth_Cam2"), "Cam2");
  EXPECT_EQ(NameBesideDepth("Depth12"), "");
  EXPECT_EQ(NameBesideDepth("cam2_z16"), "cam2");
  EXPECT_EQ(NameBesideDepth("a.depthmap - 12"), "a");
  EXPECT_EQ(NameBesideDepth("depth depth_x"), "depth_x");
  EXPECT_EQ(NameBesideDepth("depth_depth_1"), "depth");
  EXPECT_FALSE(NameBesideDepth("depthx"));
  EXPECT_FALSE(NameBesideDepth("frame_0007"));
  EXPECT_EQ(WithoutNumber("frame_0007"), "frame_");
  EXPECT_EQ(WithoutNumber("a1b"), "a1b");
  EXPECT_EQ(WithoutNumber("007"), "");
}

}  // namespace
}  // namespace volalign::capture_folder_test
