#include "cleaning/free_space_cleaner.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace free_space_cleaner_test {

using test::pose_at;
using test::ScanPattern;
using test::SyntheticWorld;

constexpr double kVoxelM = 0.1;

ScanPattern rings(int count, int columns, double lowest_deg, double highest_deg) {
  constexpr double kDegree = std::numbers::pi / 180.0;
  ScanPattern pattern;
  pattern.rings = count;
  pattern.columns = columns;
  pattern.lowest_rad = lowest_deg * kDegree;
  pattern.highest_rad = highest_deg * kDegree;
  pattern.max_range_m = 40.0;
  pattern.noise_m = 0.01;
  return pattern;
}
ScanPattern dense() { return rings(28, 800, -15.0, 4.0); }

/// A sensor that drives along x through a world that changes from scan to scan.
class ChangingWorld final : public ScanSource {
 public:
  std::function<SyntheticWorld(std::size_t scan)> world;
  ScanPattern pattern = dense();
  std::vector<Eigen::Isometry3d> T_local_lidar_of_scan;

  /// One scan a metre.
  void drive(std::size_t scans, double from_x = 0.0) {
    for (std::size_t i = 0; i < scans; ++i)
      T_local_lidar_of_scan.push_back(pose_at(from_x + static_cast<double>(i), 0.0));
  }
  [[nodiscard]] std::size_t size() const override { return T_local_lidar_of_scan.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    return T_local_lidar_of_scan.at(scan);
  }
  /// From several threads only after `stacked`.
  [[nodiscard]] PosedScan read(std::size_t scan) const override {
    if (scans_.size() <= scan) scans_.resize(size());
    if (scans_[scan].positions.empty()) scans_[scan] = scanned(scan);
    return scans_[scan];
  }

  [[nodiscard]] CleaningPoints stacked() const {
    struct Voxel {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      std::uint32_t points = 0, ground = 0, scans = 0;
      std::size_t last = SIZE_MAX;
    };
    std::map<std::tuple<int, int, int>, Voxel> voxels;
    for (std::size_t scan = 0; scan < size(); ++scan) {
      const PosedScan posed = read(scan);
      for (std::size_t i = 0; i < posed.positions.size(); ++i) {
        const Eigen::Vector3d p = posed.T_local_lidar * posed.positions[i].cast<double>();
        const Eigen::Vector3i c = (p / kVoxelM).array().floor().cast<int>();
        Voxel& voxel = voxels[{c.x(), c.y(), c.z()}];
        voxel.sum += p;
        ++voxel.points;
        voxel.ground += posed.is_ground[i];
        if (voxel.last != scan) ++voxel.scans;
        voxel.last = scan;
      }
    }
    CleaningPoints points;
    points.voxel_size_m = kVoxelM;
    for (const auto& [cell, voxel] : voxels) {
      points.positions.push_back((voxel.sum / voxel.points).cast<float>());
      points.is_ground.push_back(2 * voxel.ground > voxel.points ? 1 : 0);
      points.scans.push_back(voxel.scans);
    }
    return points;
  }

 private:
  [[nodiscard]] PosedScan scanned(std::size_t scan) const {
    ScanPattern seen = pattern;
    seen.seed = scan + 1;
    PosedScan posed{
        T_local_lidar(scan), world(scan).scan(T_local_lidar(scan), seen).positions, {}, {}};
    for (const Eigen::Vector3f& p : posed.positions)
      posed.is_ground.push_back((posed.T_local_lidar * p.cast<double>()).z() < 0.06 ? 1 : 0);
    posed.in_object.resize(posed.positions.size());
    return posed;
  }

  mutable std::vector<PosedScan> scans_;
};

/// A map with what was found to have moved.
struct Cleaned {
  CleaningPoints points;
  std::vector<std::uint8_t> moved;

  explicit Cleaned(const ChangingWorld& world, int threads = 1)
      : Cleaned(world, world.stacked(), threads) {}
  Cleaned(const ChangingWorld& world, CleaningPoints asked, int threads)
      : points(std::move(asked)) {
    const test::TemporaryFolder scratch;
    moved = FreeSpaceCleaner(scratch.path(), threads).moved(points, world, {}, false);
    EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
  }

  struct Count {
    std::size_t all = 0, gone = 0;
    [[nodiscard]] double share() const {
      return static_cast<double>(gone) / std::max(1.0, static_cast<double>(all));
    }
  };
  /// What is not ground in a box, grown by 5 cm.
  [[nodiscard]] Count in(const SyntheticWorld::Box& box) const {
    const Eigen::AlignedBox3d grown(box.min - Eigen::Vector3d::Constant(0.05),
                                    box.max + Eigen::Vector3d::Constant(0.05));
    Count count;
    for (std::size_t i = 0; i < moved.size(); ++i) {
      if (points.is_ground[i] != 0 || !grown.contains(points.positions[i].cast<double>())) continue;
      ++count.all;
      count.gone += moved[i];
    }
    return count;
  }
  [[nodiscard]] std::size_t gone() const {
    return static_cast<std::size_t>(std::count(moved.begin(), moved.end(), 1));
  }
};

const SyntheticWorld::Box kCar{{13.0, 3.0, 0.0}, {17.0, 4.8, 1.5}};
const SyntheticWorld::Box kWall{{-30.0, 9.0, 0.0}, {60.0, 9.5, 6.0}};
const SyntheticWorld::Box kWallAcross{{-30.0, -9.5, 0.0}, {60.0, -9.0, 6.0}};

SyntheticWorld walls() {
  SyntheticWorld world;
  world.boxes = {kWall, kWallAcross};
  return world;
}

/// Walls, and a car in the scans that `present` says.
ChangingWorld with_car(const std::function<bool(std::size_t)>& present, std::size_t scans = 18) {
  ChangingWorld drive;
  drive.drive(scans);
  drive.world = [present](std::size_t scan) {
    SyntheticWorld world = walls();
    if (present(scan)) world.boxes.push_back(kCar);
    return world;
  };
  return drive;
}

ChangingWorld with(const SyntheticWorld& world, std::size_t scans = 16) {
  ChangingWorld drive;
  drive.drive(scans);
  drive.world = [world](std::size_t) { return world; };
  return drive;
}

TEST(FreeSpaceCleaner, RemovesACarThatLeavesAndKeepsTheWallsBehind) {
  const Cleaned map(with_car([](std::size_t scan) { return scan < 5; }));
  const Cleaned::Count car = map.in(kCar);
  EXPECT_GT(car.all, 100U);
  EXPECT_GT(car.share(), 0.95);
  EXPECT_EQ(map.gone(), car.gone) << "and nothing else";
}

TEST(FreeSpaceCleaner, RemovesACarThatLeavesFromUnderADeck) {
  const ChangingWorld drive = with_car([](std::size_t scan) { return scan < 5; });
  CleaningPoints points = drive.stacked();
  for (float x = 5.0F; x < 25.0F; x += 0.1F) {
    for (float y = -8.0F; y < 8.0F; y += 0.1F) {
      points.positions.emplace_back(x, y, 3.5F);
      points.is_ground.push_back(1);
      points.scans.push_back(1);
    }
  }
  const Cleaned map(drive, points, 1);
  EXPECT_GT(map.in(kCar).share(), 0.95);
  EXPECT_EQ(map.gone(), map.in(kCar).gone) << "and nothing else";
}

TEST(FreeSpaceCleaner, KeepsACarThatStays) {
  const Cleaned map(with_car([](std::size_t) { return true; }));
  EXPECT_GT(map.in(kCar).all, 100U);
  EXPECT_EQ(map.gone(), 0U);
}

TEST(FreeSpaceCleaner, RemovesACarThatWaitedForLongAndLeft) {
  const Cleaned map(with_car([](std::size_t scan) { return scan < 9; }, 22));
  EXPECT_GT(map.in(kCar).share(), 0.9);
}

TEST(FreeSpaceCleaner, RemovesTheTrailOfAnOncomingCar) {
  ChangingWorld drive;
  drive.drive(20);
  const auto car_at = [](std::size_t scan) {
    const double x = 40.0 - 2.0 * static_cast<double>(scan);
    return SyntheticWorld::Box{{x, 2.0, 0.0}, {x + 4.0, 3.8, 1.5}};
  };
  drive.world = [&](std::size_t scan) {
    SyntheticWorld world = walls();
    world.boxes.push_back(car_at(scan));
    return world;
  };
  const Cleaned map(drive);
  EXPECT_GT(map.in({{8.0, 2.0, 0.2}, {30.0, 3.8, 1.5}}).share(), 0.95);
  EXPECT_EQ(map.in(kWall).gone, 0U);
}

TEST(FreeSpaceCleaner, KeepsAPoleThatFitsBetweenTheRays) {
  SyntheticWorld world = walls();
  world.cylinders = {{{10.0, 4.0}, 0.03, 4.0}, {{14.0, -6.0}, 0.02, 4.0}};
  const Cleaned map(with(world));
  EXPECT_GT(map.in({{9.9, 3.9, 0.2}, {10.1, 4.1, 4.0}}).all, 20U);
  EXPECT_EQ(map.gone(), 0U);
}

TEST(FreeSpaceCleaner, KeepsAFenceThatMostRaysPass) {
  SyntheticWorld world = walls();
  for (double x = 6.0; x < 12.0; x += 0.12)
    world.boxes.push_back({{x, 5.0, 0.0}, {x + 0.015, 5.015, 1.4}});
  const Cleaned map(with(world));
  const Cleaned::Count fence = map.in({{6.0, 4.9, 0.2}, {12.0, 5.1, 1.4}});
  EXPECT_GT(fence.all, 200U);
  EXPECT_LT(fence.share(), 0.01);
}

TEST(FreeSpaceCleaner, KeepsATreeThatMostRaysPass) {
  SyntheticWorld world = walls();
  test::Random random(3);
  // Of the rays through the middle a third is stopped.
  const Eigen::Vector3d low(8.0, 4.0, 1.6), high(9.3, 5.3, 2.9);
  for (int leaf = 0; leaf < 100; ++leaf) {
    const Eigen::Vector3d p(random.uniform(low.x(), high.x()), random.uniform(low.y(), high.y()),
                            random.uniform(low.z(), high.z()));
    world.boxes.push_back({p, p + Eigen::Vector3d(0.08, 0.08, 0.05)});
  }
  const Cleaned map(with(world));
  const Cleaned::Count crown = map.in({low, high});
  EXPECT_GT(crown.all, 100U);
  EXPECT_LT(crown.share(), 0.01);
}

TEST(FreeSpaceCleaner, KeepsGroundAndKerbs) {
  ChangingWorld drive = with_car([](std::size_t scan) { return scan < 5; });
  const auto without_kerb = drive.world;
  const SyntheticWorld::Box kerb{{-30.0, 5.5, 0.0}, {60.0, 9.0, 0.14}};
  drive.world = [=](std::size_t scan) {
    SyntheticWorld world = without_kerb(scan);
    world.boxes.push_back(kerb);
    return world;
  };
  const Cleaned map(drive);
  EXPECT_GT(map.in(kerb).all, 1000U);
  EXPECT_EQ(map.in(kerb).gone, 0U);
  std::size_t ground_gone = 0;
  for (std::size_t i = 0; i < map.moved.size(); ++i)
    ground_gone += static_cast<std::size_t>(map.points.is_ground[i]) * map.moved[i];
  EXPECT_EQ(ground_gone, 0U);
}

TEST(FreeSpaceCleaner, KeepsWhatIsHiddenLater) {
  ChangingWorld drive;
  drive.drive(20);
  drive.world = [](std::size_t scan) {
    SyntheticWorld world = walls();
    world.boxes.push_back({{9.0, 6.0, 0.0}, {11.0, 7.0, 1.5}});
    if (scan >= 2) world.boxes.push_back({{2.0, 3.0, 0.0}, {19.0, 4.0, 3.5}});
    return world;
  };
  EXPECT_EQ(Cleaned(drive).in({{9.0, 6.0, 0.0}, {11.0, 7.0, 1.5}}).gone, 0U);
}

TEST(FreeSpaceCleaner, WorksWithSixteenRings) {
  ChangingWorld drive = with_car([](std::size_t scan) { return scan < 5; });
  const auto before = drive.world;
  drive.world = [=](std::size_t scan) {
    SyntheticWorld world = before(scan);
    world.cylinders = {{{10.0, -5.0}, 0.06, 4.0}};
    return world;
  };
  drive.pattern = rings(16, 1800, -15.0, 15.0);
  const Cleaned map(drive);
  EXPECT_GT(map.in(kCar).share(), 0.9);
  EXPECT_EQ(map.gone(), map.in(kCar).gone);
}

TEST(FreeSpaceCleaner, OnePlaceAloneIsNotEnough) {
  const SyntheticWorld::Box thing{{7.0, 2.0, 0.0}, {8.0, 3.0, 1.5}};
  const auto standing = [&](std::size_t from_elsewhere) {
    ChangingWorld drive;
    for (std::size_t i = 0; i < 100; ++i) drive.T_local_lidar_of_scan.push_back(pose_at(0.0, 0.0));
    drive.drive(from_elsewhere, 1.0);
    drive.pattern = rings(20, 500, -20.0, 4.0);
    drive.world = [&](std::size_t scan) {
      SyntheticWorld world = walls();
      if (scan < 2) world.boxes.push_back(thing);
      return world;
    };
    return Cleaned(drive).in(thing).gone;
  };
  EXPECT_EQ(standing(0), 0U) << "eight seconds are too short";
  EXPECT_GT(standing(3), 50U) << "with some more it is";
}

TEST(FreeSpaceCleaner, AFixedSensorHasTimeInsteadOfPlaces) {
  const SyntheticWorld::Box passing{{7.0, 2.0, 0.0}, {8.0, 3.0, 1.5}};
  const SyntheticWorld::Box leaving{{-8.0, 2.0, 0.0}, {-7.0, 3.0, 1.5}};
  const SyntheticWorld::Box standing{{5.0, -4.0, 0.0}, {6.0, -3.0, 1.5}};
  ChangingWorld drive;
  drive.T_local_lidar_of_scan.assign(200, pose_at(0.0, 0.0));
  drive.pattern = rings(20, 500, -20.0, 4.0);
  drive.world = [&](std::size_t scan) {
    SyntheticWorld world = walls();
    world.cylinders = {{{10.0, -3.0}, 0.05, 4.0}};
    world.boxes.push_back(standing);
    if (scan < 60) world.boxes.push_back(leaving);
    // It comes twice, and neither time in a scan that is a keyframe.
    if (scan % 100 > 43 && scan % 100 < 46) world.boxes.push_back(passing);
    return world;
  };
  const Cleaned map(drive);
  EXPECT_GT(map.in(passing).all, 50U);
  EXPECT_GT(map.in(passing).share(), 0.95);
  EXPECT_GT(map.in(leaving).all, 50U);
  EXPECT_GT(map.in(leaving).share(), 0.9);
  EXPECT_GT(map.in(standing).all, 50U);
  EXPECT_EQ(map.gone(), map.in(passing).gone + map.in(leaving).gone) << "and nothing else";
}

TEST(FreeSpaceCleaner, RemovesACarOfYesterdayAndKeepsPoles) {
  ChangingWorld drive;
  drive.drive(20);
  drive.drive(20);
  drive.world = [](std::size_t scan) {
    SyntheticWorld world = walls();
    world.cylinders = {{{10.0, 2.5}, 0.05, 4.0}};
    if (scan < 20) world.boxes.push_back(kCar);
    return world;
  };
  const Cleaned map(drive);
  EXPECT_GT(map.in(kCar).share(), 0.95);
  EXPECT_EQ(map.gone(), map.in(kCar).gone);
}

TEST(FreeSpaceCleaner, GivesTheSameForAnyNumberOfThreads) {
  const ChangingWorld drive = with_car([](std::size_t scan) { return scan < 5; });
  const Cleaned one(drive, 1);
  EXPECT_EQ(Cleaned(drive, 4).moved, one.moved);
  EXPECT_GT(one.gone(), 0U);
}

TEST(FreeSpaceCleaner, GivesTheSameForTheWholeMapAtOnce) {
  const ChangingWorld drive = with_car([](std::size_t scan) { return scan < 5; });
  const Cleaned tiles(drive);
  std::vector<RangeView> kept;
  PosedViews views;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const PosedScan scan = drive.read(i);
    kept.emplace_back(scan.positions, scan.is_ground);
    views.T_local_lidar.push_back(scan.T_local_lidar);
  }
  views.read = [&](std::size_t i) { return std::make_shared<const RangeView>(kept[i]); };
  Eigen::AlignedBox2f everywhere(Eigen::Vector2f(-1e3F, -1e3F), Eigen::Vector2f(1e3F, 1e3F));
  EXPECT_EQ(
      moved_by_free_space(tiles.points, everywhere, views, select_keyframes(views.T_local_lidar)),
      tiles.moved);
  ASSERT_LT(kCar.min.x(), maps::kTileSizeM);
}

TEST(FreeSpaceCleaner, MapsWithoutPointsOrScansStayAsTheyAre) {
  const test::TemporaryFolder scratch;
  const FreeSpaceCleaner cleaner(scratch.path(), 1);
  ChangingWorld drive = with(walls(), 3);
  EXPECT_TRUE(cleaner.moved({}, drive, {}, false).empty());
  const CleaningPoints points = drive.stacked();
  drive.T_local_lidar_of_scan.clear();
  EXPECT_THAT(cleaner.moved(points, drive, {}, false), testing::Each(0));
}

TEST(FreeSpaceCleaner, EndsWhenCancelledAndLeavesNothingBehind) {
  const test::TemporaryFolder scratch;
  const ChangingWorld drive = with(walls(), 3);
  EXPECT_THROW(static_cast<void>(
                   FreeSpaceCleaner(scratch.path(), 1).moved(drive.stacked(), drive, {}, true)),
               Cancelled);
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

TEST(FreeSpaceCleaner, TellsHowFarItIs) {
  const test::TemporaryFolder scratch;
  const ChangingWorld drive = with(walls(), 3);
  std::map<std::string, std::size_t> done, total;
  const auto progress = [&](std::string_view stage, std::size_t n, std::size_t of) {
    done[std::string(stage)] = n;
    total[std::string(stage)] = of;
  };
  static_cast<void>(
      FreeSpaceCleaner(scratch.path(), 2).moved(drive.stacked(), drive, progress, false));
  EXPECT_EQ(done["views"], 3U);
  EXPECT_GT(done["clean"], 1U);
  EXPECT_EQ(done, total);
}

}  // namespace free_space_cleaner_test
}  // namespace stillmap::mapping
