#include "index/map_level.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include <support/synthetic_world.hpp>

namespace stillmap::localization {
namespace map_level_test {

constexpr int kTileShift = 3;
constexpr float kEdgeM = 0.5F;
constexpr float kFloorM2 = 0.01F;

Eigen::Vector3f draw(test::Random& random, double low, double high) {
  const double x = random.uniform(low, high), y = random.uniform(low, high);
  return Eigen::Vector3d(x, y, random.uniform(low, high)).cast<float>();
}

/// A third of the cells of a cube of 24, each with a voxel of any shape.
struct Cells {
  Cells() {
    test::Random random(4);
    std::map<CellBlocks::Place, Eigen::Array3i> cells;
    while (cells.size() < 4600) {
      const Eigen::Array3i cell = draw(random, 0.0, 24.0).array().cast<int>();
      cells[CellBlocks::place_of(cell.x(), cell.y(), cell.z())] = cell;
    }
    for (const auto& [place, cell] : cells) {
      numbers[{cell.x(), cell.y(), cell.z()}] = voxels.size();
      places.push_back(place);
      Voxel& voxel = voxels.emplace_back();
      voxel.mean = kEdgeM * (cell.cast<float>().matrix() + draw(random, 0.0, 1.0));
      voxel.axis0 = draw(random, -1.0, 1.0).normalized();
      voxel.axis1 = voxel.axis0.cross(draw(random, -1.0, 1.0)).normalized();
      const Eigen::Vector3f variances = draw(random, 1e-4, 0.05);
      voxel.variance0 = variances.x();
      voxel.variance1 = variances.y();
      voxel.variance2 = variances.z();
    }
  }
  /// By looking at all eight cells.
  [[nodiscard]] std::pair<const Voxel*, float> nearest(const Eigen::Vector3f& p) const {
    const Eigen::Array3i first = (p.array() / kEdgeM - 0.5F).floor().cast<int>();
    std::pair<const Voxel*, float> best{nullptr, std::numeric_limits<float>::infinity()};
    for (int k = 0; k < 8; ++k) {
      const Eigen::Array3i cell = first + Eigen::Array3i(k >> 2, k >> 1 & 1, k & 1);
      const auto found = numbers.find({cell.x(), cell.y(), cell.z()});
      if (found == numbers.end()) continue;
      const Voxel& voxel = voxels[found->second];
      const float distance2 = mahalanobis2(voxel, p, kFloorM2);
      if (distance2 < best.second) best = {&voxel, distance2};
    }
    return best;
  }

  std::map<std::tuple<int, int, int>, std::size_t> numbers;
  std::vector<CellBlocks::Place> places;
  std::vector<Voxel> voxels;
};

class MapLevel : public testing::Test {
 protected:
  static void use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  void TearDown() override { use(0); }
};

TEST_F(MapLevel, FindsTheNearestOfTheEightVoxelsWithEqualBitsOnAllInstructionSets) {
  const Cells cells;
  const CellBlockTable table(cells.places, kTileShift);
  const CellBlocks::Part part{
      .tiles = table.tiles(), .slots = table.slots(), .voxels = cells.voxels};
  const MapIndex::Level level{kEdgeM, CellBlocks({&part, 1}, kTileShift, kEdgeM)};
  test::Random random(5);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 5000; ++i) points.push_back(draw(random, -1.0, 13.0));
  points.emplace_back(Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()));
  points.emplace_back(1e9F, 1.0F, 1.0F);
  const std::int64_t all = hwy::SupportedTargets();
  for (std::int64_t left = all; left != 0; left &= left - 1) {
    use(left & -left);
    std::size_t found = 0;
    level.for_each_nearest(
        points.size(), kFloorM2, [&](std::size_t i) { return points[i]; },
        [&](std::size_t i, const Eigen::Vector3f& p, const MapIndex::Level::Nearest& nearest) {
          const auto [voxel, distance2] = cells.nearest(p);
          ASSERT_EQ(nearest.voxel, voxel) << i;
          ASSERT_EQ(nearest.distance2, distance2) << i;
          ASSERT_EQ(level.has_any_near(p), voxel != nullptr) << i;
          if (voxel == nullptr) return;
          EXPECT_EQ(nearest.mean, voxel->mean);
          ++found;
        });
    EXPECT_GT(found, 3000U);
  }
}

}  // namespace map_level_test
}  // namespace stillmap::localization
