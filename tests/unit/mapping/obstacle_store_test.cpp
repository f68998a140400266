#include "fusion/obstacle_store.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <vector>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace obstacle_store_test {

using maps::StorageError;
using test::TemporaryFolder;
using test::ThrowsSaying;

/// A wall of voxels along x, at a height that tells it from others.
ScanObstacles wall(float height_m) {
  ScanObstacles scan;
  for (std::uint64_t i = 0; i < 60; ++i)
    scan.voxels.push_back({i, {0.15F * static_cast<float>(i), 4.0F, height_m}, 1});
  return scan;
}

std::vector<Obstacle> around_of(const ObstacleMap& map) {
  std::vector<Obstacle> found;
  for (const Obstacle* each : map.around({4.0, 4.0}, 3.0)) found.push_back(*each);
  return found;
}

void expect_same(const std::vector<Obstacle>& a, const std::vector<Obstacle>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].position, b[i].position) << i;
    EXPECT_EQ(a[i].scans, b[i].scans) << i;
    EXPECT_EQ(a[i].planarity, b[i].planarity) << i;
  }
}

TEST(ObstacleStore, GivesEveryDriveItsOwnObstaclesBack) {
  const TemporaryFolder folder;
  ObstacleStore store(folder.path());
  const std::vector<std::size_t> drives{0, 1, 3};
  for (const std::size_t drive : drives) {
    store.add(drive, wall(1.0F + static_cast<float>(drive)));
    store.add(drive, wall(1.0F + static_cast<float>(drive)));
  }
  store.finish();
  for (const std::size_t drive : {3U, 0U, 1U, 0U}) {
    ObstacleMap alone;
    alone.add(wall(1.0F + static_cast<float>(drive)));
    alone.add(wall(1.0F + static_cast<float>(drive)));
    alone.finish();
    ASSERT_GT(around_of(alone).size(), 30U);
    expect_same(around_of(*store.read(drive)), around_of(alone));
  }
  EXPECT_THROW(static_cast<void>(store.read(2)), std::out_of_range);
}

TEST(ObstacleStore, NeedsNoFileForASingleDriveAndLeavesNoneBehind) {
  const TemporaryFolder folder;
  {
    ObstacleStore store(folder.path());
    store.add(0, wall(1.0F));
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
    store.add(1, wall(1.0F));
    EXPECT_FALSE(std::filesystem::is_empty(folder.path()));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(ObstacleStore, RefusesADriveThatComesBack) {
  const TemporaryFolder folder;
  ObstacleStore store(folder.path());
  store.add(1, wall(1.0F));
  EXPECT_THAT([&] { store.add(0, wall(1.0F)); },
              ThrowsSaying<std::invalid_argument>({"drive 0 after those of drive 1"}));
}

TEST(ObstacleStore, NamesAFolderThatIsNotThereAndAFileThatWasCutShort) {
  const TemporaryFolder folder;
  ObstacleStore nowhere(folder.path() / "missing");
  nowhere.add(0, wall(1.0F));
  EXPECT_THAT([&] { nowhere.add(1, wall(1.0F)); },
              ThrowsSaying<StorageError>({"missing", "No such file"}));
  ObstacleStore cut(folder.path());
  cut.add(0, wall(1.0F));
  cut.add(1, wall(1.0F));
  cut.finish();
  std::filesystem::resize_file(std::filesystem::directory_iterator(folder.path())->path(), 50);
  EXPECT_THAT([&] { static_cast<void>(cut.read(0)); },
              ThrowsSaying<StorageError>({"obstacles", "ends at byte 50"}));
}

}  // namespace obstacle_store_test
}  // namespace stillmap::mapping
