#include "reference/octomap_cleaner.hpp"

#include "reference/voxel_ray.hpp"
#include "support/throws.hpp"
#include "unit/mapping/scans_in_memory.hpp"

#include <gtest/gtest.h>
#include <octomap/OcTree.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <set>
#include <stdexcept>
#include <tuple>
#include <vector>

namespace stillmap::mapping {
namespace octomap_cleaner_test {

using test::ScanPattern;
using test::ScansInMemory;
using test::SyntheticWorld;
using test::ThrowsSaying;

/// Scans along x with one ray each: to a surface at 4 m, or through to one at 8 m.
ScansInMemory rays(const std::vector<bool>& stops) {
  ScansInMemory scans;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(0.05, 0.05, 0.05);
  for (const bool stop : stops) scans.add(T, {{stop ? 4.0F : 8.0F, 0.0F, 0.0F}});
  return scans;
}

std::vector<std::uint8_t> clean(const CleaningPoints& points, const ScanSource& scans,
                                const OctomapOptions& options = {}) {
  const CancelFlag never{false};
  return OctomapCleaner(options).moved(points, scans, {}, never);
}

CleaningPoints at_four_metres(std::uint8_t is_ground = 0) {
  CleaningPoints points;
  ScansInMemory::add_point(points, {4.05F, 0.05F, 0.05F}, is_ground);
  return points;
}

bool goes(const std::vector<bool>& stops, const OctomapOptions& options = {}) {
  return clean(at_four_metres(), rays(stops), options).front() == 1;
}

// log-odds: a hit is +0.847, a miss -0.405, bounds -1.992 and 3.476.
TEST(Octomap, WeighsHitsAgainstMisses) {
  EXPECT_FALSE(goes({true}));
  EXPECT_TRUE(goes({false}));
  EXPECT_FALSE(goes({true, false, false})) << "0.847 - 2 * 0.405 > 0";
  EXPECT_TRUE(goes({true, false, false, false}));
  EXPECT_FALSE(goes({false, false, true})) << "the order does not matter far from the bounds";
}

TEST(Octomap, ForgetsAtItsBoundsSoThatTheOrderMatters) {
  const std::vector<bool> hits(20, true), misses(20, false);
  std::vector<bool> hits_first = hits, misses_first = misses;
  hits_first.insert(hits_first.end(), misses.begin(), misses.end());
  misses_first.insert(misses_first.end(), hits.begin(), hits.end());
  EXPECT_TRUE(goes(hits_first)) << "3.476 - 20 * 0.405 < 0";
  EXPECT_FALSE(goes(misses_first)) << "-1.992 + 20 * 0.847 > 0";
  std::vector<bool> eight(20, true);
  eight.insert(eight.end(), 8, false);
  EXPECT_FALSE(goes(eight)) << "3.476 - 8 * 0.405 > 0";
  EXPECT_TRUE(goes(eight, {.max_probability = 0.9})) << "2.197 - 8 * 0.405 < 0";
}

TEST(Octomap, KeepsGroundAndWhatNoRayMet) {
  EXPECT_EQ(clean(at_four_metres(1), rays({false, false})).front(), 0);
  CleaningPoints points;
  ScansInMemory::add_point(points, {4.05F, 0.15F, 0.05F});
  ScansInMemory::add_point(points, {8.25F, 0.05F, 0.05F});
  EXPECT_EQ(clean(points, rays({false, false})), (std::vector<std::uint8_t>{0, 0}));
}

TEST(Octomap, ClearsTheWayToTheGroundButNotTheGround) {
  ScansInMemory scans = rays({false});
  scans.scans.front().is_ground.front() = 1;
  EXPECT_EQ(clean(at_four_metres(), scans).front(), 1);
  CleaningPoints end;
  ScansInMemory::add_point(end, {8.05F, 0.05F, 0.05F});
  EXPECT_EQ(clean(end, scans).front(), 0) << "neither free nor occupied";
}

TEST(Octomap, PrefersEndsToPassagesWithinAScan) {
  ScansInMemory scans = rays({false, false, true});
  EXPECT_EQ(clean(at_four_metres(), scans).front(), 0) << "-2 * 0.405 + 0.847 > 0";
  scans.scans.back().positions.emplace_back(8.0F, 0.0F, 0.0F);
  scans.scans.back().is_ground.push_back(0);
  EXPECT_EQ(clean(at_four_metres(), scans).front(), 0) << "no third miss";
}

TEST(Octomap, WalksAsTheLibraryDoes) {
  test::Random random(5);
  octomap::OcTree tree(0.1);
  octomap::KeyRay keys;
  std::size_t voxels = 0, differing = 0;
  for (int k = 0; k < 100; ++k) {
    Eigen::Vector3d from, to;
    for (int axis = 0; axis < 3; ++axis) {
      from[axis] = random.uniform(-20.0, 20.0);
      to[axis] = random.uniform(-20.0, 20.0);
    }
    std::set<std::tuple<int, int, int>> theirs, ours;
    const auto point = [](const Eigen::Vector3d& p) {
      return octomap::point3d(static_cast<float>(0.1 * p.x()), static_cast<float>(0.1 * p.y()),
                              static_cast<float>(0.1 * p.z()));
    };
    ASSERT_TRUE(tree.computeRayKeys(point(from), point(to), keys));
    for (const octomap::OcTreeKey& key : keys) {
      theirs.insert({key[0] - 32768, key[1] - 32768, key[2] - 32768});
    }
    reference::VoxelRay ray(from, to);
    Eigen::Vector3i voxel = reference::voxel_of(from);
    for (int left = ray.steps(); left > 0; --left) {
      ours.insert({voxel.x(), voxel.y(), voxel.z()});
      const int axis = ray.advance();
      voxel[axis] += ray.sign(axis);
    }
    voxels += ours.size();
    for (const auto& v : theirs) differing += ours.contains(v) ? 0 : 1;
    for (const auto& v : ours) differing += theirs.contains(v) ? 0 : 1;
  }
  EXPECT_GT(voxels, 3000U);
  // Where a ray all but touches an edge, floats take the other way round.
  EXPECT_LE(differing, 4U);
}

/// A street whose box is there in the first scans only.
ScansInMemory drive() {
  SyntheticWorld with, without;
  without.boxes = {{{8.05, -12.0, 0.0}, {8.55, 12.0, 3.0}}};
  with.boxes = without.boxes;
  with.boxes.push_back({{4.03, -1.02, 0.0}, {5.53, 1.02, 1.5}});
  ScanPattern pattern;
  pattern.rings = 48;
  pattern.columns = 480;
  pattern.lowest_rad = -0.45;
  pattern.max_range_m = 9.5;
  ScansInMemory scans;
  for (int k = 0; k < 4; ++k) scans.add(k < 1 ? with : without, {0.13 * k, 0.11 * k, 1.8}, pattern);
  scans.shift({0.0, 0.0, 0.05});
  return scans;
}

TEST(Octomap, TakesTheBoxThatLeftAndLeavesTheWall) {
  const ScansInMemory scans = drive();
  const CleaningPoints points = scans.points();
  const std::vector<std::uint8_t> moved = clean(points, scans);
  std::size_t box = 0, removed = 0, wall = 0, lost = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const Eigen::Vector3f& p = points.positions[i];
    if (points.is_ground[i] != 0) {
      ASSERT_EQ(moved[i], 0);
    } else if (p.x() < 6.0F && p.x() > 4.0F && p.z() > 0.3F) {
      ++box;
      removed += moved[i];
    } else if (p.x() > 8.0F) {
      ++wall;
      lost += moved[i];
    }
  }
  ASSERT_GT(box, 200U);
  ASSERT_GT(wall, 1000U);
  EXPECT_GT(static_cast<double>(removed), 0.98 * static_cast<double>(box));
  EXPECT_LT(static_cast<double>(lost), 0.02 * static_cast<double>(wall));
}

TEST(Octomap, GivesTheSameForAnyThreadsAndAnywhere) {
  ScansInMemory scans = drive();
  CleaningPoints points = scans.points();
  std::vector<std::uint8_t> first, second;
  // Four threads, however many cores there are.
  const tbb::global_control allow(tbb::global_control::max_allowed_parallelism, 4);
  tbb::task_arena(1).execute([&] { first = clean(points, scans); });
  tbb::task_arena(4).execute([&] { second = clean(points, scans); });
  EXPECT_EQ(first, second);
  EXPECT_GT(std::count(first.begin(), first.end(), 1), 0);
}

TEST(Octomap, TakesEmptyMapsAndNoScans) {
  EXPECT_TRUE(clean({}, rays({true})).empty());
  EXPECT_EQ(clean(at_four_metres(), ScansInMemory()).front(), 0);
  ScansInMemory empty;
  empty.add(Eigen::Isometry3d::Identity(), {});
  EXPECT_EQ(clean(at_four_metres(), empty).front(), 0);
}

TEST(Octomap, TellsEveryScanAndEndsWhenCancelled) {
  const ScansInMemory scans = rays({true, false, true});
  CancelFlag cancel{false};
  std::vector<std::size_t> done;
  const auto progress = [&](std::string_view stage, std::size_t scan, std::size_t total) {
    EXPECT_EQ(stage, "clean");
    EXPECT_EQ(total, 3U);
    done.push_back(scan);
  };
  (void)OctomapCleaner().moved(at_four_metres(), scans, progress, cancel);
  EXPECT_EQ(done, (std::vector<std::size_t>{1, 2, 3}));
  cancel = true;
  EXPECT_THROW((void)OctomapCleaner().moved(at_four_metres(), scans, {}, cancel), Cancelled);
}

TEST(Octomap, RefusesWhatIsOutOfBounds) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto making = [](const OctomapOptions& options) {
    return [options] { const OctomapCleaner cleaner(options); };
  };
  using Wrong = std::invalid_argument;
  for (const double bad : {nan, 0.0, 11.0}) {
    EXPECT_THAT(making({.voxel_m = bad}), ThrowsSaying<Wrong>({"voxel_m"}));
  }
  for (const double bad : {nan, 0.5, 1.0}) {
    EXPECT_THAT(making({.hit_probability = bad}), ThrowsSaying<Wrong>({"hit_probability"}));
    EXPECT_THAT(making({.max_probability = bad}), ThrowsSaying<Wrong>({"max_probability"}));
  }
  for (const double bad : {nan, 0.5, 0.0}) {
    EXPECT_THAT(making({.miss_probability = bad}), ThrowsSaying<Wrong>({"miss_probability"}));
    EXPECT_THAT(making({.min_probability = bad}), ThrowsSaying<Wrong>({"min_probability"}));
  }
}

TEST(Octomap, RefusesMapsAndScansThatCannotBe) {
  using Wrong = std::invalid_argument;
  CleaningPoints wide = at_four_metres();
  ScansInMemory::add_point(wide, {6600.0F, 0.0F, 0.0F});
  EXPECT_THAT([&] { (void)clean(wide, rays({true})); }, ThrowsSaying<Wrong>({"65536"}));
  CleaningPoints points = at_four_metres();
  points.is_ground.clear();
  EXPECT_THAT([&] { (void)clean(points, rays({true})); }, ThrowsSaying<Wrong>({"map", "found 0"}));
  ScansInMemory scans = rays({true});
  scans.scans.front().is_ground.clear();
  EXPECT_THAT([&] { (void)clean(at_four_metres(), scans); }, ThrowsSaying<Wrong>({"scan"}));
}

}  // namespace octomap_cleaner_test
}  // namespace stillmap::mapping
