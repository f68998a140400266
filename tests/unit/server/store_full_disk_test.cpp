#include "store/store_state.hpp"

#include "store/disk_full.hpp"
#include "store/package_store.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace full_disk_test {

namespace fs = std::filesystem;
using ::stillmap::test::FullDisk;
using ::stillmap::test::TemporaryFolder;

class FullDiskTest : public ::testing::Test {
 protected:
  FullDiskTest() {
    test::write_package(built_.path() / "town", 7);
    store_.add("town", "v1", built_.path() / "town");
    key_ = store_.keys().create("car", {.bits = 1}, {}, 1).key.id;
    drive_ = store_.drives().open("town", "monday", 1).id;
    job_ = store_.jobs().enqueue({.map = "town", .request = "{}"}, 1).job.id;
    store_.state().keep_ballast();
  }
  [[nodiscard]] bool has_ballast() const { return fs::exists(folder_.path() / ".ballast"); }

  TemporaryFolder built_, folder_;
  FullDisk disk_;
  PackageStore store_{folder_.path(), disk_};
  std::string key_;
  std::int64_t drive_ = 0, job_ = 0;
};

TEST_F(FullDiskTest, WhateverRemovesOrRevokesHasTheBallastsRoom) {
  ASSERT_GT(fs::file_size(folder_.path() / ".ballast"), std::uintmax_t{1} << 20U);
  const std::vector<std::pair<std::string, std::function<void()>>> removals = {
      {"key", [&] { store_.keys().revoke(key_, 2); }},
      {"job", [&] { store_.jobs().request_cancel(job_, 2); }},
      {"old jobs", [&] { store_.jobs().forget_finished_before(9, 9); }},
      {"drive", [&] { store_.drives().remove(drive_); }},
      {"version", [&] { EXPECT_TRUE(store_.remove("town", "v1")); }},
      {"map", [&] { store_.remove_map("town"); }},
      {"audit row",
       [&] { store_.even_when_full([&] { store_.audit().append({.status = 204}); }); }}};
  for (const auto& [what, remove] : removals) {
    disk_.fill();
    EXPECT_NO_THROW(remove()) << what;
    EXPECT_FALSE(disk_.is_full()) << what;
    EXPECT_FALSE(has_ballast()) << what;
    store_.state().keep_ballast();
    EXPECT_TRUE(has_ballast()) << what;
  }
  const PackageStore again(folder_.path());
  EXPECT_TRUE(again.state().keys().list().front().revoked_ns);
  EXPECT_TRUE(again.state().maps().empty());
  EXPECT_EQ(again.state().audit().list(9).records.size(), 1U);
  EXPECT_TRUE(fs::is_empty(folder_.path() / "packages"));
}

TEST_F(FullDiskTest, WhatBringsBytesLeavesTheBallastAlone) {
  disk_.fill();
  EXPECT_THROW(store_.drives().open("town", "tuesday", 2), DiskFull);
  EXPECT_THROW(store_.audit().append({.status = 507}), DiskFull);
  EXPECT_TRUE(has_ballast());
}

TEST_F(FullDiskTest, KeysAreRevokedByAProcessThatOpensTheStoreThen) {
  disk_.fill();
  PackageStore beside(folder_.path(), disk_);
  EXPECT_EQ(beside.read_only_because(), "");
  beside.keys().revoke(key_, 2);
  EXPECT_TRUE(store_.state().keys().list().front().revoked_ns);
}

TEST_F(FullDiskTest, TheBallastIsMadeWhenThereIsRoom) {
  fs::remove(folder_.path() / ".ballast");
  disk_.fill();
  store_.state().keep_ballast();
  EXPECT_FALSE(has_ballast()) << "an empty file would hold nothing";
  fs::remove(folder_.path() / ".ballast");
  std::ofstream(folder_.path() / ".ballast") << "left by a process that was killed";
  FullDisk other;
  PackageStore again(folder_.path(), other);
  again.state().keep_ballast();
  EXPECT_GT(fs::file_size(folder_.path() / ".ballast"), std::uintmax_t{1} << 20U);
}

}  // namespace full_disk_test
}  // namespace stillmap::server
