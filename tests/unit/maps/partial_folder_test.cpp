#include <stillmap/maps/error.hpp>
#include <stillmap/maps/partial_folder.hpp>

#include <fstream>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace partial_folder_test {

namespace fs = std::filesystem;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;

TEST(PartialFolder, AppearsOnlyWhenPublished) {
  const TemporaryFolder folder;
  const fs::path target = folder.path() / "map";
  {
    PartialFolder partial(target);
    std::ofstream(partial.path() / "a.txt") << "a";
    EXPECT_FALSE(fs::exists(target));
    partial.publish();
    EXPECT_TRUE(fs::exists(target / "a.txt"));
  }
  EXPECT_TRUE(fs::exists(target / "a.txt"));
  EXPECT_FALSE(fs::exists(folder.path() / ".map.partial"));
}

TEST(PartialFolder, LeavesNothingWhenNotPublished) {
  const TemporaryFolder folder;
  {
    const PartialFolder partial(folder.path() / "map");
    std::ofstream(partial.path() / "a.txt") << "a";
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(PartialFolder, ClearsWhatAKilledProcessLeft) {
  const TemporaryFolder folder;
  folder.write(".map.partial/tiles/old.bin", "old");
  PartialFolder partial(folder.path() / "map");
  EXPECT_TRUE(fs::is_empty(partial.path()));
}

TEST(PartialFolder, KeepsOneFolderThatAKilledProcessLeftAndNeverPublishesIt) {
  const TemporaryFolder folder;
  folder.write(".map.partial/tiles/old.bin", "old");
  folder.write(".map.partial/journal/work", "work");
  PartialFolder partial(folder.path() / "map", "journal");
  EXPECT_FALSE(fs::exists(partial.path() / "tiles"));
  EXPECT_TRUE(fs::exists(partial.path() / "journal/work"));
  std::ofstream(partial.path() / "a.txt") << "a";
  partial.publish();
  EXPECT_TRUE(fs::exists(folder.path() / "map/a.txt"));
  EXPECT_FALSE(fs::exists(folder.path() / "map/journal"));
}

TEST(PartialFolder, LeavesTheSurvivorAloneWhenNotPublished) {
  const TemporaryFolder folder;
  folder.write(".map.partial/journal/work", "work");
  {
    const PartialFolder partial(folder.path() / "map", "journal");
    folder.write(".map.partial/tiles/0", "tile");
  }
  EXPECT_TRUE(fs::exists(folder.path() / ".map.partial/journal/work"));
  EXPECT_FALSE(fs::exists(folder.path() / ".map.partial/tiles"));
}

TEST(PartialFolder, LeavesNothingWhenNotPublishedAndTheSurvivorIsGone) {
  const TemporaryFolder folder;
  folder.write(".map.partial/journal/work", "work");
  {
    const PartialFolder partial(folder.path() / "map", "journal");
    fs::remove_all(partial.path() / "journal");
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(PartialFolder, KeepsNoLinkForASurvivor) {
  const TemporaryFolder folder;
  folder.write("other/work", "work");
  folder.write(".map.partial/x", "x");
  fs::create_directory_symlink(folder.path() / "other", folder.path() / ".map.partial/journal");
  {
    const PartialFolder partial(folder.path() / "map", "journal");
    EXPECT_TRUE(fs::is_empty(partial.path()));
  }
  EXPECT_TRUE(fs::exists(folder.path() / "other/work"));
}

TEST(PartialFolder, RefusesASecondWriterOfTheSameTarget) {
  const TemporaryFolder folder;
  PartialFolder first(folder.path() / "map");
  std::ofstream(first.path() / "a.txt") << "a";
  EXPECT_THAT([&] { PartialFolder second(folder.path() / "map"); },
              ThrowsSaying<InputError>({".map.partial", "another process"}));
  first.publish();
  EXPECT_TRUE(fs::exists(folder.path() / "map/a.txt"));
}

TEST(PartialFolder, RefusesAnExistingTarget) {
  const TemporaryFolder folder;
  folder.write("map/manifest.json", "{}");
  EXPECT_THAT([&] { PartialFolder partial(folder.path() / "map/"); },
              ThrowsSaying<InputError>({"map", "existing"}));
  PartialFolder partial(folder.path() / "late");
  folder.write("late/x", "x");
  EXPECT_THAT([&] { partial.publish(); }, ThrowsSaying<InputError>({"late", "existing"}));
}

TEST(PartialFolder, NamesAParentThatIsMissing) {
  const TemporaryFolder folder;
  EXPECT_THAT([&] { PartialFolder partial(folder.path() / "none/map"); },
              ThrowsSaying<StorageError>({"none", "No such file"}));
}

}  // namespace partial_folder_test
}  // namespace stillmap::maps
