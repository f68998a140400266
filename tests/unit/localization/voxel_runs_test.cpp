#include "index/voxel_runs.hpp"

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <vector>

namespace stillmap::localization {
namespace voxel_runs_test {

TEST(VoxelRuns, AreVisitedByLevelInTheOrderOfAll) {
  const test::TemporaryFolder folder;
  for (const std::filesystem::path& where : {folder.path(), std::filesystem::path()}) {
    VoxelRuns runs(where);
    EXPECT_TRUE(runs.empty());
    test::Random random(3);
    std::array<std::set<CellBlocks::Place>, 2> all;
    for (std::size_t n = 0; n < 12; ++n) {
      const std::size_t level = n % 2;
      std::set<CellBlocks::Place> run;
      // One of them is empty.
      for (std::size_t k = 0; k < 8000 * (n % 5); ++k) {
        const CellBlocks::Place place{static_cast<std::uint64_t>(random.uniform(0.0, 1e5)),
                                      static_cast<std::uint32_t>(random.uniform(0.0, 64.0))};
        if (all[level].insert(place).second) run.insert(place);
      }
      runs.begin_run(level);
      for (const CellBlocks::Place& place : run) {
        Voxel voxel{};
        voxel.mean = voxel.axis0 = voxel.axis1 = Eigen::Vector3f::Zero();
        voxel.points = static_cast<std::uint32_t>(64 * place.block + place.bit);
        runs.add(place, voxel);
      }
    }
    EXPECT_FALSE(runs.empty());
    for (std::size_t level = 0; level < all.size(); ++level) {
      EXPECT_EQ(runs.size(level), all[level].size());
      std::vector<CellBlocks::Place> visited;
      runs.for_each(level, [&](const CellBlocks::Place& place, const Voxel& voxel) {
        visited.push_back(place);
        ASSERT_EQ(voxel.points, 64 * place.block + place.bit);
      });
      EXPECT_EQ(visited, std::vector(all[level].begin(), all[level].end()));
    }
    EXPECT_EQ(runs.size(2), 0U);
  }
}

}  // namespace voxel_runs_test
}  // namespace stillmap::localization
