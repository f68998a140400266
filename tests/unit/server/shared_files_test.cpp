// Versions of a map whose files are the same take room for them once.
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/store_contents.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace shared_files_test {

namespace fs = std::filesystem;
using ::testing::IsEmpty;

void spoil(const fs::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekp(3000);
  stream.put('\x55');
  ASSERT_TRUE(stream.good()) << file;
}

class SharedFilesTest : public ::testing::Test {
 protected:
  SharedFilesTest() {
    fs::create_directory(store_folder_);
    for (const int seed : {1, 2})
      (void)test::write_sharing_package(folder_.path() / std::to_string(seed), seed);
  }
  [[nodiscard]] fs::path pack(const std::string& digest, maps::TileId tile) const {
    const fs::path package = store_folder_ / "packages" / digest;
    return package / test::pack_of(package, tile);
  }
  PackageStore::Added add(PackageStore& store, int seed) const {
    return store.add("town", "v" + std::to_string(seed), folder_.path() / std::to_string(seed));
  }

  test::TemporaryFolder folder_;
  test::UnsyncedCalls calls_;
  fs::path store_folder_ = folder_.path() / "store";
};

TEST_F(SharedFilesTest, ASecondVersionHasTheFilesOfTheFirst) {
  PackageStore store(store_folder_, calls_);
  const std::string first = add(store, 1).version.digest, second = add(store, 2).version.digest;
  ASSERT_NE(first, second);
  EXPECT_TRUE(fs::equivalent(pack(first, test::kSharedTile), pack(second, test::kSharedTile)));
  EXPECT_FALSE(fs::equivalent(pack(first, test::kOwnTile), pack(second, test::kOwnTile)));
  // Nothing of the folder that it came from is in the store.
  EXPECT_FALSE(fs::equivalent(
      pack(second, test::kSharedTile),
      folder_.path() / "2" / test::pack_of(folder_.path() / "2", test::kSharedTile)));
  // Each stays whole without the other.
  store.remove("town", "v1");
  EXPECT_THAT(store.open("town", "v2")->verify(), IsEmpty());
}

TEST_F(SharedFilesTest, SoHasOneThatComesAsAnArchive) {
  PackageStore store(store_folder_, calls_);
  const std::string first = add(store, 1).version.digest;
  const std::string tar = test::tar_of(folder_.path() / "2", "") + test::tar_end();
  std::size_t at = 0;
  const ByteSource source = [&](std::span<char> to) {
    const std::size_t size = std::min(to.size(), tar.size() - at);
    std::copy_n(tar.data() + at, size, to.data());
    at += size;
    return size;
  };
  const auto added = store.add_archive("town", "v2", {source, "body"});
  EXPECT_TRUE(fs::equivalent(pack(first, test::kSharedTile),
                             pack(added.version.digest, test::kSharedTile)));
  EXPECT_THAT(store.open("town", "v2")->verify(), IsEmpty());
}

TEST_F(SharedFilesTest, WhatAVersionHasNeedNotBeSentAgain) {
  PackageStore store(store_folder_, calls_);
  const std::string first = add(store, 1).version.digest;
  PackageArchive delta(folder_.path() / "2", folder_.path() / "1");
  PackageArchive whole(folder_.path() / "2");
  EXPECT_LT(delta.size(), 0.7 * static_cast<double>(whole.size()));
  EXPECT_NE(delta.etag(), whole.etag());
  const auto send = [&](const std::string& map, PackageArchive& archive) {
    std::uint64_t at = 0;
    const ByteSource source = [&](std::span<char> to) {
      const std::size_t got = archive.read(at, to);
      at += got;
      return got;
    };
    return store.add_archive(map, "v2", {source, "body"});
  };
  const auto added = send("town", delta);
  EXPECT_EQ(added.version.digest, whole.digest());
  EXPECT_TRUE(
      fs::equivalent(pack(first, test::kSharedTile), pack(whole.digest(), test::kSharedTile)));
  EXPECT_THAT(store.open("town", "v2")->verify(), IsEmpty());
  // Another map's files are none of this one's.
  EXPECT_THAT([&] { send("yard", delta); },
              test::ThrowsSaying<maps::InputError>({"packs/", "nothing", "copy it whole"}));
}

TEST_F(SharedFilesTest, WhatIsDamagedMustBeSent) {
  PackageStore store(store_folder_, calls_);
  spoil(pack(add(store, 1).version.digest, test::kSharedTile));
  PackageArchive delta(folder_.path() / "2", folder_.path() / "1");
  std::uint64_t at = 0;
  const ByteSource source = [&](std::span<char> to) {
    const std::size_t got = delta.read(at, to);
    at += got;
    return got;
  };
  EXPECT_THROW((void)store.add_archive("town", "v2", {source, "body"}), maps::InputError);
  EXPECT_FALSE(store.state().find_version("town", "v2"));
}

TEST_F(SharedFilesTest, DamagedFilesAreNotTaken) {
  PackageStore store(store_folder_, calls_);
  const std::string first = add(store, 1).version.digest;
  spoil(pack(first, test::kSharedTile));
  const std::string second = add(store, 2).version.digest;
  EXPECT_FALSE(fs::equivalent(pack(first, test::kSharedTile), pack(second, test::kSharedTile)));
  EXPECT_THAT(store.open("town", "v2")->verify(), IsEmpty());
  // The damaged version is mended by adding it again, from its own folder and the whole one.
  (void)add(store, 1);
  EXPECT_THAT(store.open("town", "v1")->verify(), IsEmpty());
  EXPECT_TRUE(fs::equivalent(pack(first, test::kSharedTile), pack(second, test::kSharedTile)));
}

}  // namespace shared_files_test
}  // namespace stillmap::server
