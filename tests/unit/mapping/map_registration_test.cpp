#include "registration/map_registration.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <map>

#include "small_drive.hpp"
#include "support/matchers.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace map_registration_test {

namespace fs = std::filesystem;
using maps::InputError;
using test::IsNearPose;
using test::ThrowsSaying;

constexpr std::size_t kScans = 16;
const maps::GeodeticOrigin kOrigin{49.0, 8.4, 110.0};

test::ScanPattern pattern(std::uint64_t seed) {
  return {.rings = 24, .columns = 300, .noise_m = 0.01, .seed = seed};
}

/// The map of a street, and a drive through a part of it.
class MapRegistration : public ::testing::Test {
 protected:
  /// A package of all that is seen from along the street.
  fs::path write_map(const std::optional<maps::GeodeticOrigin>& origin = std::nullopt) {
    std::vector<Eigen::Isometry3d> seen_from;
    std::vector<maps::StampedPose> poses;
    for (int x = 0; x <= 60; x += 4) {
      seen_from.push_back(test::pose_at(x, 0.3, 0.01 * x));
      poses.push_back({1'000'000'000LL * x, seen_from.back()});
    }
    std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
    for (const Eigen::Vector3d& p : world_.mapped_from(seen_from, pattern(3))) {
      const Eigen::Vector3d q = p - kTileOrigin;
      const maps::TileId id{0, static_cast<std::int32_t>(std::floor(q.x() / maps::kTileSizeM)),
                            static_cast<std::int32_t>(std::floor(q.y() / maps::kTileSizeM))};
      const Eigen::Vector3f f = q.cast<float>();
      tiles[id].push_back({f.x(), f.y(), f.z(), 0.0F, 1, maps::PointKind::kMeasured, 0});
    }
    const fs::path target = folder_.path() / "map";
    maps::MapPackageWriter writer(target);
    for (const auto& [id, points] : tiles) writer.add_tile(id, points);
    writer.write_trajectory(maps::Trajectory(poses));
    maps::MapManifest manifest;
    manifest.frame_id = "depot-2";
    manifest.origin = kTileOrigin;
    manifest.geodetic_origin = origin;
    manifest.voxel_size_m = 0.1;
    writer.publish(manifest, "{}");
    return target;
  }

  /// Scans of the same street, with poses in a frame of their own.
  maps::Drive write_drive(const Eigen::Isometry3d& T_own_map,
                          const test::SyntheticWorld& world) const {
    std::string poses;
    for (std::size_t i = 0; i < kScans; ++i) {
      folder_.write(fmt::format("drive/{:06}.bin", i),
                    test::bin_of(world.scan(T_map_lidar(i), pattern(100 + i))));
      poses += test::kitti_line(T_own_map * T_map_lidar(i));
    }
    folder_.write("drive/poses.txt", poses);
    return maps::Drive::open(folder_.path() / "drive");
  }
  static Eigen::Isometry3d T_map_lidar(std::size_t i) {
    const double s = static_cast<double>(i);
    return test::pose_at(8.0 + 2.5 * s, -0.4 + 0.05 * s, 0.02 * s);
  }

  RegisteredDrives registered(const maps::Drive& drive, const std::string& odometry = "given",
                              const std::vector<std::vector<ScanNote>>& notes = {}) {
    const std::vector<maps::Drive> drives{drive};
    return registered_to(folder_.path() / "map", {drives, notes, odometry}, options_, {}, cancel_);
  }

  static inline const Eigen::Vector3d kTileOrigin{3.0, -2.0, 1.0};
  test::TemporaryFolder folder_;
  test::SyntheticWorld world_ = test::street(11, 80.0);
  MapBuildOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(MapRegistration, PosesThatAreOffAreMovedIntoTheMapsFrame) {
  const std::string digest = maps::MapPackage::open(write_map())->digest();
  const Eigen::Isometry3d T_own_map = maps::exp_se3({1.0, -0.3, 0.1, 0.0, 0.0, 0.035});
  const RegisteredDrives found = registered(write_drive(T_own_map, world_));
  for (std::size_t i = 0; i < kScans; ++i)
    EXPECT_THAT(found.drives[0].T_map_lidar(i), IsNearPose(T_map_lidar(i), 0.03, 0.0017)) << i;
  const maps::Registration& registration = found.frame.registration;
  EXPECT_EQ(registration.previous_digest, digest);
  EXPECT_THAT(registration.T_map_poses, IsNearPose(T_own_map.inverse(), 0.03, 0.0017));
  EXPECT_TRUE(registration.T_previous_map.matrix().isIdentity(0.0));
  EXPECT_GE(registration.scans_used, 8U);
  EXPECT_LE(registration.scans_used, registration.scans_asked);
  EXPECT_LT(registration.residual_m, 0.05);
  EXPECT_EQ(found.frame.frame_id, "depot-2");
  EXPECT_EQ(found.frame.origin, kTileOrigin);
}

TEST_F(MapRegistration, HiddenScansAreNotLookedFor) {
  write_map();
  const maps::Drive drive = write_drive(Eigen::Isometry3d::Identity(), world_);
  const std::size_t all = registered(drive).frame.registration.scans_asked;
  std::vector<std::vector<ScanNote>> notes(1, std::vector<ScanNote>(kScans, ScanNote::kNone));
  notes[0][3] = notes[0][4] = ScanNote::kHidden;
  EXPECT_EQ(registered(drive, "given", notes).frame.registration.scans_asked, all - 2);
}

TEST_F(MapRegistration, PosesThatAgreeAreKeptAndTheMotionIsTold) {
  write_map();
  const maps::Drive drive = write_drive(maps::exp_se3({0.01, 0.0, 0.0, 0.0, 0.0, 0.0}), world_);
  const RegisteredDrives found = registered(drive);
  for (std::size_t i = 0; i < kScans; ++i)
    EXPECT_EQ(found.drives[0].T_map_lidar(i).matrix(), drive.T_map_lidar(i).matrix()) << i;
  const maps::Registration& registration = found.frame.registration;
  EXPECT_TRUE(registration.T_map_poses.matrix().isIdentity(0.0));
  EXPECT_FALSE(registration.T_previous_map.matrix().isIdentity(0.0));
  EXPECT_THAT(registration.T_previous_map,
              IsNearPose(maps::exp_se3({-0.01, 0.0, 0.0, 0.0, 0.0, 0.0}), 0.03, 0.0017));
}

TEST_F(MapRegistration, OdometryIsLookedForEverywhereAndAlwaysMoved) {
  write_map();
  const Eigen::Isometry3d T_own_map = maps::exp_se3({-400.0, 900.0, 3.0, 0.0, 0.0, 2.0});
  const RegisteredDrives found = registered(write_drive(T_own_map, world_), "default");
  for (std::size_t i = 0; i < kScans; ++i)
    EXPECT_THAT(found.drives[0].T_map_lidar(i), IsNearPose(T_map_lidar(i), 0.03, 0.0017)) << i;
  EXPECT_TRUE(found.frame.registration.T_previous_map.matrix().isIdentity(0.0));
}

TEST_F(MapRegistration, GeodesyBringsPosesOfAnotherOriginIntoTheFrame) {
  write_map(kOrigin);
  maps::GeodeticOrigin own = kOrigin;
  own.latitude_deg += 0.01;
  const Eigen::Isometry3d T_map_own = maps::T_enu_enu(kOrigin, own);
  const maps::Drive drive = write_drive(T_map_own.inverse(), world_);
  const RegisteredDrives found = registered(drive.with_poses(drive.contents().T_map_lidar, own));
  EXPECT_EQ(found.drives[0].contents().origin->latitude_deg, kOrigin.latitude_deg);
  EXPECT_EQ(found.frame.registration.T_map_poses.matrix(), T_map_own.matrix())
      << "the Earth's own motion, which leaves nothing to correct";
  for (std::size_t i = 0; i < kScans; ++i)
    EXPECT_THAT(found.drives[0].T_map_lidar(i), IsNearPose(T_map_lidar(i), 1e-6, 1e-9)) << i;
}

TEST_F(MapRegistration, DrivesElsewhereAreRefusedInWords) {
  write_map();
  const maps::Drive drive = write_drive(Eigen::Isometry3d::Identity(), test::street(99, 80.0));
  EXPECT_THAT([&] { (void)registered(drive); }, ThrowsSaying<InputError>({"map", "overlap"}));
}

TEST_F(MapRegistration, PosesThatBendAgainstTheMapAreRefusedInWords) {
  write_map();
  const maps::Drive drive = write_drive(Eigen::Isometry3d::Identity(), world_);
  std::vector<Eigen::Isometry3d> poses = drive.contents().T_map_lidar;
  for (std::size_t i = 0; i < kScans; ++i)
    poses[i].translation().y() += 0.01 * static_cast<double>(i * i);
  EXPECT_THAT([&] { (void)registered(drive.with_poses(poses, std::nullopt)); },
              ThrowsSaying<InputError>({"map", "bent"}));
}

TEST_F(MapRegistration, FewScansAreRefusedInWords) {
  write_map();
  options_.selection = maps::Selection::parse("::4");
  EXPECT_THAT([&] { (void)registered(write_drive(Eigen::Isometry3d::Identity(), world_)); },
              ThrowsSaying<InputError>({"map", "at least 8"}));
}

TEST_F(MapRegistration, SameBitsForAnyNumberOfThreads) {
  write_map();
  const maps::Drive drive = write_drive(maps::exp_se3({0.5, 0.5, 0.0, 0.0, 0.0, 0.0}), world_);
  options_.threads = 1;
  const Eigen::Isometry3d alone = registered(drive).frame.registration.T_map_poses;
  options_.threads = 3;
  EXPECT_EQ(registered(drive).frame.registration.T_map_poses.matrix(), alone.matrix());
}

}  // namespace map_registration_test
}  // namespace stillmap::mapping
