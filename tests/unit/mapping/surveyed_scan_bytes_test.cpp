#include "pipeline/surveyed_scan_bytes.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <tuple>

namespace stillmap::mapping {
namespace surveyed_scan_bytes_test {

constexpr std::size_t kPoints = 13;

maps::Box odd_box() {
  maps::Box box;
  box.centre = {1.0 / 3.0, -2e-300, 4e8};
  box.size_m = {4.1, 1.7, std::nextafter(1.5, 2.0)};
  box.yaw_rad = -3.1;
  box.object_class = maps::ObjectClass::kTram;
  box.score = 0.7;
  box.track = -7;
  return box;
}

/// Every field its own value, none of them a default.
SurveyedScan odd_scan() {
  SurveyedScan scan;
  scan.scan = 1234567890123;
  scan.sha256 = std::string(64, 'a') + '\0' + "b";
  for (std::size_t i = 0; i < kPoints; ++i) scan.is_ground.push_back(i % 3 == 1 || i == 12);
  for (std::size_t i = 0; i < kPoints; ++i) scan.weather.push_back(i % 5 == 2);
  scan.boxes = {odd_box(), maps::Box()};
  scan.ground_cells.cells = {{-5, 7, 0.1F, -0.02F, 0.03F, 0.9F, true},
                             {1 << 20, -(1 << 20), -3.0F, 1e-30F, -0.0F, 1.0F, false}};
  scan.obstacles.voxels = {{0xFEDCBA9876543210U, {1.5F, -2.5F, 0.3F}, 17},
                           {3, {0.0F, 1e30F, -1.0F}, 0xFFFFFFFFU}};
  std::vector<Eigen::Vector3f> positions;
  for (std::size_t i = 0; i < kPoints; ++i)
    positions.emplace_back(3.0F + static_cast<float>(i), 1.0F, -1.0F);
  const std::vector<std::uint8_t> is_ground(scan.is_ground.begin(), scan.is_ground.end());
  scan.view.emplace(positions, is_ground);
  scan.counts = {{"in", std::numeric_limits<std::uint64_t>::max()}, {"", 3}};
  scan.stage_seconds = {{"detect", 0.1}, {"read", 1e-9}};
  return scan;
}

bool operator==(const maps::Box& a, const maps::Box& b) {
  return a.centre == b.centre && a.size_m == b.size_m && a.yaw_rad == b.yaw_rad &&
         a.object_class == b.object_class && a.score == b.score && a.track == b.track;
}

void expect_equal(const SurveyedScan& a, const SurveyedScan& b) {
  EXPECT_EQ(a.scan, b.scan);
  EXPECT_EQ(a.sha256, b.sha256);
  EXPECT_EQ(a.is_ground, b.is_ground);
  EXPECT_EQ(a.weather, b.weather);
  ASSERT_EQ(a.boxes.size(), b.boxes.size());
  for (std::size_t i = 0; i < a.boxes.size(); ++i) EXPECT_TRUE(a.boxes[i] == b.boxes[i]) << i;
  ASSERT_EQ(a.ground_cells.cells.size(), b.ground_cells.cells.size());
  for (std::size_t i = 0; i < a.ground_cells.cells.size(); ++i) {
    const GroundCells::Cell& c = a.ground_cells.cells[i];
    const GroundCells::Cell& d = b.ground_cells.cells[i];
    EXPECT_EQ(std::tie(c.x, c.y, c.z, c.offset_x, c.offset_y, c.weight, c.in_box),
              std::tie(d.x, d.y, d.z, d.offset_x, d.offset_y, d.weight, d.in_box));
    EXPECT_EQ(std::signbit(c.offset_y), std::signbit(d.offset_y));
  }
  ASSERT_EQ(a.obstacles.voxels.size(), b.obstacles.voxels.size());
  for (std::size_t i = 0; i < a.obstacles.voxels.size(); ++i) {
    const ScanObstacles::Voxel& v = a.obstacles.voxels[i];
    const ScanObstacles::Voxel& w = b.obstacles.voxels[i];
    EXPECT_TRUE(v.key == w.key && v.sum == w.sum && v.points == w.points) << i;
  }
  EXPECT_EQ(a.view, b.view);
  EXPECT_EQ(a.counts, b.counts);
  EXPECT_EQ(a.stage_seconds, b.stage_seconds);
}

TEST(SurveyedScanBytes, GiveBackEveryField) {
  const SurveyedScan scan = odd_scan();
  const SurveyedScan back = surveyed_scan_from(to_bytes(scan));
  expect_equal(back, scan);
  EXPECT_EQ(to_bytes(back), to_bytes(scan));
}

TEST(SurveyedScanBytes, GiveBackAnEmptyScan) {
  SurveyedScan scan;
  scan.view.emplace(std::vector<Eigen::Vector3f>{}, std::vector<std::uint8_t>{});
  expect_equal(surveyed_scan_from(to_bytes(scan)), scan);
}

TEST(SurveyedScanBytes, KeepTheBitsOfNaN) {
  SurveyedScan scan = odd_scan();
  scan.ground_cells.cells[0].z = std::bit_cast<float>(0x7FC12345U);
  scan.boxes[0].score = std::numeric_limits<double>::signaling_NaN();
  EXPECT_EQ(to_bytes(surveyed_scan_from(to_bytes(scan))), to_bytes(scan));
}

TEST(SurveyedScanBytes, KeepAnyNumberOfFlags) {
  for (std::size_t size = 0; size < 20; ++size) {
    SurveyedScan scan = odd_scan();
    scan.is_ground.assign(size, false);
    for (std::size_t i = 0; i < size; i += 2) scan.is_ground[i] = true;
    EXPECT_EQ(surveyed_scan_from(to_bytes(scan)).is_ground, scan.is_ground) << size;
  }
}

TEST(SurveyedScanBytes, AreRefusedAtEveryShorterLength) {
  const std::string bytes = to_bytes(odd_scan());
  for (std::size_t length = 0; length < bytes.size(); ++length)
    ASSERT_THROW((void)surveyed_scan_from(bytes.substr(0, length)), std::invalid_argument)
        << length;
  EXPECT_THROW((void)surveyed_scan_from(bytes + "x"), std::invalid_argument);
}

TEST(SurveyedScanBytes, AreRefusedOrReadWhateverTheySay) {
  const std::string bytes = to_bytes(odd_scan());
  std::mt19937 random(7);
  std::size_t refused = 0;
  for (int round = 0; round < 5000; ++round) {
    std::string changed = bytes;
    for (int i = 0; i < 1 + round % 3; ++i)
      changed[random() % changed.size()] = static_cast<char>(round % 2 == 0 ? random() : 0xFFU);
    try {
      (void)surveyed_scan_from(changed);
    } catch (const std::invalid_argument&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100U);
}

TEST(SurveyedScanBytes, RefuseWhatIsNoClassAndNoFlag) {
  SurveyedScan scan = odd_scan();
  scan.boxes[0].object_class = static_cast<maps::ObjectClass>(10);
  EXPECT_THROW((void)surveyed_scan_from(to_bytes(scan)), std::invalid_argument);
  scan.boxes[0].object_class = static_cast<maps::ObjectClass>(-1);
  EXPECT_THROW((void)surveyed_scan_from(to_bytes(scan)), std::invalid_argument);
}

}  // namespace surveyed_scan_bytes_test
}  // namespace stillmap::mapping
