#include "reference/removert.hpp"

#include "driven_past.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tbb/global_control.h>

#include <numbers>

namespace stillmap::mapping {
namespace removert_test {

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
  for (const double range_m : {12.0, 10.0, 14.0, 16.0}) world.map_has(10.2, range_m);
  // Three passes take one each.
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(1, 1, 1, 0));
}

TEST(Removert, RevertsWhatALargerPixelExplains) {
  // Pixels of 0.4, 0.4545 and 0.5 deg, counted from -180 deg, part at 0 deg; those of 0.55 deg, an
  // odd number all around, do not. So the near surface right of it explains a point left of it.
  ByHand world;
  world.sees(-0.1, 5.0);
  world.sees(0.1, 20.0);
  world.map_has(0.1, 5.1);
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(0));
  world.map.positions.clear();
  world.map_has(0.1, 4.6);
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(1));
}

TEST(Removert, DoesNotRevertWhatIsNotCompared) {
  ByHand world;
  world.sees(-0.1, 5.0);
  world.sees(0.1, 20.0);
  world.map_has(0.1, 5.1);
  world.map_has(0.1, 4.0);
  // Removed in the second pass, then hidden behind the first one.
  EXPECT_THAT(clean(world.map, world), testing::ElementsAre(1, 1));
}

TEST(Removert, TakesOutWhatLeftAndKeepsWhatStays) {
  const std::vector<std::uint8_t> gone = clean(drive().map, drive());
  EXPECT_GT(drive().share_gone(gone, Kind::kMoved), 0.8);
  // Edges, which one scan hits and another one passes by.
  EXPECT_LT(drive().share_gone(gone, Kind::kParked), 0.1);
  EXPECT_LT(drive().share_gone(gone, Kind::kWall), 0.001);
  // The known weakness: a pixel that grazes the ground sees it at many ranges.
  EXPECT_LT(drive().share_gone(gone, Kind::kGround), 0.2);
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
        EXPECT_EQ(total, 5 * drive().size());
        done.push_back(units);
      },
      go_on);
  ASSERT_EQ(done.size(), 5 * drive().size());
  EXPECT_EQ(done.front(), 1U);
  EXPECT_EQ(done.back(), done.size());
  const CancelFlag cancelled = true;
  EXPECT_THROW((void)Removert().moved(drive().map, drive(), nullptr, cancelled), Cancelled);
}

}  // namespace removert_test
}  // namespace stillmap::mapping
