#include "core/base/folder.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <random>
#include <set>
#include <string>
#include <thread>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::folder_test {
namespace {

namespace fs = std::filesystem;

/// Paths below the folder.
std::set<std::string> Listing(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    names.insert(entry.path().lexically_relative(folder).string());
  return names;
}

TEST(FolderLock, IsOneProcesssUntilItGoes) {
  const TempFolder folder;
  {
    const FolderLock lock(folder / "a/b");
    ExpectError<IoError>([&] { FolderLock(folder / "a/b"); },
                         {(folder / "a/b").string(), "another volalign is writing there"});
    ExpectError<IoError>([&] { ResultFolder(folder / "a/b"); }, {"another volalign"});
  }
  EXPECT_NO_THROW(FolderLock(folder / "a/b"));
  const pid_t child = ::fork();
  if (child == 0) {
    const FolderLock lock(folder / "a");
    WriteFileAtomically(folder / "locked", "");
    ::pause();
    ::_exit(0);
  }
  while (!fs::exists(folder / "locked")) std::this_thread::yield();
  std::thread killer([child] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    ::kill(child, SIGKILL);
  });
  EXPECT_NO_THROW(FolderLock(folder / "a", std::chrono::seconds(10)));
  killer.join();
  ::waitpid(child, nullptr, 0);
}

TEST(RemoveTemporaries, LeavesWhatHasOtherNames) {
  const TempFolder folder;
  for (const char* name : {"a.png", "a.png.tmp-12-3", "a.tmp-x", "tmp-1"}) folder.Write(name, "x");
  RemoveTemporaries(folder.path());
  RemoveTemporaries(folder / "missing");
  EXPECT_EQ(Listing(folder.path()), (std::set<std::string>{"a.png", "a.tmp-x", "tmp-1"}));
}

TEST(ResultFolder, HoldsTheEarlierResultUntilTheNewOneIsWhole) {
  const TempFolder folder;
  const fs::path out = folder / "out";
  {
    const ResultFolder result(out);
    WriteFileAtomically(result.draft() / "sub/a", "1");
    WriteFileAtomically(result.draft() / "done", "1");
    EXPECT_EQ(Listing(out).count("done"), 0u);
    result.Publish("done");
  }
  EXPECT_EQ(Listing(out), (std::set<std::string>{"done", "sub", "sub/a"}));
  const std::set<std::string> before = Listing(out);
  {
    const ResultFolder result(out);
    WriteFileAtomically(result.draft() / "done", "2");
  }
  EXPECT_EQ(Listing(out), before);
  EXPECT_EQ(ReadFile(out / "done"), "1");

  fs::create_directory(out / "unfinished.tmp-killed");
  WriteFileAtomically(out / "notes.txt", "mine");
  {
    const ResultFolder result(out);
    WriteFileAtomically(result.draft() / "done", "2");
    WriteFileAtomically(result.draft() / "b", "2");
    result.Publish("done", {"sub/a", "never/was"});
  }
  EXPECT_EQ(Listing(out), (std::set<std::string>{"b", "done", "notes.txt", "sub"}));
  EXPECT_EQ(ReadFile(out / "done"), "2");
}

TEST(ResultFolder, LeavesTheEarlierResultWhereTheNewOneHasNoPlace) {
  const TempFolder folder;
  folder.Write("done", "1");
  fs::create_directory(folder / "a");
  const ResultFolder result(folder.path());
  WriteFileAtomically(result.draft() / "a", "2");
  WriteFileAtomically(result.draft() / "done", "2");
  ExpectError<IoError>([&] { result.Publish("done"); }, {(folder / "a").string(), "a folder"});
  EXPECT_EQ(ReadFile(folder / "done"), "1");
  ExpectError<IoError>([&] { ResultFolder other(folder / "done"); }, {"done", "choose another"});
}

/// Writes results of ten files until it is killed, each with a number of its own.
[[noreturn]] void WriteResults(const fs::path& out, int number) {
  for (;; ++number) {
    const ResultFolder result(out);
    for (char name = 'a'; name <= 'j'; ++name)
      WriteFileAtomically(result.draft() / std::string(1, name), std::to_string(number));
    WriteFileAtomically(result.draft() / "done", std::to_string(number));
    result.Publish("done");
  }
}

/// The number of the result in the folder, or -1 where none is complete at the moment.
int NumberIn(const fs::path& out) {
  try {
    return std::stoi(ReadFile(out / "done"));
  } catch (const IoError&) {
    return -1;
  }
}

TEST(ResultFolder, WritesNothingBehindALink) {
  const TempFolder folder;
  const fs::path out = folder / "out";
  WriteFileAtomically(folder / "victim/S1.png", "mine");
  fs::create_directory(out);
  fs::create_directory_symlink(folder / "victim", out / "labels");
  const ResultFolder result(out);
  WriteFileAtomically(result.draft() / "labels/S1.png", "new");
  ExpectError<IoError>([&] { result.Publish("done"); },
                       {(out / "labels").string() + ", which is a link to another folder"});
  const ResultFolder* const again = &result;
  fs::remove_all(result.draft() / "labels");
  WriteFileAtomically(again->draft() / "done", "");
  ExpectError<IoError>([&] { again->Publish("done", {"labels/S1.png"}); }, {"link"});
  EXPECT_EQ(ReadFile(folder / "victim/S1.png"), "mine");
}

// A link takes a folder's place and leaves it again, all the time.
TEST(ResultFolder, WritesNothingBehindALinkThatComesMeanwhile) {
  const TempFolder folder;
  const fs::path out = folder / "out", labels = out / "labels", link = folder / "link";
  fs::create_directories(folder / "victim");
  fs::create_directories(labels);
  fs::create_directory_symlink(folder / "victim", link);
  std::atomic<bool> done = false;
  std::thread other([&] {
    while (!done) ::renameat2(AT_FDCWD, link.c_str(), AT_FDCWD, labels.c_str(), RENAME_EXCHANGE);
  });
  int written = 0;
  for (int round = 0; round < 4000 && written < 50; ++round) {
    const ResultFolder result(out);
    WriteFileAtomically(result.draft() / "labels/S1.png", "new", false);
    try {
      result.Publish("done");
      ++written;
    } catch (const IoError&) {
    }
  }
  done = true;
  other.join();
  EXPECT_EQ(written, 50);
  EXPECT_TRUE(fs::is_empty(folder / "victim"));
}

TEST(ResultFolder, NamesNoMixtureAsCompleteWhenKilledAtAnyMoment) {
  const TempFolder folder;
  const fs::path out = folder / "out";
  std::mt19937 random(1);
  // How often a kill falls between two results is a matter of the disk.
  int drafts = 0, complete = 0;
  for (int kill = 0; kill < 20 || complete < 5 || drafts < 5; ++kill) {
    ASSERT_LT(kill, 400);
    const pid_t child = ::fork();
    if (child == 0) WriteResults(out, 1000 * kill);
    // Once it has written one, at a moment of one of the next three.
    const auto begin = std::chrono::steady_clock::now();
    while (NumberIn(out) < 1000 * kill) std::this_thread::yield();
    const auto span = std::chrono::steady_clock::now() - begin;
    std::this_thread::sleep_for(span * (random() % 1000) * 3e-3);
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    bool draft = false;
    for (const auto& entry : fs::directory_iterator(out))
      draft = draft || entry.path().filename().string().rfind("unfinished.tmp-", 0) == 0;
    drafts += draft;
    if (!fs::exists(out / "done")) continue;
    ++complete;
    for (char name = 'a'; name <= 'j'; ++name)
      ASSERT_EQ(std::stoi(ReadFile(out / std::string(1, name))), NumberIn(out)) << "kill " << kill;
  }
  { const ResultFolder sweep(out); }
  for (const std::string& name : Listing(out)) EXPECT_EQ(name.find("tmp"), std::string::npos);
}

}  // namespace
}  // namespace volalign::folder_test
