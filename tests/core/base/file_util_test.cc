#include "core/base/file_util.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <random>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace fs = std::filesystem;

namespace volalign::file_util_test {
namespace {

/// Paths that fsync was called for, by the names that they had then.
std::vector<fs::path>& Synced() {
  static std::vector<fs::path> synced;
  return synced;
}

}  // namespace
}  // namespace volalign::file_util_test

// In place of the C library's, in this program alone.
extern "C" int fsync(int file) {
  std::error_code error;
  volalign::file_util_test::Synced().push_back(
      fs::read_symlink("/proc/self/fd/" + std::to_string(file), error));
  return static_cast<int>(::syscall(SYS_fsync, file));
}

namespace volalign::file_util_test {
namespace {

/// Paths below the folder.
std::set<std::string> Listing(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    names.insert(entry.path().lexically_relative(folder).string());
  return names;
}

TEST(FileUtil, WritesAndReadsAnyBytes) {
  const TempFolder folder;
  std::string bytes;
  for (int i = 0; i < 70000; ++i) bytes.push_back(static_cast<char>(i * 7));
  for (const std::string& content : {bytes, std::string(), std::string("\r\n\0x", 4)}) {
    WriteFileAtomically(folder / "a.bin", content);
    EXPECT_EQ(ReadFile(folder / "a.bin"), content);
  }
  EXPECT_EQ(Listing(folder.path()), std::set<std::string>{"a.bin"});
}

TEST(FileUtil, AFileNameAloneGoesToTheWorkingFolder) {
  const TempFolder folder;
  const auto before = fs::current_path();
  fs::current_path(folder.path());
  WriteFileAtomically("plain.txt", "x");
  fs::current_path(before);
  EXPECT_EQ(ReadFile(folder / "plain.txt"), "x");
}

TEST(FileUtil, ReadErrorsNamePathAndReason) {
  const TempFolder folder;
  ExpectError<IoError>([&] { ReadFile(folder / "missing.txt"); },
                       {(folder / "missing.txt").string(), "No such file"});
  ExpectError<IoError>([&] { ReadFile(folder.path()); }, {folder.path().string(), "folder"});
}

// What never ends, or never begins, is refused; a symbolic link to a file is that file.
TEST(FileUtil, OnlyFilesOnDiskAreRead) {
  const TempFolder folder;
  const std::string pipe = (folder / "pipe").string();
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  ExpectError<IoError>([&] { ReadFile(pipe); }, {pipe, "pipe"});
  ExpectError<IoError>([] { ReadFile("/dev/zero", 1000); }, {"/dev/zero", "device"});
  fs::create_symlink("/dev/zero", folder / "zero.png");
  ExpectError<IoError>([&] { ReadFile(folder / "zero.png", 1000); }, {"zero.png", "device"});
  WriteFileAtomically(folder / "a.txt", "content");
  fs::create_symlink(folder / "a.txt", folder / "link.txt");
  EXPECT_EQ(ReadFile(folder / "link.txt"), "content");
  // Announces a size of 0.
  EXPECT_GT(ReadFile("/proc/self/status").size(), 100u);
}

TEST(FileUtil, FilesThatAreTooLargeAreRefused) {
  const TempFolder folder;
  WriteFileAtomically(folder / "a.txt", "1234");
  EXPECT_EQ(ReadFile(folder / "a.txt", 4), "1234");
  ExpectError<IoError>([&] { ReadFile(folder / "a.txt", 3); }, {"a.txt", "4 bytes", "3"});
  ExpectError<IoError>([] { ReadFile("/proc/self/status", 10); }, {"/proc/self/status", "10"});
}

TEST(FileUtil, WriteErrorsNamePathAndReasonAndLeaveNothing) {
  const TempFolder folder;
  WriteFileAtomically(folder / "file", "x");
  ExpectError<IoError>([&] { WriteFileAtomically(folder / "file/inner.txt", "y"); },
                       {(folder / "file").string()});
  fs::create_directory(folder / "taken");
  ExpectError<IoError>([&] { WriteFileAtomically(folder / "taken", "y"); },
                       {(folder / "taken").string(), "a folder is there"});
  const std::string long_name(300, 'a');
  ExpectError<IoError>([&] { WriteFileAtomically(folder / long_name, "y"); },
                       {"create", "too long"});
  EXPECT_EQ(Listing(folder.path()), (std::set<std::string>{"file", "taken"}));
  EXPECT_EQ(ReadFile(folder / "file"), "x");
}

TEST(FileUtil, NoDeviceOrPipeIsReplaced) {
  const TempFolder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0666), 0);
  fs::create_symlink("/dev/null", folder / "null");
  for (const char* name : {"pipe", "null"}) {
    ExpectError<IoError>([&] { WriteFileAtomically(folder / name, "x"); },
                         {name, "a device or a pipe is there"});
  }
  EXPECT_TRUE(fs::is_fifo(folder / "pipe"));
  EXPECT_TRUE(fs::is_symlink(folder / "null"));
}

// The names of the file and of the folders that were made for it outlive a power failure, too.
TEST(FileUtil, SyncsTheFileAndWhatNamesIt) {
  const TempFolder folder;
  const fs::path base = fs::canonical(folder.path());
  Synced().clear();
  WriteFileAtomically(base / "a/b/c.txt", "x");
  ASSERT_EQ(Synced().size(), 4u);
  EXPECT_EQ(Synced()[0], base);
  EXPECT_EQ(Synced()[1], base / "a");
  EXPECT_EQ(Synced()[2].string().rfind((base / "a/b/c.txt.tmp-").string(), 0), 0u) << Synced()[2];
  EXPECT_EQ(Synced()[3], base / "a/b");
  Synced().clear();
  WriteFileAtomically(base / "a/b/d.txt", "x", /*sync=*/false);
  EXPECT_TRUE(Synced().empty());
}

// Each writer's bytes are alike: a mixture of two, or a file that another one renamed away, shows.
TEST(FileUtil, WritersOfOneFileDoNotShareATemporary) {
  const TempFolder folder;
  std::atomic<int> failures{0}, mixtures{0};
  const auto write = [&](char letter) {
    const std::string bytes(200000, letter);
    for (int i = 0; i < 100; ++i) {
      try {
        WriteFileAtomically(folder / "a.txt", bytes, /*sync=*/false);
        const std::string read = ReadFile(folder / "a.txt");
        if (read.size() != bytes.size() || read != std::string(bytes.size(), read[0])) ++mixtures;
      } catch (const Error&) {
        ++failures;
      }
    }
  };
  std::thread first(write, 'a'), second(write, 'b');
  first.join();
  second.join();
  EXPECT_EQ(failures, 0);
  EXPECT_EQ(mixtures, 0);
  EXPECT_EQ(Listing(folder.path()), std::set<std::string>{"a.txt"});
}

TEST(Sha256, KnownAnswers) {
  EXPECT_EQ(Sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(Sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

// RFC 4648, section 10.
TEST(Base64, FollowsTheStandard) {
  EXPECT_EQ(Base64(std::string("\xff\xfe\x00\x80", 4)), "//4AgA==");
}

// A file that another program cuts meanwhile is whole, an error, or what the cut left.
TEST(FileUtil, AFileThatShrinksWhileItIsRead) {
  const TempFolder folder;
  std::string whole(std::size_t{4} << 20, '\0');
  for (std::size_t i = 0; i < whole.size(); ++i) whole[i] = static_cast<char>(i * 7 + i / 4096);
  const std::string left = whole.substr(0, whole.size() / 3);
  int refused = 0;
  for (int i = 0; i < 40; ++i) {
    WriteFileAtomically(folder / "file", whole, /*sync=*/false);
    std::thread other([&] { fs::resize_file(folder / "file", left.size()); });
    try {
      const std::string read = ReadFile(folder / "file", std::uint64_t{1} << 30);
      EXPECT_TRUE(read == whole || read == left) << read.size();
    } catch (const IoError& error) {
      EXPECT_TRUE(Has(error.what(), "became shorter"));
      ++refused;
    }
    other.join();
  }
  std::printf("%d of 40 were cut while they were read\n", refused);
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
  for (const char* taken : {"done", "done/inner"})
    ExpectError<IoError>([&] { ResultFolder(folder / taken); }, {"done", "choose another"});
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
  fs::remove_all(result.draft() / "labels");
  WriteFileAtomically(result.draft() / "done", "");
  ExpectError<IoError>([&] { result.Publish("done", {"labels/S1.png"}); }, {"link"});
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
  for (const std::string& name : Listing(out)) EXPECT_FALSE(Has(name, "tmp"));
}

TEST(InputFile, DataStandAboveAProgramOrInShareBesideIt) {
  ::unsetenv("VOLALIGN_DATA_DIR");
  const TempFolder folder;
  const auto make = [&](const std::string& data) {
    fs::create_directories(folder / data / "configs");
    folder.Write(data + "/configs/structure.yaml", "");
  };
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), "");
  make("prefix/share/volalign");
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "prefix/share/volalign");
  make("prefix/bin/tree");
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/tree/build/program"), folder / "prefix/bin/tree")
      << "the nearest";
  make("named");
  ::setenv("VOLALIGN_DATA_DIR", (folder / "named").c_str(), 1);
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "named");
  ::setenv("VOLALIGN_DATA_DIR", folder.path().c_str(), 1);
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "prefix/share/volalign")
      << "one that has no data does not count";
  ::unsetenv("VOLALIGN_DATA_DIR");
}

// So that a program of somebody else's, which sets none, finds them as volalign does.
TEST(InputFile, DataAreLookedForNearTheRunningProgramUnlessItSaysOtherwise) {
  EXPECT_EQ(DataFolder(), fs::current_path());
  EXPECT_EQ(FindInputFile("configs/m01.yaml"), "configs/m01.yaml");
  const std::string before = DataFolder();
  SetDataFolder("");
  ExpectError<IoError>([] { RequireInputFile("data.structure", "configs/none.yaml"); },
                       {"data.structure = configs/none.yaml", "VOLALIGN_DATA_DIR"});
  SetDataFolder(before);
}

}  // namespace
}  // namespace volalign::file_util_test
