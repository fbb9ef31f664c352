#include "core/nn/safetensors.h"

#include <ATen/ops/arange.h>
#include <ATen/ops/zeros.h>
#include <gtest/gtest.h>

#include <string>

#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/run_check.h"

namespace volalign::safetensors_test {
namespace {

/// Types of all widths, an odd number of half floats, no and one element.
Safetensors Content() {
  const auto values = [](std::initializer_list<std::int64_t> shape, at::ScalarType type) {
    std::int64_t count = 1;
    for (const std::int64_t size : shape) count *= size;
    return at::arange(count, at::kDouble).sub_(1.5).to(type).view(shape);
  };
  return {{{"format", "any"}, {"text", "\"quoted\" \xc3\xa9"}},
          {{"a_half", values({3, 5}, at::kHalf)},
           {"b_float", values({2, 3, 4}, at::kFloat)},
           {"c_long", values({2}, at::kLong)},
           {"d_byte", values({7}, at::kByte)},
           {"e_none", at::zeros({0, 4})},
           {"f_one", at::zeros({}, at::kDouble)}}};
}

TEST(Safetensors, ComeBackAsTheyWere) {
  const Safetensors content = Content();
  const std::string bytes = WriteSafetensors(content);
  const Safetensors read = ReadSafetensors(bytes);
  EXPECT_EQ(read.texts, content.texts);
  ASSERT_EQ(read.tensors.size(), content.tensors.size());
  for (const auto& [name, tensor] : content.tensors) {
    EXPECT_EQ(read.tensors.at(name).scalar_type(), tensor.scalar_type()) << name;
    EXPECT_TRUE(read.tensors.at(name).equal(tensor)) << name;
  }
  EXPECT_TRUE(WriteSafetensors(read) == bytes);
}

TEST(Safetensors, AreReadBySafetensors) {
  const TempFolder folder;
  WriteFileAtomically(folder / "a.safetensors", WriteSafetensors(Content()));
  EXPECT_EQ(
      testing_nn::RunCheck(VOLALIGN_PYTHON, "tests/core/nn/safetensors_check.py", folder.path()),
      0);
}

std::string File(const std::string& header, const std::string& values = "") {
  std::string length(8, '\0');
  length[0] = static_cast<char>(header.size());
  return length + header + values;
}

std::string Tensor(const std::string& dtype, const std::string& shape, const std::string& offsets) {
  return R"({"dtype":")" + dtype + R"(","shape":)" + shape + R"(,"data_offsets":)" + offsets + "}";
}

TEST(Safetensors, SayWhatIsWrong) {
  const auto expect = [](const std::string& bytes, const std::string& part) {
    ExpectError<DataError>([&] { ReadSafetensors(bytes); }, {part});
  };
  const std::string good = WriteSafetensors(Content());
  expect(good.substr(0, good.size() - 1), "truncated");
  expect(good + "x", "belong to no tensor");
  expect(File("[]"), "its header");
  expect(File(R"({"a":1,"a":2})"), "a");
  expect(File(R"({"a":1})"), "a");
  expect(File(R"({"__metadata__":{"a":1}})"), "__metadata__");
  const auto tensor = [](const std::string& a) { return File(R"({"a":)" + a + "}", "12345678"); };
  EXPECT_EQ(ReadSafetensors(tensor(Tensor("F32", "[2]", "[0,8]"))).tensors.size(), 1u);
  expect(tensor(Tensor("F9", "[2]", "[0,8]")), "dtype = 'F9'");
  expect(tensor(Tensor("F32", "[3]", "[0,8]")), "do not fit");
  expect(tensor(Tensor("F32", "[2]", "[8,0]")), "do not fit");
  expect(tensor(Tensor("F32", "[4]", "[0,16]")), "do not fit");
  expect(tensor(Tensor("F32", "[1]", "[4,8]")), "a gap");
  expect(tensor(Tensor("F32", "[2]", "[0]")), "do not fit");
  expect(tensor(Tensor("F32", "2", "[0,8]")), "no list");
  expect(tensor(Tensor("F32", "[-2]", "[0,8]")), "shape");
  expect(tensor(Tensor("F32", "[4294967296,4294967296]", "[0,0]")), "larger than the file");
  expect(tensor(Tensor("F32", "[0,4294967296,4294967296]", "[0,0]")), "larger than the file");
  expect(tensor(Tensor("F32", "[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,2]", "[0,8]")), "no list");
  expect(tensor(R"({"dtype":"F32","shape":[2],"data_offsets":[0,8],"more":1})"), "more");
  expect(File(R"({"a":)" + Tensor("U8", "[2]", "[0,2]") + R"(,"b":)" +
                  Tensor("U8", "[2]", "[1,3]") + "}",
              "123"),
         "overlaps");
}

}  // namespace
}  // namespace volalign::safetensors_test
