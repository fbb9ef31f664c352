#include "render/image_writers.h"

#include <gtest/gtest.h>

#include <string>

#include "core/error.h"
#include "core/image_io.h"
#include "tests/core/temp_folder.h"
#include "tests/core/thread_limit.h"

namespace volalign {
namespace {

void WriteTen(ImageWriters* writers, const TempFolder& folder) {
  for (int i = 0; i < 10; ++i) {
    const std::string name = std::to_string(i);
    writers->Submit({folder / (name + "_depth.png"), folder / (name + "_labels.png"),
                     DepthImage(8, 6, 0.001F * static_cast<float>(i)),
                     LabelImage(8, 6, static_cast<std::uint8_t>(i)), 0.001});
  }
  writers->Finish();
}

void ExpectTen(const TempFolder& folder) {
  for (int i = 0; i < 10; ++i) {
    const std::string name = std::to_string(i);
    EXPECT_EQ(ReadDepthFile(folder / (name + "_depth.png"))(7, 5), i);
    EXPECT_EQ(ReadPng8(folder / (name + "_labels.png"))(7, 5), i);
  }
}

TEST(ImageWriters, WritesWithTheThreadsThatThereAre) {
  for (const int started : {-1, 0, 2}) {
    SCOPED_TRACE(started);
    const TempFolder folder;
    if (started < 0) {
      ImageWriters writers(3);
      WriteTen(&writers, folder);
    } else {
      const ThreadLimit limit(started);
      ImageWriters writers(6);
      WriteTen(&writers, folder);
    }
    ExpectTen(folder);
  }
}

TEST(ImageWriters, AFailureReachesTheCaller) {
  const TempFolder folder;
  folder.Write("file", "");
  ImageWriters writers(2);
  EXPECT_THROW(
      {
        writers.Submit({folder / "file" / "d.png", folder / "file" / "l.png", DepthImage(2, 2),
                        LabelImage(2, 2), 0.001});
        writers.Finish();
      },
      Error);
}

}  // namespace
}  // namespace volalign
