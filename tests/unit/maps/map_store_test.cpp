#include <stillmap/maps/map_store.hpp>

#include <stillmap/maps/error.hpp>

#include <array>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace {

using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

void write_map(const std::filesystem::path& target) {
  MapPackageWriter writer(target);
  const std::array<MapPoint, 1> points{{{1, 2, 3, 0, 1, PointKind::kMeasured, 0}}};
  writer.add_tile({}, points);
  MapManifest manifest;
  manifest.frame_id = "map";
  writer.publish(manifest, "{}");
}

TEST(MapStore, ServesEveryWholePackageByName) {
  const TemporaryFolder folder;
  write_map(folder.path() / "town");
  write_map(folder.path() / "depot-2.a");
  const MapStore store(folder.path());
  EXPECT_THAT(store.names(), ElementsAre("depot-2.a", "town"));
  ASSERT_NE(store.find("town"), nullptr);
  EXPECT_EQ(store.find("town")->tile({}).size(), 1U);
  EXPECT_EQ(store.find("tow"), nullptr);
  EXPECT_EQ(store.find("../town"), nullptr);
  EXPECT_EQ(store.find(""), nullptr);
  EXPECT_TRUE(store.refused().empty());
}

TEST(MapStore, SaysWhyItRefusesAFolder) {
  const TemporaryFolder folder;
  write_map(folder.path() / "town");
  write_map(folder.path() / "Bad Name");
  folder.write("broken/manifest.json", "{");
  folder.write("empty/notes.txt", "");
  folder.write(".town2.partial/manifest.json", "{}");
  folder.write("file.txt", "");
  const MapStore store(folder.path());
  EXPECT_THAT(store.names(), ElementsAre("town"));
  ASSERT_EQ(store.refused().size(), 3U);
  EXPECT_EQ(store.refused()[0].name, "Bad Name");
  EXPECT_THAT(store.refused()[0].reason, HasSubstr("[a-z0-9]"));
  EXPECT_EQ(store.refused()[1].name, "broken");
  EXPECT_THAT(store.refused()[1].reason, HasSubstr("manifest.json"));
  EXPECT_EQ(store.refused()[2].name, "empty");
  EXPECT_THAT(store.refused()[2].reason, HasSubstr("no manifest.json"));
}

TEST(MapStore, NamesAFolderThatIsMissing) {
  const TemporaryFolder folder;
  EXPECT_THAT([&] { MapStore store(folder.path() / "none"); },
              ThrowsSaying<StorageError>({"none", "No such file"}));
}

TEST(MapStore, NamesAreSafeInUrlsAndPaths) {
  EXPECT_TRUE(is_valid_map_name("a"));
  EXPECT_TRUE(is_valid_map_name("0town_2.b-c"));
  EXPECT_TRUE(is_valid_map_name(std::string(63, 'a')));
  for (const std::string& bad : {std::string(), std::string(64, 'a'), std::string(".a"),
                                 std::string("-a"), std::string("a/b"), std::string("A"),
                                 std::string("a b"), std::string("a\0b", 3), std::string("ä")}) {
    EXPECT_FALSE(is_valid_map_name(bad)) << bad;
  }
}

}  // namespace
}  // namespace stillmap::maps
