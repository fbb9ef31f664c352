#include "core/json/json_archive.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/json/table.h"
#include "tests/core/base/expect_error.h"

namespace volalign::json_archive_test {
namespace {

enum class Colour { kNone, kRed, kBlue };
const char* ToString(Colour colour) {
  return colour == Colour::kRed ? "red" : colour == Colour::kBlue ? "blue" : "";
}
std::vector<Colour> AllOf(Colour) { return {Colour::kNone, Colour::kRed, Colour::kBlue}; }

struct Part {
  std::string name;
  double size_m = 0;
  std::optional<PoseError> error;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("size_m", size_m);
    ar.Optional("error", error);
  }
};

struct Thing {
  std::string title;
  bool flag = false;
  int count = 0;
  std::uint64_t seed = 0;
  std::int64_t offset = 0;
  Colour colour = Colour::kNone;
  std::optional<Colour> second;
  std::string note;
  std::vector<std::string> files;
  double gain = 1;
  Pose pose = Pose::Identity();
  Eigen::Vector3d vector = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 2, 3> matrix = Eigen::Matrix<double, 2, 3>::Zero();
  std::vector<Part> parts;
  std::vector<std::pair<std::string, double>> laps;
  std::map<std::string, int> counts;
  std::vector<std::pair<int, double>> spans;
  Intrinsics intrinsics{4, 3, 5, 5.5, 1.5, 1, {}};

  template <class Archive>
  void Describe(Archive& ar) {
    ar.Constant("format", "thing/1");
    ar("title", title);
    ar("flag", flag);
    ar("count", count);
    ar("seed", seed);
    ar("offset", offset);
    ar.Optional("colour", colour);
    ar.Optional("second", second);
    ar.Optional("note", note);
    ar.OneOrList("files", files);
    ar.OptionalSinceVersion("gain", gain);
    ar("pose", pose);
    ar("vector", vector);
    ar("matrix", matrix);
    ar.ByName("parts", parts, &Part::name);
    ar("laps", laps);
    ar("counts", counts);
    ar("spans", spans);
    double twice = 2 * count;
    ar.WriteOnly("twice", twice);
    ar("intrinsics", intrinsics);
  }
};

Thing Full() {
  Thing thing;
  thing.title = "a \"b\"";
  thing.flag = true;
  thing.count = -3;
  thing.seed = 18446744073709551615ULL;
  thing.offset = std::numeric_limits<std::int64_t>::min();
  thing.colour = Colour::kRed;
  thing.second = Colour::kBlue;
  thing.note = "n";
  thing.files = {"one", "two"};
  thing.gain = 0.1;
  Vector6d motion;
  motion << 1, 2, 3, 0.1, -0.2, 0.3;
  thing.pose = PerturbLeft(motion, Pose::Identity());
  thing.vector << 1, 1.0 / 3, -0.0;
  thing.matrix << 1, 2, 3, 4, 5, 6;
  thing.parts = {{"z", 0.5, PoseError{0.25, 2}}, {"a", 1e-300, {}}};
  thing.laps = {{"b", 1.5}, {"a", 2}};
  thing.counts = {{"x", 1}};
  thing.spans = {{1, 2.5}, {-3, 4}};
  return thing;
}

// By hand: the keys in the order of Describe, what has no value absent.
TEST(JsonArchive, WritesKeysInOrderAndLeavesOutWhatHasNoValue) {
  Thing thing;
  thing.parts = {{"z", 0.5, PoseError{0.25, 2}}, {"a", 1, {}}};
  thing.laps = {{"b", 1.5}, {"a", 2}};
  thing.spans = {{1, 2.5}, {-3, 4}};
  EXPECT_EQ(
      WriteDescribed(thing, "t.json", -1),
      R"({"format":"thing/1","title":"","flag":false,"count":0,"seed":0,"offset":0,)"
      R"("gain":1.0,)"
      R"("pose":[[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0],[0.0,0.0,0.0,1.0]],)"
      R"("vector":[0.0,0.0,0.0],"matrix":[[0.0,0.0,0.0],[0.0,0.0,0.0]],)"
      R"("parts":{"z":{"size_m":0.5,"error":{"translation_m":0.25,"rotation_deg":2.0}},)"
      R"("a":{"size_m":1.0}},"laps":{"b":1.5,"a":2.0},"counts":{},"spans":[[1,2.5],[-3,4.0]],)"
      R"("twice":0.0,)"
      R"("intrinsics":{"width":4,"height":3,"fx":5.0,"fy":5.5,"cx":1.5,"cy":1.0,"distortion":[]}})"
      "\n");
  thing.files = {"one"};
  EXPECT_EQ(DescribedJson(thing, "t.json")["files"], "one");
}

TEST(JsonArchive, ReadsBackWhatItWrote) {
  const Thing thing = Full();
  const std::string text = WriteDescribed(thing, "t.json", 1);
  Thing read = ReadDescribed<Thing>(text, "t.json");
  EXPECT_EQ(nlohmann::json::parse(WriteDescribed(read, "t.json", 1)), nlohmann::json::parse(text));
  EXPECT_EQ(read.seed, thing.seed);
  EXPECT_EQ(read.offset, thing.offset);
  ASSERT_EQ(read.parts.size(), 2u);
  EXPECT_EQ(read.parts[1].name, "z");  // alphabetical order
  EXPECT_EQ(read.intrinsics, thing.intrinsics);
  // An absent key takes a value back, where one was optional, and keeps it, where it came later.
  auto json = nlohmann::json::parse(text);
  for (const char* key : {"colour", "second", "note", "files", "gain", "twice"}) json.erase(key);
  read = ReadDescribed<Thing>(json.dump(), "t.json");
  EXPECT_EQ(read.colour, Colour::kNone);
  EXPECT_FALSE(read.second.has_value());
  EXPECT_EQ(read.note, "");
  EXPECT_TRUE(read.files.empty());
  EXPECT_EQ(read.gain, 1);
}

TEST(JsonArchive, WritesTextThatIsNoUtf8) {
  Thing thing;
  thing.title = "caf\xe9.png";
  const std::string text = WriteDescribed(thing, "thing", 1);
  EXPECT_TRUE(Has(text, "\"caf\xef\xbf\xbd.png\""));
}

TEST(JsonArchive, ReadingNamesThePlace) {
  const nlohmann::json good = nlohmann::json::parse(WriteDescribed(Full(), "t.json", 1));
  const auto expect = [&](const std::string& pointer, const nlohmann::json& value,
                          std::initializer_list<std::string> parts) {
    nlohmann::json bad = good;
    bad[nlohmann::json::json_pointer(pointer)] = value;
    ExpectError<DataError>([&] { ReadDescribed<Thing>(bad.dump(), "t.json"); }, parts);
  };
  expect("/format", "thing/2", {"t.json: format \"thing/2\"", "thing/1"});
  expect("/titel", "x", {"t.json", "\"titel\" is unknown", "\"title\""});
  expect("/title", 3, {"t.json: title = 3 is not a string"});
  expect("/flag", 1, {"t.json: flag = 1", "true or false"});
  expect("/count", 1.5, {"t.json: count = 1.5", "whole"});
  expect("/offset", 1.5, {"t.json: offset = 1.5", "whole"});
  expect("/spans/1", {1, 2, 3}, {"t.json: spans[1] has 3 elements, not 2"});
  expect("/seed", -1, {"t.json: seed = -1", "whole"});
  expect("/colour", "green", {"t.json: colour = \"green\"", "red, blue"});
  expect("/note", nullptr, {"t.json", "null"});
  expect("/files/1", 2, {"t.json: files[1] = 2", "string"});
  expect("/pose/0/0", 2, {"t.json: pose"});
  expect("/pose/1", {1, 2}, {"t.json: pose has 2 columns, not 4"});
  expect("/vector", {1, 2}, {"t.json: vector has 2 numbers, not 3"});
  expect("/matrix/1", {1, 2}, {"t.json: matrix has 2 columns, not 3"});
  expect("/parts/z/size_m", "big", {"t.json: parts: z: size_m = \"big\"", "finite number"});
  expect("/parts/z/colour", "red", {"t.json: parts: z", "\"colour\" is unknown"});
  expect("/parts/z/error", 1, {"t.json: parts: z: error", "object"});
  expect("/laps/a", "x", {"t.json: laps: a"});
  expect("/intrinsics/fx", 0, {"t.json: intrinsics", "fx = 0"});
  nlohmann::json bad = good;
  bad["parts"]["z"].erase("size_m");
  ExpectError<DataError>([&] { ReadDescribed<Thing>(bad.dump(), "t.json"); },
                         {"t.json: parts: z", "\"size_m\" is missing"});
  std::string twice = good.dump();
  twice.replace(twice.find("\"count\""), 0, "\"count\":1,");
  ExpectError<DataError>([&] { ReadDescribed<Thing>(twice, "t.json"); }, {"t.json", "twice"});
}

struct Measured {
  double size = 0, gain = 0;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Pose pose = Pose::Identity();
  template <class Archive>
  void Describe(Archive& ar) {
    ar.IfFinite("size", size);
    ar.IfFinite("gain", gain, 1.0);
    ar.IfFinite("place", place);
    ar.IfFinite("pose", pose);
  }
};

TEST(JsonArchive, WhatIsUnknownIsAnAbsentKey) {
  Measured thing;
  thing.size = 2;
  thing.place.y() = std::nan("");
  thing.gain = std::numeric_limits<double>::infinity();
  thing.pose.translation().x() = std::nan("");
  const std::string text = WriteDescribed(thing, "t.json", -1);
  EXPECT_EQ(text, "{\"size\":2.0}\n");
  const Measured read = ReadDescribed<Measured>(text, "t.json");
  EXPECT_EQ(read.size, 2);
  EXPECT_EQ(read.gain, 1);
  EXPECT_TRUE(read.place.array().isNaN().all());
  EXPECT_TRUE(read.pose.matrix().array().isNaN().all());
  ExpectError<DataError>([] { ReadDescribed<Measured>("{\"size\": null}", "t.json"); }, {"null"});
}

TEST(JsonArchive, WritingRefusesWhatIsNotFinite) {
  for (const double value : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Thing thing = Full();
    thing.parts[0].size_m = value;
    ExpectError<Error>([&] { WriteDescribed(thing, "t.json", 1); },
                       {"t.json: parts: z: size_m", "not finite"});
    thing = Full();
    thing.matrix(1, 2) = value;
    ExpectError<Error>([&] { WriteDescribed(thing, "t.json", 1); },
                       {"t.json: matrix", "not finite"});
  }
}

std::string Nested(int levels) {
  return std::string(static_cast<std::size_t>(levels), '[') +
         std::string(static_cast<std::size_t>(levels), ']');
}

TEST(ParseStrictJson, RefusesNull) {
  ExpectError<DataError>([] { ParseStrictJson("null", "a.json"); }, {"a.json", "null"});
}

TEST(ParseStrictJson, LimitsDepth) {
  EXPECT_EQ(ParseStrictJson(Nested(kMaxJsonDepth), "a.json").size(), 1u);
  ExpectError<DataError>([] { ParseStrictJson(Nested(kMaxJsonDepth + 1), "a.json"); },
                         {"a.json", "64 levels"});
  // Deep enough to end the program where a value is written to a message by recursion.
  ExpectError<DataError>([] { ParseStrictJson("{\"a\":" + Nested(200000) + "}", "a.json"); },
                         {"a.json", "64 levels"});
}

TEST(ParseStrictJson, LimitsValues) {
  std::string many = "[0";
  many.reserve(2 * kMaxJsonValues + 3);
  for (std::size_t i = 0; i < kMaxJsonValues; ++i) many += ",0";
  ExpectError<DataError>([&] { ParseStrictJson(many + "]", "a.json"); }, {"4000000 values"});
}

// Messages quote values, keys and texts of the file, of whatever length.
TEST(ObjectReader, MessagesAreShort) {
  const std::string long_text(1000000, 'a');
  const nlohmann::json number = {{"n", long_text}}, key = {{long_text, 1}};
  for (const std::string& message :
       {ExpectError<DataError>([&] { ObjectReader(number, "a.json").Number("n"); }),
        ExpectError<DataError>([&] { ObjectReader(key, "a.json").RejectOthers(); }),
        ExpectError<DataError>([&] { ParseStrictJson("{\"a\": " + long_text + "}", "a.json"); }),
        ExpectError<DataError>([&] {
          ParseStrictJson("{\"" + long_text + "\":1,\"" + long_text + "\":2}", "a.json");
        })}) {
    EXPECT_LT(message.size(), 400u);
    EXPECT_EQ(message.rfind("a.json", 0), 0u) << message;
  }
  EXPECT_EQ(ShownJson({1, "a\x7f"}), "[1,\"a\\x7f\"]");
}

Table TwoSensors() {
  Table table;
  table.columns = {"sensor", {"rms_m", "rms mm", 1000, 1}, "sides", "refined", {"reason", ""}};
  table.rows = {{std::string("a,\"b\""), 0.0123, CellOf(9), true, std::string("none")},
                {std::string("c"), Table::Cell(), CellOf(std::size_t{10}), false, Table::Cell()}};
  return table;
}

TEST(FormatTable, AlignsTextInItsUnits) {
  EXPECT_EQ(FormatTable(TwoSensors(), TableFormat::kText),
            "sensor  rms mm  sides  refined\n"
            "a,\"b\"     12.3      9  yes\n"
            "c                  10  no\n");
}

TEST(FormatTable, LeavesOutWhatNoRowHas) {
  Table table = TwoSensors();
  for (auto& row : table.rows) row[1] = Table::Cell();
  EXPECT_EQ(FormatTable(table, TableFormat::kText).rfind("sensor  sides  refined\n", 0), 0u);
  table.rows[0][0] = "a\n\xff";
  EXPECT_TRUE(Has(FormatTable(table, TableFormat::kText), "a\\x0a\\xff"));
  EXPECT_EQ(nlohmann::json::parse(FormatTable(table, TableFormat::kJson))[0].at("sensor"),
            "a\\x0a\\xff");
  table.rows.clear();
  EXPECT_TRUE(Has(FormatTable(table, TableFormat::kText), "rms mm"));
}

TEST(FormatTable, QuotesCsv) {
  EXPECT_EQ(FormatTable(TwoSensors(), TableFormat::kCsv),
            "sensor,rms_m,sides,refined,reason\r\n"
            "\"a,\"\"b\"\"\",0.0123,9,yes,none\r\n"
            "c,,10,no,\r\n");
}

TEST(FormatTable, JsonHasObjectsOfWhatIsKnown) {
  Table table = TwoSensors();
  table.rows[1][1] = std::numeric_limits<double>::infinity();
  const nlohmann::json json = nlohmann::json::parse(FormatTable(table, TableFormat::kJson));
  ASSERT_EQ(json.size(), 2u);
  EXPECT_EQ(json[0].at("sensor"), "a,\"b\"");
  EXPECT_EQ(json[0].at("rms_m"), 0.0123);
  EXPECT_TRUE(json[0].at("sides").is_number_integer());
  EXPECT_EQ(json[0].at("refined"), true);
  EXPECT_EQ(json[0].at("reason"), "none");
  EXPECT_EQ(json[1].size(), 3u) << json[1];
}

}  // namespace
}  // namespace volalign::json_archive_test
