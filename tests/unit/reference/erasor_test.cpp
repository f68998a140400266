#include "reference/erasor.hpp"

#include "driven_past.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tbb/global_control.h>

#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace erasor_test {

using Kind = test::DrivenPast::Kind;

const test::DrivenPast& drive() {
  static const test::DrivenPast kDrive;
  return kDrive;
}

std::vector<std::uint8_t> clean(const CleaningPoints& map, const ScanSource& scans) {
  const CancelFlag cancel = false;
  return Erasor().moved(map, scans, nullptr, cancel);
}

class Listed : public ScanSource {
 public:
  explicit Listed(std::vector<PosedScan> scans) : scans_(std::move(scans)) {}
  [[nodiscard]] std::size_t size() const override { return scans_.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    return scans_[scan].T_local_lidar;
  }
  [[nodiscard]] PosedScan read(std::size_t scan) const override { return scans_[scan]; }

 private:
  std::vector<PosedScan> scans_;
};

TEST(Erasor, TakesOutWhatLeftAndKeepsWhatStays) {
  const std::vector<std::uint8_t> gone = clean(drive().map, drive());
  // R-GPF takes what is less than 0.15 m over its plane for ground.
  EXPECT_EQ(drive().share_gone(gone, Kind::kMoved, 0.3), 1.0);
  EXPECT_EQ(drive().share_gone(gone, Kind::kParked), 0.0);
  EXPECT_EQ(drive().share_gone(gone, Kind::kGround), 0.0);
  // Bins at the ends of the wall are seen in part.
  EXPECT_LT(drive().share_gone(gone, Kind::kWall), 0.02);
}

TEST(Erasor, IsTheSameForAnyNumberOfThreads) {
  const auto with_threads = [](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return clean(drive().map, drive());
  };
  EXPECT_EQ(with_threads(1), with_threads(3));
}

TEST(Erasor, TakesAnEmptyMapAndNoScans) {
  EXPECT_TRUE(clean({}, drive()).empty());
  const std::vector<std::uint8_t> gone = clean(drive().map, test::DrivenPast(0));
  EXPECT_THAT(gone, testing::Each(0));
}

TEST(Erasor, KeepsTheMapOfOneScan) {
  const test::DrivenPast one(1);
  EXPECT_THAT(clean(one.map, one), testing::Each(0));
}

TEST(Erasor, UsesEveryFourthScan) {
  // The first scan still sees the box, the later one does not.
  const PosedScan before = drive().read(0);
  const PosedScan after = drive().read(4);
  const std::vector<std::uint8_t> first = clean(drive().map, Listed({before}));
  EXPECT_EQ(clean(drive().map, Listed({before, after, after, after})), first);
  const std::vector<std::uint8_t> fifth =
      clean(drive().map, Listed({before, before, before, before, after}));
  EXPECT_LT(drive().share_gone(first, Kind::kMoved, 0.3), 0.9);
  EXPECT_GT(drive().share_gone(fifth, Kind::kMoved, 0.3), 0.9);
}

TEST(Erasor, LeavesScansOutThatSeeNoGround) {
  PosedScan scan = drive().read(4);
  scan.is_ground.assign(scan.positions.size(), 0);
  EXPECT_THAT(clean(drive().map, Listed({scan})), testing::Each(0));
}

TEST(Erasor, FollowsTheMapWhenItIsTurnedAndMoved) {
  Eigen::Isometry3d T_turned_local = Eigen::Isometry3d::Identity();
  T_turned_local.linear() =
      Eigen::AngleAxisd(0.25 * std::numbers::pi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_turned_local.translation() = Eigen::Vector3d(40.0, -7.0, 3.0);
  CleaningPoints turned = drive().map;
  for (Eigen::Vector3f& p : turned.positions) p = (T_turned_local * p.cast<double>()).cast<float>();
  PosedScan scan = drive().read(4);
  const std::vector<std::uint8_t> straight = clean(drive().map, Listed({scan}));
  scan.T_local_lidar = T_turned_local * scan.T_local_lidar;
  const std::vector<std::uint8_t> gone = clean(turned, Listed({scan}));
  // Voxels of the map turn, too, so what a scan itself sees is told a little differently.
  std::size_t different = 0;
  for (std::size_t i = 0; i < gone.size(); ++i) different += gone[i] != straight[i] ? 1 : 0;
  EXPECT_LT(static_cast<double>(different), 0.002 * static_cast<double>(gone.size()));
}

TEST(Erasor, ReportsItsScansAndCanBeCancelled) {
  std::vector<std::size_t> done;
  const CancelFlag go_on = false;
  (void)Erasor().moved(
      drive().map, drive(),
      [&](std::string_view stage, std::size_t units, std::size_t total) {
        EXPECT_EQ(stage, "clean");
        EXPECT_EQ(total, drive().size());
        done.push_back(units);
      },
      go_on);
  EXPECT_THAT(done, testing::ElementsAre(4U, 8U, 9U));
  const CancelFlag cancelled = true;
  EXPECT_THROW((void)Erasor().moved(drive().map, drive(), nullptr, cancelled), Cancelled);
}

}  // namespace erasor_test
}  // namespace stillmap::mapping
