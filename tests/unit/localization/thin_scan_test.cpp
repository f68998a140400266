#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/synthetic_world.hpp"

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace thin_scan_test {

using test::pose_at;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

struct Street {
  test::SyntheticWorld world = test::street(21);
  std::vector<Eigen::Isometry3d> poses = drive();
  std::shared_ptr<const MapIndex> index = MapIndex::build(world.mapped_from(poses, pattern(100)));
  std::shared_ptr<const Aligner> aligner = make_aligner("default", index, poses);

  static std::vector<Eigen::Isometry3d> drive() {
    std::vector<Eigen::Isometry3d> out;
    for (double x = 20.0; x <= 110.0; x += 3.0) out.push_back(pose_at(x, 0.5 * std::sin(x), 0.02));
    return out;
  }
};
const Street& street() {
  static const Street built;
  return built;
}

/// With times of a turning sensor, a vehicle's bonnet, and what drivers write for no return.
maps::PointCloud scan_at(const Eigen::Isometry3d& T, std::uint64_t seed, bool has_times) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  maps::PointCloud scan = street().world.scan(T, pattern(seed));
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    points.push_back(scan.positions[i]);
    if (i % 5 == 0) points.emplace_back(kNone, kNone, kNone);
    if (i % 7 == 0) points.emplace_back(0.0F, 0.0F, 0.0F);
    if (i % 11 == 0) points.emplace_back(1.2F, 0.001F * static_cast<float>(i % 900), -0.8F);
  }
  scan.positions = std::move(points);
  if (has_times)
    for (const Eigen::Vector3f& p : scan.positions)
      scan.time_offsets_s.push_back(p.allFinite() ? std::atan2(p.y(), p.x()) / 62.8F : 0.0F);
  return scan;
}

/// As a reader of files leaves it.
maps::PointCloud without_no_returns(const maps::PointCloud& scan) {
  return whole_scan(view_of(scan)).points_lidar;
}

SentScan sent(const maps::PointCloud& scan, ThinProfile profile) {
  const std::vector<char> bytes = encode_thin_scan(view_of(scan), profile);
  return decode_thin_scan(std::as_bytes(std::span(bytes)), "scan");
}

void expect_equal_bits(const AlignmentResult& a, const AlignmentResult& b) {
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.reasons, b.reasons);
  EXPECT_EQ(a.T_map_lidar.matrix(), b.T_map_lidar.matrix());
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.inlier_ratio, b.inlier_ratio);
  EXPECT_EQ(a.rmse_m, b.rmse_m);
}

Prior near(const Eigen::Isometry3d& T) {
  Eigen::Isometry3d off = T;
  off.translation() += Eigen::Vector3d(0.8, -0.5, 0.1);
  return {off, std::nullopt};
}

TEST(ThinScan, ExactIsAnsweredAsTheWholeScanToTheBit) {
  for (const bool has_times : {false, true}) {
    for (const double x : {25.0, 61.5, 104.0}) {
      const Eigen::Isometry3d T = pose_at(x, -0.7, 0.3);
      const maps::PointCloud scan = scan_at(T, 7, has_times);
      const SentScan exact = sent(scan, ThinProfile::kExact);
      EXPECT_GT(exact.no_returns, 0U);
      EXPECT_EQ(exact.points + exact.no_returns, scan.size());
      for (const std::optional<Prior>& prior :
           {std::optional<Prior>(near(T)), std::optional<Prior>()}) {
        const AlignmentResult whole = street().aligner->align(without_no_returns(scan), prior);
        ASSERT_NE(whole.status, PoseStatus::kLost);
        expect_equal_bits(street().aligner->align_thin(exact.scan, prior), whole);
        expect_equal_bits(
            street().aligner->align_thin(street().aligner->thin(view_of(scan)), prior), whole);
      }
    }
  }
}

TEST(ThinScan, ExactIsTrackedAsTheWholeScanToTheBit) {
  Tracker whole(street().aligner), thin(street().aligner);
  for (int k = 0; k < 12; ++k) {
    const maps::PointCloud scan =
        scan_at(pose_at(30.0 + 0.8 * k, 0.2, 0.05), static_cast<std::uint64_t>(50 + k), true);
    const std::int64_t stamp_ns = 100'000'000LL * k;
    const TrackedPose a = whole.track(stamp_ns, without_no_returns(scan));
    const TrackedPose b = thin.track_thin(stamp_ns, sent(scan, ThinProfile::kExact).scan);
    expect_equal_bits(b.result, a.result);
    EXPECT_EQ(a.searched_from, b.searched_from);
    if (k > 3) {
      EXPECT_EQ(a.result.status, PoseStatus::kOk) << k;
    }
  }
}

TEST(ThinScan, CompactIsSmallAndMillimetresAway) {
  for (const bool has_times : {false, true}) {
    for (const double x : {25.0, 61.5, 104.0}) {
      const Eigen::Isometry3d T = pose_at(x, -0.7, 0.3);
      const maps::PointCloud scan = scan_at(T, 9, has_times);
      const auto bytes = encode_thin_scan(view_of(scan), ThinProfile::kCompact);
      EXPECT_LE(bytes.size(), kMostCompactBytes);
      const AlignmentResult whole =
          street().aligner->align_thin(street().aligner->thin(view_of(scan)), near(T));
      const AlignmentResult compact = street().aligner->align_thin(
          decode_thin_scan(std::as_bytes(std::span(bytes)), "scan").scan, near(T));
      EXPECT_EQ(compact.status, whole.status);
      EXPECT_LT((compact.T_map_lidar.translation() - whole.T_map_lidar.translation()).norm(),
                0.005);
    }
  }
}

TEST(ThinScan, CompactKeepsTheLowestPointsWhereThereAreTooMany) {
  // 28,000 cells: a floor 90 m wide and a ceiling 3 m above it, both with a hole over the vehicle.
  std::vector<Eigen::Vector3f> points;
  for (int x = -60; x < 60; ++x)
    for (int y = -60; y < 60; ++y)
      for (const float z : {-1.5F, 1.6F})
        for (const float off : {0.1F, 0.2F})
          if (std::abs(x) + std::abs(y) > 6)
            points.emplace_back(0.75F * static_cast<float>(x) + off, 0.75F * static_cast<float>(y),
                                z);
  const ScanView view = view_of(std::span<const Eigen::Vector3f>(points));
  const auto bytes = encode_thin_scan(view, ThinProfile::kCompact);
  EXPECT_LE(bytes.size(), kMostCompactBytes);
  const SentScan compact = decode_thin_scan(std::as_bytes(std::span(bytes)), "scan");
  EXPECT_EQ(compact.scan.matched, kMaxQueryPoints);
  for (std::size_t i = compact.scan.matched; i < compact.scan.points_lidar.size(); ++i)
    ASSERT_NEAR(compact.scan.points_lidar.positions[i].z(), -1.5F, 0.01F) << i;
}

TEST(ThinScan, OfAnotherVehicleIsRefused) {
  const maps::PointCloud scan = scan_at(pose_at(30.0, 0.0, 0.0), 3, false);
  const auto bytes = encode_thin_scan(view_of(scan), ThinProfile::kExact, 4.0);
  const SentScan of_truck = decode_thin_scan(std::as_bytes(std::span(bytes)), "scan");
  EXPECT_THROW((void)street().aligner->align_thin(of_truck.scan, std::nullopt),
               std::invalid_argument);
  LocalizationOptions truck;
  truck.aligner.own_vehicle_m = 4.0;
  const auto aligner = make_aligner("default", street().index, street().poses, truck);
  const Prior prior = near(pose_at(30.0, 0.0, 0.0));
  expect_equal_bits(aligner->align_thin(of_truck.scan, prior),
                    aligner->align(without_no_returns(scan), prior));
}

std::string why_refused(std::span<const char> bytes) {
  try {
    static_cast<void>(decode_thin_scan(std::as_bytes(bytes), "scan"));
  } catch (const maps::InputError& error) {
    return error.what();
  }
  return {};
}

TEST(ThinScan, CutAnywhereIsRefused) {
  const maps::PointCloud scan = scan_at(pose_at(30.0, 0.0, 0.0), 3, true);
  for (const ThinProfile profile : {ThinProfile::kExact, ThinProfile::kCompact}) {
    const auto bytes = encode_thin_scan(view_of(scan), profile);
    for (std::size_t size = 0; size < bytes.size(); size += size < 100 ? 1 : 997)
      ASSERT_NE(why_refused(std::span(bytes).first(size)), "") << size;
    EXPECT_EQ(why_refused(bytes), "");
  }
}

TEST(ThinScan, BrokenHeadersAreRefusedInWords) {
  const maps::PointCloud scan = scan_at(pose_at(30.0, 0.0, 0.0), 3, true);
  const auto bytes = encode_thin_scan(view_of(scan), ThinProfile::kExact);
  const auto with = [&](std::size_t at, auto value) {
    auto changed = bytes;
    std::memcpy(changed.data() + at, &value, sizeof(value));
    return why_refused(changed);
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(with(0, 'X'), HasSubstr("SMTS in front"));
  EXPECT_THAT(with(4, std::uint8_t{2}), HasSubstr("found version 2"));
  EXPECT_THAT(with(5, std::uint8_t{9}), HasSubstr("profile 9"));
  EXPECT_THAT(with(6, std::uint8_t{0x80}), HasSubstr("flags 128"));
  EXPECT_THAT(with(8, std::uint32_t{400'001}), HasSubstr("400001 points"));
  EXPECT_THAT(with(12, std::uint32_t{4001}), HasSubstr("4001 of them matched"));
  EXPECT_THAT(with(16, std::uint32_t{3}), HasSubstr("of a scan of 3"));
  EXPECT_THAT(with(24, 0.4F), HasSubstr("cells of 0.4 m"));
  EXPECT_THAT(with(28, std::numeric_limits<float>::quiet_NaN()), HasSubstr("nan in the header"));
  EXPECT_THAT(with(40, std::uint32_t{1}), HasSubstr("of the flags 1, 2 and 4 alone"));
  EXPECT_THAT(with(44, std::numeric_limits<float>::infinity()), HasSubstr("point 0 beyond 500 m"));
  EXPECT_THAT(with(bytes.size() - 4, 1.5F), HasSubstr("at 1.5 s"));
  // Says that it is packed, and is not.
  EXPECT_THAT(with(6, std::uint8_t{5}), HasSubstr("zstd frame"));
}

TEST(ThinScan, OfNothingIsNothing) {
  for (const ThinProfile profile : {ThinProfile::kExact, ThinProfile::kCompact}) {
    const auto bytes = encode_thin_scan({}, profile);
    const SentScan none = decode_thin_scan(std::as_bytes(std::span(bytes)), "scan");
    EXPECT_EQ(none.scan.points_lidar.size(), 0U);
    EXPECT_EQ(street().aligner->align_thin(none.scan, std::nullopt).status, PoseStatus::kLost);
  }
}

}  // namespace thin_scan_test
}  // namespace stillmap::localization
