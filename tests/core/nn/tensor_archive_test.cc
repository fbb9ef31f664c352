#include "core/nn/tensor_archive.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/nn/zip.h"

namespace volalign::tensor_archive_test {
namespace {

std::string Text(const std::string& text) { return "X" + LittleEndian(text.size(), 4) + text; }

std::string Numbers(const std::vector<int>& numbers) {
  std::string tuple = "(";
  for (const int number : numbers)
    tuple += "J" + LittleEndian(static_cast<std::uint64_t>(number), 4);
  return tuple + "t";
}

/// As Python's pickle has it.
std::string Tensor(const std::string& key, int count, const std::vector<int>& sizes,
                   const std::vector<int>& strides, int offset = 0,
                   const std::string& type = "FloatStorage") {
  return "ctorch._utils\n_rebuild_tensor_v2\n((" + Text("storage") + "ctorch\n" + type + "\n" +
         Text(key) + Text("cpu") + "J" + LittleEndian(static_cast<std::uint64_t>(count), 4) +
         "tQJ" + LittleEndian(static_cast<std::uint64_t>(offset), 4) + Numbers(sizes) +
         Numbers(strides) + "\x89" + "ccollections\nOrderedDict\n)RtR";
}

/// {"meta": "m", "tensors": {"a": ..., "b": ...}}.
std::string Pickle(const std::vector<std::string>& tensors) {
  std::string pickle = "\x80\x02}(" + Text("meta") + Text("m") + Text("tensors") + "}(";
  for (std::size_t i = 0; i < tensors.size(); ++i)
    pickle += Text(std::string(1, static_cast<char>('a' + i))) + tensors[i];
  return pickle + "uu.";
}

std::string Archive(const std::string& pickle) {
  return Zip({{"archive/data.pkl", pickle},
              {"archive/data/0", std::string(24, '\0')},
              {"archive/data/1", std::string(16, '\0')}});
}

void ExpectBad(const std::string& pickle, const std::string& part) {
  ExpectError<DataError>([&] { ReadTensorArchive(Archive(pickle)); }, {part});
}

TEST(ReadTensorArchive, ReadsTextsAndTensors) {
  const TensorArchive archive = ReadTensorArchive(Archive(
      Pickle({Tensor("0", 6, {2, 3}, {3, 1}), Tensor("1", 2, {2, 1}, {1, 7}, 0, "LongStorage")})));
  EXPECT_EQ(archive.texts.at("meta"), "m");
  EXPECT_EQ(archive.tensors.at("tensors").at("a").sizes(), (std::vector<std::int64_t>{2, 3}));
  EXPECT_EQ(archive.tensors.at("tensors").at("b").scalar_type(), at::kLong);
}

TEST(ReadTensorArchive, RefusesInstructionsThatNoTensorNeeds) {
  ExpectBad(
      "\x80\x02"
      "cos\nsystem\n(" +
          Text("true") + "tR.",
      "os system");
  ExpectBad(
      "\x80\x02"
      "c__torch__\nModule\n)\x81.",
      "__torch__ Module");
  // BUILD, APPENDS, NEWOBJ, INST, STACK_GLOBAL, LIST, FLOAT.
  for (const char op : {'b', 'e', '\x81', 'i', '\x93', 'l', 'G'})
    ExpectBad(std::string("\x80\x02))") + op + ".", "instruction");
  ExpectBad("\x80\x04}.", "protocol");
}

// What an unpickler that checks nothing takes from before its stack.
TEST(ReadTensorArchive, RefusesValuesThatAreNotThere) {
  for (const char* pickle : {"R.",
                             ")R.",
                             "\x85.",
                             "\x87.",
                             "Q.",
                             "t.",
                             "u.",
                             "s.",
                             "q",
                             ".",
                             "h\x01.",
                             "j\xff\xff\xff\xff.",
                             "(R.",
                             "(Q.",
                             "}(u",
                             "}()u.",
                             "K\x01)R.",
                             "}"
                             "K\x01K\x01s.",
                             "r\x00\x00\x00\x80",
                             "X\xff\xff\xff\xff",
                             "("})
    ExpectError<DataError>([&] { ReadTensorArchive(Archive(std::string("\x80\x02") + pickle)); });
}

TEST(ReadTensorArchive, LimitsDepthAndSize) {
  ExpectBad("\x80\x02)" + std::string(3000000, '\x85') + ".", "nested too deep");
  ExpectBad("\x80\x02" + std::string(3000000, ')') + ".", "too many values");
  ExpectBad(std::string((4 << 20) + 1, ')'), "4 MiB");
  ExpectBad("\x80\x02}q\x01" + Text("a") + "h\x01s.", "within itself");
  ExpectBad("\x80\x02}" + Text("a") + "}" + Text("a") + "}" + Text("a") + "}sss.", "too deep");
}

TEST(ReadTensorArchive, RefusesTensorsThatAreNotTheirRecord) {
  for (const std::string& tensor :
       {Tensor("0", 5, {5}, {1}), Tensor("0", 7, {7}, {1}), Tensor("0", 6, {7}, {1}),
        Tensor("0", 6, {6}, {2}), Tensor("0", 6, {3}, {1}, 3), Tensor("0", 6, {2, 3}, {1, 2}),
        Tensor("0", 6, {-2, -3}, {3, 1}), Tensor("0", -6, {6}, {1}), Tensor("0", 6, {6}, {1, 1}),
        Tensor("0", 6, {1 << 30, 1 << 30, 1 << 30, 6}, {6, 6, 6, 1})})
    ExpectBad(Pickle({tensor}), "record 0 is damaged");
  // No values, and a number of them that overflows on the way.
  ExpectError<DataError>(
      [&] {
        ReadTensorArchive(
            Zip({{"archive/data/2", ""},
                 {"archive/data.pkl",
                  Pickle({Tensor("2", 0, {1 << 30, 1 << 30, 1 << 30, 0}, {0, 0, 0, 1})})}}));
      },
      {"record 2 is damaged"});
  ExpectBad(Pickle({Tensor("../0", 6, {6}, {1})}), "no record ../0");
  ExpectBad(Pickle({Tensor("0", 6, {6}, {1}, 0, "QInt8Storage")}), "torch QInt8Storage");
  ExpectBad(Pickle({Tensor("0", 6, {6}, {1}), Tensor("0", 6, {6}, {1})}), "shares memory");
}

TEST(ReadTensorArchive, RefusesOtherArchives) {
  const std::string pickle = Pickle({});
  const auto expect_bad = [](const std::string& bytes, const std::string& part) {
    ExpectError<DataError>([&] { ReadTensorArchive(bytes); }, {part});
  };
  EXPECT_NO_THROW(ReadTensorArchive(Zip({{"a/data.pkl", pickle}})));
  expect_bad("", "no zip");
  expect_bad(Zip({{"a/data.pkl", pickle}}, /*method=*/8), "compressed");
  expect_bad(Zip({{"a/b", pickle}}), "no data.pkl");
  expect_bad(Zip({{"a/data.pkl", pickle}, {"a/data.pkl", pickle}}), "two files");
  const std::string whole = Zip({{"a/data.pkl", pickle}, {"a/data/0", "1234"}});
  for (std::size_t size = 0; size < whole.size(); ++size)
    ExpectError<DataError>([&] { ReadTensorArchive(whole.substr(0, size)); });
  // Many names of one record: more tensors than the file has bytes.
  std::vector<std::pair<std::string, std::string>> files = {{"a/data/0", std::string(4000, 'a')}};
  std::vector<std::string> tensors;
  for (int i = 0; i < 20; ++i) {
    if (i > 0) files.emplace_back("a/data/" + std::to_string(i), "");
    tensors.push_back(Tensor(std::to_string(i), 1000, {1000}, {1}));
  }
  files.emplace_back("a/data.pkl", Pickle(tensors));
  expect_bad(Zip(files), "shares memory");
}

}  // namespace
}  // namespace volalign::tensor_archive_test
