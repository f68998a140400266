#include "store/single_map_store.hpp"

#include <stillmap/maps/error.hpp>
#include "store/map_name.hpp"
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <fstream>
#include <optional>

#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace single_map_store_test {

namespace fs = std::filesystem;
using ::stillmap::test::memory_folder;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::write_package;

class SingleMapStoreTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_{memory_folder()};
  fs::path package_ = folder_.path() / "My Yard";
  std::string digest_ = write_package(package_, 1);
};

TEST_F(SingleMapStoreTest, HasTheMapActiveWithoutACopy) {
  const SingleMapStore single(package_);
  EXPECT_EQ(single.map(), "my-yard");
  const PackageStore store(single.folder());
  EXPECT_EQ(store.read_only_because(), "");
  EXPECT_EQ(store.state().map("my-yard").active, SingleMapStore::kVersion);
  const auto package = store.open("my-yard", SingleMapStore::kVersion);
  EXPECT_EQ(package->digest(), digest_);
  EXPECT_EQ(fs::canonical(package->folder()), fs::canonical(package_));
  EXPECT_TRUE(verify_store(store).empty());
}

TEST_F(SingleMapStoreTest, IsRemovedAndLeavesThePackage) {
  std::optional<SingleMapStore> single(package_);
  const fs::path folder = single->folder();
  // What a server does at its start and now and then.
  {
    PackageStore store(folder);
    clear_unused(store);
  }
  single.reset();
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_TRUE(maps::MapPackage::open(package_)->verify().empty());
}

TEST_F(SingleMapStoreTest, RefusesWhatIsNoPackageAndLeavesNothing) {
  const fs::path temporary = folder_.path() / "tmp";
  fs::create_directory(temporary);
  ASSERT_EQ(::setenv("TMPDIR", temporary.c_str(), 1), 0);
  const auto opening = [&](const fs::path& path) { return [path] { SingleMapStore store(path); }; };
  EXPECT_THAT(opening(folder_.path() / "none"),
              ThrowsSaying<maps::InputError>({"none", "stillmap build"}));
  EXPECT_THAT(opening(folder_.write("map.tar", "x")), ThrowsSaying<maps::InputError>({"tar xf"}));
  EXPECT_THAT(opening(folder_.path()), ThrowsSaying<maps::InputError>({"manifest.json"}));
  fs::create_directory(folder_.path() / "store");
  { const PackageStore store(folder_.path() / "store"); }
  EXPECT_THAT(opening(folder_.path() / "store"), ThrowsSaying<maps::InputError>({"--store"}));
  EXPECT_TRUE(fs::is_empty(temporary));
  ::unsetenv("TMPDIR");
}

TEST(MapNameOf, IsValidAndNear) {
  EXPECT_EQ(map_name_of("town_2.b-c"), "town_2.b-c");
  EXPECT_EQ(map_name_of("My Yard"), "my-yard");
  EXPECT_EQ(map_name_of("._-x"), "x");
  EXPECT_EQ(map_name_of(std::string(80, 'a')), std::string(63, 'a'));
  EXPECT_EQ(map_name_of("???"), "map");
  EXPECT_EQ(map_name_of(""), "map");
  for (const char* text : {"ä", "Straße", "/", "a/b", "\n"})
    EXPECT_TRUE(is_valid_map_name(map_name_of(text))) << text;
}

TEST(StoreFolder, IsMadeInAFolderThatExists) {
  const TemporaryFolder folder;
  const fs::path store = folder.path() / "store";
  EXPECT_TRUE(PackageStore::make_folder(store / ""));
  EXPECT_TRUE(fs::is_directory(store));
  EXPECT_FALSE(PackageStore::make_folder(store));
  EXPECT_THAT([&] { PackageStore::make_folder(folder.path() / "no" / "store"); },
              ThrowsSaying<maps::StorageError>({"no/store", "No such file"}));
}

}  // namespace single_map_store_test
}  // namespace stillmap::server
