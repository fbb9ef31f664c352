#include "infer/evaluate/suite/suite_config.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/core/base/temp_folder.h"

namespace volalign::suite_config_test {
namespace {

template <class T>
std::string NamesOf(const std::vector<T>& items) {
  std::string names;
  for (const T& item : items) names += (names.empty() ? "" : " ") + item.name;
  return names;
}

class Suite : public testing::Test {
 protected:
  SuiteConfig Read() {
    return ReadSuite(folder_
                         .Write("suite.yaml",
                                "datasets:\n"
                                "  - {name: arc, rigs: [rigs/arc.yaml], captures: [../c.json]}\n"
                                "  - {name: ring, rigs: [/abs/ring.yaml]}\n"
                                "methods:\n"
                                "  - {name: net, model: models/net.pt, datasets: [arc]}\n"
                                "  - {name: markers, kind: markers}\n"
                                "tables:\n"
                                "  - name: one\n"
                                "    blocks: [{title: RMS, metric: d1, datasets: [arc]}]\n"
                                "    rows: [{label: net, method: net, stage: graph}]\n"
                                "  - name: two\n"
                                "    blocks: [{title: RMS, metric: d2, datasets: [ring]}]\n"
                                "    rows: [{label: markers, method: markers}]\n"
                                "figures:\n"
                                "  - {name: labels, capture: arc_turn_1, methods: [net]}\n")
                         .string());
  }

  TempFolder folder_;
};

TEST_F(Suite, FilesAreRelativeToItsOwn) {
  const SuiteConfig suite = Read();
  EXPECT_EQ(suite.datasets[0].rigs[0], (folder_ / "rigs/arc.yaml").string());
  EXPECT_EQ(suite.datasets[0].captures[0], (folder_.path().parent_path() / "c.json").string());
  EXPECT_EQ(suite.datasets[1].rigs[0], "/abs/ring.yaml");
  EXPECT_EQ(suite.methods[0].model, (folder_ / "models/net.pt").string());
  EXPECT_EQ(suite.methods[1].model, "");
  EXPECT_TRUE(IsApplicable(suite.methods[0], "arc"));
  EXPECT_FALSE(IsApplicable(suite.methods[0], "ring"));
  EXPECT_TRUE(IsApplicable(suite.methods[1], "ring"));
  EXPECT_STREQ(ToString(suite.tables[0].rows[0].stage), "graph");
  EXPECT_STREQ(ToString(suite.tables[1].blocks[0].metric), "d2");
}

TEST_F(Suite, ATableAloneHasWhatItNeeds) {
  const SuiteConfig all = SelectTables(Read(), "all"), two = SelectTables(Read(), "two");
  EXPECT_EQ(NamesOf(all.tables), "one two");
  EXPECT_EQ(NamesOf(all.datasets), "arc ring");
  EXPECT_EQ(NamesOf(all.figures), "labels");
  EXPECT_EQ(NamesOf(two.tables), "two");
  EXPECT_EQ(NamesOf(two.datasets), "ring");
  EXPECT_EQ(NamesOf(two.methods), "markers");
  EXPECT_EQ(NamesOf(two.figures), "");
}

// The file that is shipped: the paper's tables, in its order of rows.
TEST(PaperSuite, IsThePapers) {
  const SuiteConfig suite = ReadSuite("configs/paper/suite.yaml");
  ASSERT_EQ(suite.tables.size(), 6u);
  const auto paper_rows = [&](std::size_t table) {
    std::string rows;
    for (const SuiteRow& row : suite.tables[table].rows) {
      if (!row.paper.empty()) rows += (rows.empty() ? "" : " ") + row.label;
    }
    return rows;
  };
  EXPECT_EQ(paper_rows(0), "m01 m05 m04 m02 m03 m07 m06");
  EXPECT_EQ(paper_rows(1), "m05 m04 m07 m06");
  EXPECT_EQ(paper_rows(2), "m05 m04 m07 m06");
  EXPECT_EQ(paper_rows(3),
            "markerbased_refined markerless_refined markerbased_initial markerless_initial");
  EXPECT_EQ(NamesOf(suite.tables), "table2 table3 table4 table5 table6 table4_level");
  for (const SuiteTable& table : suite.tables) {
    for (const SuiteRow& row : table.rows) {
      // Means, STDs and RSDs as printed are consistent, but for the arc's RSD.
      for (std::size_t b = 0; 4 * b < row.paper.size(); ++b) {
        if (row.paper[4 * b] == "N/A") continue;
        const double mean = std::stod(row.paper[4 * b]), std = std::stod(row.paper[4 * b + 1]);
        const double rsd = std::stod(row.paper[4 * b + 2]) / 100;
        const double step = row.paper[4 * b].back() == '%' ? 0.01 : 1e-4;
        const bool consistent = std::abs(rsd - std / mean) < 0.51 * step / mean + 0.001;
        EXPECT_EQ(consistent, table.name != "table5") << table.name << " " << row.label;
      }
    }
  }
}

}  // namespace
}  // namespace volalign::suite_config_test
