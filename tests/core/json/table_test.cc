#include "core/json/table.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>

namespace volalign::table_test {
namespace {

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
  EXPECT_NE(FormatTable(table, TableFormat::kText).find("a\\x0a\\xff"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(FormatTable(table, TableFormat::kJson))[0].at("sensor"),
            "a\\x0a\\xff");
  table.rows.clear();
  EXPECT_NE(FormatTable(table, TableFormat::kText).find("rms mm"), std::string::npos);
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
}  // namespace volalign::table_test
