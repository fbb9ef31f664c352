#include "core/json/strict_json.h"

#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::strict_json_test {
namespace {

std::string Nested(int levels) {
  return std::string(static_cast<std::size_t>(levels), '[') +
         std::string(static_cast<std::size_t>(levels), ']');
}

TEST(ParseStrictJson, LimitsDepth) {
  EXPECT_EQ(ParseStrictJson(Nested(kMaxJsonDepth), "a.json").size(), 1u);
  ExpectError<DataError>([] { ParseStrictJson(Nested(kMaxJsonDepth + 1), "a.json"); },
                         {"a.json", "64 levels"});
  // Deep enough to end the program where a value is written to a message by recursion.
  ExpectError<DataError>([] { ParseStrictJson("{\"a\":" + Nested(200000) + "}", "a.json"); },
                         {"a.json", "64 levels"});
  ExpectError<DataError>([] { ParseBoundedJson(Nested(200000), "a.json"); }, {"64 levels"});
}

TEST(ParseStrictJson, LimitsValues) {
  std::string many = "[0";
  many.reserve(2 * kMaxJsonValues + 3);
  for (std::size_t i = 0; i < kMaxJsonValues; ++i) many += ",0";
  ExpectError<DataError>([&] { ParseStrictJson(many + "]", "a.json"); }, {"4000000 values"});
}

TEST(ParseStrictJson, RefusesWhatIsNotStrict) {
  ExpectError<DataError>([] { ParseStrictJson("{\"a\":1,\"a\":2}", "a.json"); }, {"twice"});
  ExpectError<DataError>([] { ParseStrictJson("[null]", "a.json"); }, {"null"});
  EXPECT_TRUE(ParseBoundedJson("[null]", "a.json")[0].is_null());
  EXPECT_EQ(ParseBoundedJson("{\"a\":1,\"a\":2}", "a.json")["a"], 2);
  for (const auto& parse : {ParseStrictJson, ParseBoundedJson})
    ExpectError<DataError>([&] { parse("{", "a.json"); }, {"a.json: not valid JSON"});
}

// Messages quote values, keys and texts of the file, of whatever length.
TEST(JsonObject, MessagesAreShort) {
  const std::string long_text(1000000, 'a');
  const auto message_of = [](const auto& call) -> std::string {
    try {
      call();
    } catch (const DataError& error) {
      return error.what();
    }
    ADD_FAILURE() << "nothing was thrown";
    return "";
  };
  const nlohmann::json number = {{"n", long_text}}, key = {{long_text, 1}};
  for (const std::string& message :
       {message_of([&] { JsonObject(number, "a.json").Number("n"); }),
        message_of([&] { JsonObject(key, "a.json").RejectOthers(); }),
        message_of([&] { ParseStrictJson("{\"a\": " + long_text + "}", "a.json"); }),
        message_of([&] {
          ParseStrictJson("{\"" + long_text + "\":1,\"" + long_text + "\":2}", "a.json");
        })}) {
    EXPECT_LT(message.size(), 400u);
    EXPECT_EQ(message.rfind("a.json", 0), 0u) << message;
  }
  EXPECT_EQ(ShownJson({1, "a\x7f"}), "[1,\"a\\x7f\"]");
}

}  // namespace
}  // namespace volalign::strict_json_test
