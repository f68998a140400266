#include "fusion/obstacle_store.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
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

std::vector<Obstacle> around_of(const ObstacleStore& store, std::size_t drive) {
  std::vector<Obstacle> found;
  const ObstacleMap map = store.around(drive, {4.0, 4.0}, 3.0);
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
    ObstacleStore alone(folder.path());
    alone.add(0, wall(1.0F + static_cast<float>(drive)));
    alone.add(0, wall(1.0F + static_cast<float>(drive)));
    alone.finish();
    ASSERT_GT(around_of(alone, 0).size(), 30U);
    expect_same(around_of(store, drive), around_of(alone, 0));
  }
  EXPECT_THAT(around_of(store, 2), testing::IsEmpty());
}

/// Voxels of a field of 60 m by 60 m, some of them again in later scans.
std::vector<ScanObstacles> many_scans() {
  std::vector<ScanObstacles> scans(30);
  for (std::size_t scan = 0; scan < scans.size(); ++scan) {
    for (std::int64_t i = 0; i < 900; ++i) {
      const auto number = static_cast<std::int64_t>((scan * 211 + 1) * 7 + 13 * i);
      const std::int64_t x = number % 400 - 100, y = number * 31 % 400 - 100, z = number % 9;
      // In parts of 64, so that sums are exact in any order.
      const Eigen::Vector3f p =
          0.15F *
              Eigen::Vector3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)) +
          Eigen::Vector3f::Constant(0.07F);
      scans[scan].voxels.push_back(
          {maps::signed_cell_key(x, y, z), (p * 64.0F).array().round().matrix() / 64.0F, 1});
    }
  }
  return scans;
}

TEST(ObstacleStore, HoldsTheSameObstaclesWhateverGoesToTheFileOnTheWay) {
  const TemporaryFolder folder;
  ObstacleStore whole(folder.path()), spilled(folder.path(), 1500);
  for (const ScanObstacles& scan : many_scans()) {
    whole.add(0, scan);
    spilled.add(0, scan);
  }
  whole.finish();
  spilled.finish();
  const auto all = [](const ObstacleStore& store) {
    std::vector<Obstacle> found;
    const ObstacleMap map = store.around(0, {15.0, 15.0}, 100.0);
    for (const Obstacle* each : map.around({15.0, 15.0}, 100.0)) found.push_back(*each);
    return found;
  };
  ASSERT_GT(all(whole).size(), 3000U);
  const std::vector<Obstacle> obstacles = all(whole);
  EXPECT_TRUE(std::any_of(obstacles.begin(), obstacles.end(),
                          [](const Obstacle& each) { return each.scans > 1; }));
  expect_same(all(spilled), all(whole));
}

TEST(ObstacleStore, LeavesNoFileBehind) {
  const TemporaryFolder folder;
  {
    ObstacleStore store(folder.path());
    store.add(0, wall(1.0F));
    store.finish();
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
  EXPECT_THAT(
      [&] {
        static_cast<void>(cut.around(0, {4.0, 4.0}, 3.0));
      },
      ThrowsSaying<StorageError>({"obstacles", "ends at byte"}));
}

}  // namespace obstacle_store_test
}  // namespace stillmap::mapping
