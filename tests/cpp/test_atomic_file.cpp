#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/data_set.h"
#include "reads.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::error_of;
using testing::TestFolder;

std::vector<std::string> names(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    names.push_back(entry.path().filename().string());
  std::ranges::sort(names);
  return names;
}

std::string host() {
  std::array<char, 65> name{};
  ::gethostname(name.data(), name.size() - 1);
  return name.data();
}

TEST(atomic_file, of_many_writers_is_that_of_one_of_them) {
  const TestFolder folder;
  const auto file = folder.path() / "file";
  {
    std::vector<std::jthread> writers;
    for (char c = 'a'; c < 'e'; ++c)
      writers.emplace_back([&, c] {
        for (int i = 0; i < 200; ++i) write_file_atomically(file, std::string(1000, c));
      });
  }
  const std::string text = read_file(file);
  EXPECT_EQ(text, std::string(1000, text.at(0)));
  EXPECT_EQ(names(folder.path()), std::vector<std::string>{"file"});
}

TEST(atomic_file, that_is_there_is_not_created_anew) {
  const TestFolder folder;
  const auto file = folder.path() / std::string(250, 'n');
  EXPECT_TRUE(create_file_atomically(file, "first"));
  EXPECT_FALSE(create_file_atomically(file, "second"));
  EXPECT_EQ(read_file(file), "first");
  EXPECT_EQ(names(folder.path()), std::vector<std::string>{file.filename().string()});
}

TEST(atomic_file, claimed_at_once_belongs_to_all_that_say_the_same) {
  const TestFolder folder;
  const auto file = folder.path() / "file";
  {
    std::vector<std::jthread> claims;
    for (int i = 0; i < 8; ++i)
      claims.emplace_back([&] { EXPECT_NO_THROW(claim_file(file, "same\n")); });
  }
  EXPECT_THROW(claim_file(file, "other\n"), IoError);
}

TEST(atomic_file, writes_the_target_of_a_link) {
  const TestFolder folder;
  std::filesystem::create_directory(folder.path() / "else");
  const auto target = folder.path() / "else/file", link = folder.path() / "link";
  std::filesystem::create_symlink("else/file", link);
  for (const char* text : {"new", "newer"}) {  // the target is first missing
    write_file_atomically(link, text);
    EXPECT_EQ(read_file(target), text);
    EXPECT_TRUE(std::filesystem::is_symlink(link));
  }
  EXPECT_FALSE(create_file_atomically(link, "again"));
  EXPECT_EQ(names(folder.path() / "else"), std::vector<std::string>{"file"});
}

TEST(atomic_file, neither_reads_nor_replaces_a_fifo_or_a_loop_of_links) {
  const TestFolder folder;
  const auto fifo = folder.path() / "fifo", link = folder.path() / "link";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  std::filesystem::create_symlink("fifo", link);
  for (const auto& path : {fifo, link}) {
    EXPECT_NE(error_of([&] { write_file_atomically(path, "x"); }).find("got a FIFO"),
              std::string::npos);
    EXPECT_NE(error_of([&] { read_file(path); }).find("got a FIFO"), std::string::npos);
  }
  EXPECT_TRUE(std::filesystem::is_fifo(fifo));
  std::filesystem::create_symlink("loop", folder.path() / "loop");
  EXPECT_NE(error_of([&] { write_file_atomically(folder.path() / "loop", "x"); }).find("a loop"),
            std::string::npos);
  EXPECT_THROW(read_file(folder.path() / "loop"), IoError);
}

TEST(read_file, refuses_a_file_above_its_limit_before_it_reads) {
  const TestFolder folder;
  const auto file = folder.write("sparse", "");
  std::filesystem::resize_file(file, std::uintmax_t{1} << 40);
  EXPECT_NE(error_of([&] { read_file(file); }).find("at most 4096 MiB, got 1048576 MiB"),
            std::string::npos);
}

TEST(atomic_file, leftovers_of_the_dead_go_and_those_of_others_stay) {
  const TestFolder folder;
  // larger than any process id of the system
  const std::string dead = "." + host() + ".2147483646.0.tmp";
  const std::string mine = "." + host() + "." + std::to_string(::getpid()) + ".0.tmp";
  for (const std::string& name :
       {".000001.bin" + dead, ".000001.bin" + mine, std::string(".a.other.2147483646.0.tmp"),
        "a" + dead, std::string(".tmp"), std::string(".a.tmp"), std::string("000001.bin")})
    folder.write(name, "x");
  const std::string gone = ".000001.bin" + dead;
  std::vector<std::string> stay = names(folder.path());
  std::erase(stay, gone);
  create_folder(folder.path());
  EXPECT_EQ(names(folder.path()), stay);
}

TEST(atomic_file, is_created_on_a_file_system_without_hard_links) {
  for (const int without_links : {EPERM, EOPNOTSUPP, ENOSYS, EMLINK})
    for (const int without_rename : {0, EINVAL}) {
      const TestFolder folder;
      const auto file = folder.path() / "file";
      testing::link_error = without_links;
      testing::rename_error = without_rename;
      EXPECT_TRUE(create_file_atomically(file, "first"));
      EXPECT_FALSE(create_file_atomically(file, "second"));
      testing::link_error = testing::rename_error = 0;
      EXPECT_EQ(read_file(file), "first");
      EXPECT_EQ(names(folder.path()), std::vector<std::string>{"file"});
    }
  const TestFolder folder;
  testing::link_error = EACCES;
  EXPECT_THROW(create_file_atomically(folder.path() / "file", "x"), IoError);
  testing::link_error = 0;
}

TEST(entries, of_a_folder_are_its_paths_and_of_none_an_error) {
  const TestFolder folder;
  folder.write("a", "");
  std::error_code error;
  EXPECT_EQ(entries_of(folder.path(), error),
            std::vector<std::filesystem::path>{folder.path() / "a"});
  EXPECT_FALSE(error);
  EXPECT_TRUE(entries_of(folder.path() / "none", error).empty());
  EXPECT_TRUE(error);
}

TEST(read_file, of_a_disk_with_an_error_gives_no_part_of_a_file) {
  const TestFolder folder;
  const std::string text(100'000, 'x');
  const auto file = folder.write("file", text);
  for (const int reads : {0, 1, 2}) {
    testing::reads_left = reads;
    EXPECT_THROW(read_file(file), IoError) << reads;
    testing::reads_left = -1;
  }
  EXPECT_EQ(read_file(file), text);
}

}  // namespace
}  // namespace infrasim
