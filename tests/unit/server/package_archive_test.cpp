#include "store/package_archive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "store/tar_header.hpp"
#include "support/disk_calls.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace package_archive_test {

namespace fs = std::filesystem;
using namespace ::stillmap::test;

std::string bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::string range_of(PackageArchive& archive, std::uint64_t offset, std::size_t size) {
  std::string bytes(size, '?');
  bytes.resize(archive.read(offset, bytes));
  return bytes;
}

std::string all_of(PackageArchive& archive) {
  return range_of(archive, 0, static_cast<std::size_t>(archive.size()));
}

/// A package of several tiles, with a file in a folder of its own.
std::string write_town(const fs::path& target, int seed = 1) {
  maps::MapPackageWriter writer(target);
  for (std::int32_t x = 0; x < 5; ++x) {
    const std::vector<maps::MapPoint> points(
        static_cast<std::size_t>(20 + 100 * x),
        {static_cast<float>(seed), 1, 2, 0, 1, maps::PointKind::kMeasured, 0});
    writer.add_tile({0, x, -x}, points);
  }
  fs::create_directories(writer.folder() / "more" / "deep");
  std::ofstream(writer.folder() / "more" / "deep" / "notes.txt") << "notes";
  std::ofstream(writer.folder() / "empty.txt");
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  return writer.publish(manifest, R"({"host":"here"})");
}

class PackageArchiveTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_{memory_folder()};
  fs::path town_ = folder_.path() / "town";
  std::string digest_ = write_town(town_);
};

TEST_F(PackageArchiveTest, AnyRangeIsThatOfTheWhole) {
  PackageArchive archive(town_);
  const std::string whole = all_of(archive);
  ASSERT_EQ(whole.size(), archive.size());
  EXPECT_EQ(archive.size() % 512, 0U);
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    const std::size_t from = random() % (whole.size() + 100);
    const std::size_t size = random() % (i % 2 == 0 ? 40U : 5000U);
    ASSERT_EQ(range_of(archive, from, size), from < whole.size() ? whole.substr(from, size) : "");
  }
  std::string bytewise;
  for (std::size_t at = 0; at < whole.size(); ++at) bytewise += range_of(archive, at, 1);
  EXPECT_EQ(bytewise, whole);
}

TEST_F(PackageArchiveTest, EqualPackagesGiveEqualBytes) {
  const fs::path same = folder_.path() / "same";
  ASSERT_EQ(write_town(same), digest_);
  std::ofstream(same / "build.json") << "another host and time";
  std::ofstream(same / "beside") << "not listed";
  PackageArchive archive(town_);
  PackageArchive again(same);
  EXPECT_EQ(all_of(archive), all_of(again));
  EXPECT_EQ(archive.etag(), again.etag());
  EXPECT_EQ(archive.etag(), '"' + digest_ + "-tar1\"");
  write_town(folder_.path() / "other", 2);
  EXPECT_NE(PackageArchive(folder_.path() / "other").etag(), archive.etag());
}

/// The entity tag promises these bytes: a change of them must change `kLayout`.
TEST_F(PackageArchiveTest, HasTheBytesThatItsTagStandsFor) {
  EXPECT_EQ(maps::sha256_of(tar_header("manifest.json", 1234)),
            "347cc24979c0f278eca39201d2182966a9220790ea1617bbeea4d0afa2b66fc4");
  EXPECT_EQ(tar_header("a", 1).size(), 512U);
  EXPECT_EQ(tar_header(std::string(90, 'p') + "/" + std::string(90, 'n'), 1).size(), 512U);
  EXPECT_GT(tar_header(std::string(300, 'n'), 1).size(), 512U);
  EXPECT_GT(tar_header("large", std::uint64_t{9} << 30U).size(), 512U);
}

TEST_F(PackageArchiveTest, KnowsTheSizeOfAHeaderWithoutMakingIt) {
  for (const std::size_t length : {1U, 99U, 100U, 101U, 180U, 256U, 400U})
    for (const std::uint64_t bytes : {std::uint64_t{0}, (std::uint64_t{1} << 33U) - 1,
                                      std::uint64_t{1} << 33U, std::uint64_t{1} << 40U})
      for (const char letter : {'n', ' ', '\x7e'}) {
        const std::string path(length, letter);
        EXPECT_EQ(tar_header_bytes(path, bytes), tar_header(path, bytes).size()) << path << bytes;
      }
}

TEST_F(PackageArchiveTest, IsUnpackedByTar) {
  PackageArchive archive(town_);
  folder_.write("town.tar", all_of(archive));
  const std::string there = (folder_.path() / "there").string();
  fs::create_directory(there);
  const std::string command = "tar xf " + (folder_.path() / "town.tar").string() + " -C " + there;
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(maps::MapPackage::open(there)->digest(), digest_);
  EXPECT_EQ(maps::MapPackage::open(there)->verify().size(), 0U);
  EXPECT_FALSE(fs::exists(fs::path(there) / "build.json"));
}

TEST_F(PackageArchiveTest, SaysWhenAFileIsGoneOrAnother) {
  PackageArchive archive(town_);
  const std::string whole = all_of(archive);
  const std::string pack = test::pack_of(town_, {0, 1, -1});
  fs::resize_file(town_ / pack, 10);
  PackageArchive cut(town_);
  EXPECT_THAT([&] { all_of(cut); }, ThrowsSaying<maps::StorageError>({pack, "bytes any more"}));
  fs::remove_all(town_);
  EXPECT_THAT([&] { range_of(archive, 8000, 20'000); }, ThrowsSaying<maps::StorageError>({"town"}));
  EXPECT_THAT([&] { (void)PackageArchive{town_}; },
              ThrowsSaying<maps::StorageError>({"manifest.json"}));
}

TEST_F(PackageArchiveTest, RefusesNamesThatNoArchiveMayHold) {
  const fs::path odd = folder_.path() / "odd";
  maps::MapPackageWriter writer(odd);
  std::ofstream(writer.folder() / "\xc3\xbc.txt") << "x";
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  writer.publish(manifest, "{}");
  EXPECT_THAT([&] { PackageArchive{odd}; },
              ThrowsSaying<maps::InputError>({"odd", "printable ASCII"}));
}

class StoreArchiveTest : public PackageArchiveTest {
 protected:
  PackageStore::Added add(const std::string& tar, const std::string& version = "1",
                          const std::optional<std::string>& sha256 = {}) {
    return store_.add_archive("town", version, {source_of(tar, 5000), "body"}, sha256);
  }
  [[nodiscard]] std::string tar() const {
    PackageArchive archive(town_);
    return all_of(archive);
  }
  void expect_refused(const std::string& tar, const std::vector<std::string>& saying) {
    EXPECT_THAT([&] { add(tar); }, ThrowsSaying<maps::InputError>(saying));
    EXPECT_TRUE(fs::is_empty(packages_));
    EXPECT_FALSE(store_.state().find_version("town", "1").has_value());
  }
  /// The package's files, but this one, with this in front of their names.
  [[nodiscard]] std::string entries(const std::string& prefix, const std::string& but = {}) const {
    std::string entries;
    for (const auto& entry : fs::recursive_directory_iterator(town_)) {
      const std::string path = entry.path().lexically_relative(town_);
      if (entry.is_regular_file() && path != but)
        entries += tar_file(prefix + path, bytes_of(entry.path()));
    }
    return entries;
  }
  static fs::path made(const fs::path& folder) {
    fs::create_directory(folder);
    return folder;
  }

  UnsyncedCalls calls_;
  PackageStore store_{made(folder_.path() / "store"), calls_};
  fs::path packages_ = folder_.path() / "store" / "packages";
};

TEST_F(StoreArchiveTest, TakesBackWhatItGives) {
  const PackageStore::Added added = add(tar());
  EXPECT_TRUE(added.is_new);
  EXPECT_EQ(added.version.digest, digest_);
  EXPECT_TRUE(verify_store(store_).empty());
  const std::unique_ptr<PackageArchive> again = store_.archive("town", "1");
  EXPECT_EQ(all_of(*again), tar());
  EXPECT_FALSE(add(all_of(*again)).is_new);
  EXPECT_TRUE(add(packed(tar(), Packing::kZstd), "2").is_new);
  EXPECT_EQ(added.version.bytes, store_.add("town", "3", town_).version.bytes);
  EXPECT_EQ(unnamed_packages(store_).size(), 0U);
  EXPECT_EQ(clear_unused(store_).leftovers, 0U);
  EXPECT_THAT([&] { (void)store_.archive("town", "9"); }, ::testing::Throws<StoreRefusal>());
}

// Each sync of a file waits for the disk, and a small archive holds many files.
TEST_F(StoreArchiveTest, WaitsForTheDiskForFilesOfThePackageAlone) {
  test::RecordingCalls calls;
  PackageStore store(made(folder_.path() / "recorded"), calls);
  std::string files;
  for (int i = 0; i < 100; ++i) files += tar_file("stray/" + std::to_string(i), "");
  const auto is_stray = [](const test::RecordedCall& call) {
    return call.path.string().find("/stray") != std::string::npos;
  };
  const auto syncs = [&] {
    return std::count_if(calls.calls().begin(), calls.calls().end(), [&](const auto& call) {
      return is_stray(call) &&
             (call.kind == DiskCall::Kind::kSyncFile || call.kind == DiskCall::Kind::kSyncFolder);
    });
  };
  EXPECT_THROW(store.add_archive("town", "1", {source_of(files + tar_end()), "body"}),
               maps::InputError);
  store.add_archive("town", "1", {source_of(files + tar()), "body"});
  EXPECT_GT(std::count_if(calls.calls().begin(), calls.calls().end(), is_stray), 200);
  EXPECT_EQ(syncs(), 0);
  for (const auto& entry : fs::recursive_directory_iterator(town_)) {
    const std::string path = "/" + entry.path().lexically_relative(town_).string();
    EXPECT_TRUE(!entry.is_regular_file() || path == "/build.json" ||
                std::any_of(calls.calls().begin(), calls.calls().end(),
                            [&](const auto& call) {
                              return call.kind == DiskCall::Kind::kSyncFile &&
                                     call.path.string().ends_with(path);
                            }))
        << path;
  }
}

TEST_F(StoreArchiveTest, TakesAPackageInAFolderAndDropsTheRest) {
  add(tar_folder("town/") + entries("town/") + tar_file("town/stray/a", "x") +
      tar_folder("town/packs/more/") + tar_file("town/packs/1.pack", "x") +
      tar_file("beside.txt", "x") + tar_file("other/packs", "x") + tar_end());
  EXPECT_TRUE(verify_store(store_).empty());
  std::vector<std::string> found;
  for (const auto& entry : fs::recursive_directory_iterator(packages_ / digest_))
    found.push_back(entry.path().lexically_relative(packages_ / digest_));
  EXPECT_THAT(
      found, ::testing::UnorderedElementsAre("build.json", "empty.txt", "manifest.json", "more",
                                             "more/deep", "more/deep/notes.txt", "packs",
                                             test::pack_of(town_), test::pack_of(town_, {0, 1, -1}),
                                             "regions", "regions/0_0.node", "regions/0_-1.node"));
  EXPECT_EQ(std::distance(fs::directory_iterator(packages_), fs::directory_iterator()), 1);
}

TEST_F(StoreArchiveTest, RefusesWhatIsNotWhatItsManifestSays) {
  expect_refused(tar_end(), {"body", "no manifest.json"});
  expect_refused(entries("a/b/") + tar_end(), {"no manifest.json"});
  expect_refused(entries("a/") + entries("b/") + tar_end(), {"several map packages"});
  const std::string pack = test::pack_of(town_, {0, 2, -2});
  expect_refused(entries("", pack) + tar_end(), {"body: " + pack, "nothing"});
  const std::string rest = entries("", "more/deep/notes.txt");
  expect_refused(rest + tar_file("more/deep/notes.txt", "note") + tar_end(),
                 {"4 bytes", "5 as in"});
  expect_refused(rest + tar_file("more/deep/notes.txt", "NOTES") + tar_end(),
                 {"notes.txt", "SHA-256"});
  expect_refused(rest + tar_folder("more/deep/notes.txt") + tar_end(), {"notes.txt", "nothing"});
  expect_refused(entries("", "manifest.json") + tar_file("manifest.json", "{}") + tar_end(),
                 {"body: manifest.json"});
  expect_refused(entries("", "build.json") +
                     tar_file("build.json", std::string((16U << 20U) + 1, ' ')) + tar_end(),
                 {"build.json", "at most"});
  expect_refused(tar().substr(0, 9000), {"body"});
  expect_refused(tar_file("../evil", "x") + tar(), {"body: entry '../evil'"});
}

TEST_F(StoreArchiveTest, ComparesTheSha256OfTheBody) {
  const std::string body = packed(tar(), Packing::kGzip);
  EXPECT_THAT(
      [&] { add(body, "1", maps::sha256_of(tar())); },
      ThrowsSaying<maps::InputError>({"body", maps::sha256_of(body), maps::sha256_of(tar())}));
  EXPECT_TRUE(fs::is_empty(packages_));
  EXPECT_TRUE(add(body, "1", maps::sha256_of(body)).is_new);
}

TEST_F(StoreArchiveTest, RefusesAnotherPackageOfThatName) {
  add(tar());
  write_town(folder_.path() / "other", 2);
  PackageArchive other(folder_.path() / "other");
  EXPECT_THAT([&] { add(all_of(other)); },
              ::testing::Throws<StoreRefusal>(
                  ::testing::Property(&StoreRefusal::reason, StoreRefusal::Reason::kOtherDigest)));
  EXPECT_EQ(unnamed_packages(store_).size(), 0U);
  EXPECT_EQ(std::distance(fs::directory_iterator(packages_), fs::directory_iterator()), 1);
  EXPECT_THROW(store_.add_archive("Town", "1", {source_of(tar()), "body"}), std::invalid_argument);
}

TEST_F(StoreArchiveTest, ADownloadSaysThatItsVersionWasRemoved) {
  add(tar());
  const std::unique_ptr<PackageArchive> download = store_.archive("town", "1");
  store_.remove("town", "1");
  EXPECT_THAT([&] { all_of(*download); },
              ThrowsSaying<maps::StorageError>({"packages", "No such file"}));
}

}  // namespace package_archive_test
}  // namespace stillmap::server
