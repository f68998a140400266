#include "mirror/map_mirror.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace mirror_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::IsEmpty;

/// Serves a package of this disk, as well or badly as it is told.
class FakeSource final : public MirrorSource {
 public:
  Active active(const std::string&) override { return {version, digest}; }
  std::vector<MapSignature> signatures(const std::string&, const std::string&) override {
    return signed_by;
  }
  void read(const File& file, std::uint64_t offset, const Take& take) override {
    PackageArchive archive(package);
    const auto place = archive.place_of(file.sha256);
    if (!place) throw MirrorSourceError("no such file");
    std::vector<char> piece(1000);
    for (std::uint64_t at = offset; at < place->bytes;) {
      if (cut_after && given >= *cut_after) throw MirrorSourceError("connection lost");
      const std::size_t size = std::min<std::uint64_t>(piece.size(), place->bytes - at);
      archive.read(place->offset + at, std::span(piece).first(size));
      if (spoils && at > 5000) piece[0] = static_cast<char>(piece[0] ^ 1);
      given += size;
      at += size;
      if (!take({piece.data(), size})) return;
    }
  }

  std::string version, digest;
  fs::path package;
  std::uint64_t given = 0;
  std::optional<std::uint64_t> cut_after;
  bool spoils = false;
  std::vector<MapSignature> signed_by;
};

class MirrorTest : public ::testing::Test {
 protected:
  MirrorTest() {
    fs::create_directory(store_folder_);
    for (const int seed : {1, 2})
      digests_.push_back(test::write_sharing_package(folder_.path() / std::to_string(seed), seed));
    serve(1);
  }
  void serve(int seed) {
    source_.version = "v" + std::to_string(seed);
    source_.digest = digests_[static_cast<std::size_t>(seed - 1)];
    source_.package = folder_.path() / std::to_string(seed);
    source_.given = 0;
  }
  std::optional<MirrorResult> mirror(const MirrorOptions& options = {"town", {}, {}},
                                     const MirrorProgress& progress = {}) {
    PackageStore store(store_folder_, calls_);
    return mirror_map(store, source_, options, progress, cancel_);
  }
  /// The active version, whole; empty without one.
  [[nodiscard]] std::string active() {
    PackageStore store(store_folder_, calls_);
    for (const StoredMap& map : store.state().maps()) {
      if (!map.active) continue;
      EXPECT_THAT(store.open(map.name, *map.active)->verify(), IsEmpty());
      return *map.active;
    }
    return {};
  }

  test::TemporaryFolder folder_;
  test::UnsyncedCalls calls_;
  fs::path store_folder_ = folder_.path() / "store";
  std::vector<std::string> digests_;
  FakeSource source_;
  std::atomic<bool> cancel_{false};
};

TEST_F(MirrorTest, FetchesAVersionAndOfTheNextOneWhatIsMissing) {
  const auto first = mirror();
  ASSERT_TRUE(first);
  EXPECT_TRUE(first->is_new);
  EXPECT_EQ(active(), "v1");
  const std::uint64_t whole = first->bytes_fetched;
  EXPECT_GE(whole, first->bytes);
  EXPECT_FALSE(mirror()->is_new);
  serve(2);
  const auto second = mirror();
  EXPECT_EQ(second->digest, digests_[1]);
  EXPECT_LT(second->bytes_fetched, 0.7 * static_cast<double>(whole));
  EXPECT_EQ(active(), "v2");
  EXPECT_FALSE(fs::exists(store_folder_ / "mirror"));
}

TEST_F(MirrorTest, GoesOnWhereTheConnectionWasLost) {
  std::uint64_t given = 0;
  for (int tries = 0; tries < 40 && active().empty(); ++tries) {
    source_.given = 0;
    source_.cut_after = 20'000;
    try {
      (void)mirror();
    } catch (const MirrorSourceError&) {
    }
    given += source_.given;
  }
  EXPECT_EQ(active(), "v1");
  std::uint64_t bytes = 0;
  const auto package = maps::MapPackage::open(source_.package);
  for (const auto& [path, file] : package->manifest().files) bytes += file.bytes;
  // Nothing was fetched twice but the manifest at worst.
  EXPECT_LT(given, bytes + 40 * 2000);
}

TEST_F(MirrorTest, KeepsNoByteThatWasChangedOnItsWay) {
  source_.spoils = true;
  EXPECT_THAT([&] { (void)mirror(); },
              ThrowsSaying<maps::InputError>({"other bytes than those of SHA-256", "try again"}));
  EXPECT_EQ(active(), "");
  for (const auto& entry : fs::recursive_directory_iterator(store_folder_ / "mirror"))
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
  source_.spoils = false;
  EXPECT_TRUE(mirror()->is_new);
  EXPECT_EQ(active(), "v1");
}

TEST_F(MirrorTest, FetchesOnlyThePartThatIsAskedFor) {
  const auto whole = maps::MapPackage::open(source_.package);
  ASSERT_GT(whole->regions().size(), 1U);
  const maps::RegionId kept = whole->regions().front();
  const Eigen::Vector2d place = whole->manifest().origin.head<2>() +
                                maps::kRegionSizeM * Eigen::Vector2d(kept.x + 0.5, kept.y + 0.5);
  MirrorOptions options{.map = "town"};
  options.around = {place, 10.0};
  const auto first = mirror(options);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->regions, 1U);
  EXPECT_EQ(first->digest, digests_[0]) << "of the whole";
  EXPECT_EQ(active().substr(0, 8), "v1.part-");
  {
    PackageStore store(store_folder_, calls_);
    const auto part = store.open("town", active());
    EXPECT_EQ(part->regions(), std::vector{kept});
    EXPECT_EQ(part->tile(test::kSharedTile).size(), whole->tile(test::kSharedTile).size());
  }
  EXPECT_FALSE(mirror(options)->is_new);
  serve(2);
  EXPECT_TRUE(mirror(options)->is_new);
  EXPECT_EQ(active().substr(0, 8), "v2.part-");
  options.around->place_map_m.x() -= 1e6;
  EXPECT_THAT([&] { (void)mirror(options); },
              ThrowsSaying<maps::InputError>({"nothing within 10 m", "map frame"}));
}

TEST_F(MirrorTest, RefusesWhatNoTrustedKeyHasSignedBeforeItIsFetched) {
  const SigningKey key = SigningKey::make(), other = SigningKey::make();
  MirrorOptions options{.map = "town"};
  options.trusted = PublicKeys{key.public_key()};
  const auto refused = ThrowsSaying<maps::InputError>({"none by a trusted key", "keys sign"});
  EXPECT_THAT([&] { (void)mirror(options); }, refused);
  source_.signed_by = {sign_map(other, "town", source_.digest)};
  EXPECT_THAT([&] { (void)mirror(options); }, refused);
  source_.signed_by = {sign_map(key, "depot", source_.digest)};
  EXPECT_THAT([&] { (void)mirror(options); }, refused) << "another map's";
  source_.signed_by = {sign_map(key, "town", digests_[1])};
  EXPECT_THAT([&] { (void)mirror(options); }, refused) << "another package's";
  EXPECT_EQ(source_.given, 0U);
  EXPECT_EQ(active(), "");
  source_.signed_by = {sign_map(key, "town", source_.digest)};
  EXPECT_TRUE(mirror(options)->is_new);
  PackageStore store(store_folder_, calls_);
  EXPECT_EQ(store.signatures().of("town", source_.digest), source_.signed_by)
      << "so that others may take it from here";
}

TEST_F(MirrorTest, FetchesAllWhereTheVersionBeforeIsDamagedHere) {
  (void)mirror();
  const fs::path package = store_folder_ / "packages" / digests_[0];
  const fs::path pack = package / test::pack_of(package, test::kSharedTile);
  std::fstream file(pack, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(3000);
  file.put('\x55');
  file.close();
  serve(2);
  (void)mirror();
  EXPECT_EQ(active(), "v2");
}

TEST_F(MirrorTest, RefusesAVersionThatIsTooLargeBeforeItIsFetched) {
  EXPECT_THAT(
      [&] {
        (void)mirror({"town", {}, 10'000});
      },
      ThrowsSaying<maps::InputError>({"town/v1", "at most 10000"}));
  EXPECT_LT(source_.given, 10'000U);
  EXPECT_THROW((void)mirror({"Town", {}, {}}), std::invalid_argument);
}

TEST_F(MirrorTest, IsCancelledAndGoesOn) {
  const MirrorProgress cancels = [&](std::uint64_t done, std::uint64_t) {
    if (done > 10'000) cancel_ = true;
  };
  EXPECT_FALSE(mirror({"town", {}, {}}, cancels));
  EXPECT_EQ(active(), "");
  cancel_ = false;
  EXPECT_TRUE(mirror()->is_new);
}

TEST_F(MirrorTest, KeepsToARate) {
  const auto began = std::chrono::steady_clock::now();
  const auto result = mirror({"town", 400'000, {}});
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  // Never faster; how much slower is the machine's.
  EXPECT_GE(took.count(), static_cast<double>(result->bytes_fetched) / 400'000 - 0.01);
}

}  // namespace mirror_test
}  // namespace stillmap::server
