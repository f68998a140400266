#include "reference/removert.hpp"

#include "driven_past.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tbb/global_control.h>

#include <numbers>

namespace stillmap::mapping {
namespace {

using Kind = test::DrivenPast::Kind;

const test::DrivenPast& drive() {
  static const test::DrivenPast kDrive;
  return kDrive;
}

std::vector<std::uint8_t> clean(const CleaningPoints& map, const ScanSource& scans) {
  const CancelFlag cancel = false;
  return Removert().moved(map, scans, nullptr, cancel);
}

/// One scan from the origin and a map, both of single points in given directions.
class ByHand : public ScanSource {
 public:
  [[nodiscard]] std::size_t size() const override { return 1; }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t /*scan*/) const override {
    return scan.T_local_lidar;
  }
  [[nodiscard]] PosedScan read(std::size_t /*scan*/) const override { return scan; }

  void sees(double azimuth_deg, double range_m) {
    scan.positions.push_back(point(azimuth_deg, range_m));
    scan.is_ground.push_back(0);
    scan.in_object.push_back(0);
  }
  void map_has(double azimuth_deg, double range_m) {
    map.positions.push_back(point(azimuth_deg, range_m));
    map.is_ground.push_back(0);
    map.scans.push_back(1);
  }

  PosedScan scan;
  CleaningPoints map;

 private:
  static Eigen::Vector3f point(double azimuth_deg, double range_m) {
    const double azimuth = azimuth_deg * std::numbers::pi / 180.0;
    return (range_m * Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0.001)).cast<float>();
  }
};

TEST(Removert, TakesOutWhatStandsBeforeWhatAScanSaw) {
  ByHand world;
  for (const double azimuth_deg : {10.2, 20.2, 30.2, 40.2}) world.sees(azimuth_deg, 20.0);
  world.map_has(10.2, 10.0);
  world.map_has(20.2, 18.9);
  world.map_has(30.2, 19.1);
  world.map_has(40.2, 25.0);
  world.map_has(50.2, 10.0);
  // 5 % of 20 m are agreement, what is behind is hidden, and where nothing was seen nothing is
  // known.
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(1, 1, 0, 0, 0));
}

TEST(Removert, OnlyTheNearestOfAPixelIsJudged) {
  ByHand world;
  world.sees(10.2, 20.0);
  world.map_has(10.2, 12.0);
  world.map_has(10.2, 10.0);
  world.map_has(10.2, 14.0);
  // First and last pass take one each.
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(1, 1, 0));
}

TEST(Removert, RevertsWhatALargerPixelExplains) {
  // 0.4 deg pixels from -180 deg: one ends at 60 deg. The larger ones of 0.4211 deg end at 59.79
  // and 60.21 deg, so that the near surface left of 60 deg explains the point right of it. In the
  // last pass a point that moved stands before it.
  ByHand world;
  world.sees(59.9, 5.0);
  world.sees(60.1, 20.0);
  world.map_has(60.1, 5.1);
  world.map_has(60.1, 4.0);
  const std::vector<std::uint8_t> gone = clean(world.map, world);
  EXPECT_EQ(gone[1], 1);
}

TEST(Removert, TakesOutWhatLeftAndKeepsWhatStays) {
  const std::vector<std::uint8_t> gone = clean(drive().map, drive());
  EXPECT_GT(drive().share_gone(gone, Kind::kMoved), 0.8);
  // Edges, which one scan hits and another one passes by.
  EXPECT_LT(drive().share_gone(gone, Kind::kParked), 0.1);
  EXPECT_LT(drive().share_gone(gone, Kind::kWall), 0.001);
  EXPECT_LT(drive().share_gone(gone, Kind::kGround), 0.001);
}

TEST(Removert, IsTheSameForAnyNumberOfThreads) {
  const auto with_threads = [](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return clean(drive().map, drive());
  };
  EXPECT_EQ(with_threads(1), with_threads(3));
}

TEST(Removert, TakesAnEmptyMapAndEmptyScans) {
  EXPECT_TRUE(clean({}, drive()).empty());
  ByHand world;
  world.map_has(0.0, 5.0);
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(0));
  EXPECT_THAT(clean(world.map, test::DrivenPast(0)), testing::ElementsAre(0));
}

TEST(Removert, KeepsTheMapOfOneScan) {
  const test::DrivenPast one(1);
  const std::vector<std::uint8_t> gone = clean(one.map, one);
  EXPECT_LT(one.share_gone(gone, Kind::kWall), 0.01);
  EXPECT_LT(one.share_gone(gone, Kind::kMoved), 0.01);
}

TEST(Removert, ReportsEveryScanOfEveryPassAndCanBeCancelled) {
  std::vector<std::size_t> done;
  const CancelFlag go_on = false;
  (void)Removert().moved(
      drive().map, drive(),
      [&](std::string_view stage, std::size_t units, std::size_t total) {
        EXPECT_EQ(stage, "clean");
        EXPECT_EQ(total, 4 * drive().size());
        done.push_back(units);
      },
      go_on);
  ASSERT_EQ(done.size(), 4 * drive().size());
  EXPECT_EQ(done.front(), 1U);
  EXPECT_EQ(done.back(), done.size());
  const CancelFlag cancelled = true;
  EXPECT_THROW((void)Removert().moved(drive().map, drive(), nullptr, cancelled), Cancelled);
}

}  // namespace
}  // namespace stillmap::mapping
