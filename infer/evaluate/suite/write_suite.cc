#include "infer/evaluate/suite/write_suite.h"

#include "core/base/file_util.h"
#include "infer/evaluate/suite/table_data.h"

namespace volalign {

std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores) {
  std::string all;
  for (const SuiteTable& table : suite.tables) {
    const TableData data = MakeTable(suite, table, scores);
    const std::string markdown = FormatMarkdown(data);
    WriteFileAtomically(folder / (table.name + ".md"), markdown);
    WriteFileAtomically(folder / (table.name + ".csv"), FormatCsv(data));
    WriteFileAtomically(folder / (table.name + ".json"), FormatTableJson(data));
    all += (all.empty() ? "" : "\n") + markdown;
  }
  WriteFileAtomically(folder / "suite.md", all);
  WriteFileAtomically(folder / "suite.json", FormatScores(scores));
  return all;
}

}  // namespace volalign
