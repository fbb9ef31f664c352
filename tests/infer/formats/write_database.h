#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <filesystem>
#include <string>

#include "tests/core/base/temp_folder.h"

namespace volalign {

/// a.db3, anew, with what the statements make of it.
inline std::string WriteDatabase(const TempFolder& folder, const std::string& sql) {
  std::string path = (folder / "a.db3").string();
  std::filesystem::remove(path);
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  return path;
}

}  // namespace volalign
