#include <stillmap/mapping/map_patch.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_graph.hpp>
#include <stillmap/maps/package_files.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>

#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace map_patch_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::IsEmpty;

/// A street of 160 m that is mapped, and driven again from 60 to 110 m on another day.
class MapPatchTest : public ::testing::Test {
 protected:
  /// A house that is there on the first day alone, and one of the second, each where the street
  /// has a gap.
  static constexpr double kOldX = 84.0, kNewX = 92.0;

  static void SetUpTestSuite() {
    folder_ = std::make_unique<test::TemporaryFolder>();
    test::SyntheticWorld first = test::street(21, 160.0), second = first;
    first.boxes.push_back(house(kOldX));
    second.boxes.push_back(house(kNewX));
    const fs::path before = write_drive("before", first, 0.0, 160.0, 0.0, 1);
    const fs::path again = write_drive("again", second, 60.0, 110.0, 0.4, 2);
    (void)build({before}, "map", {});
    (void)build({again}, "drive", options(true));
    (void)build({write_drive("bent", second, 60.0, 110.0, 0.4, 2, 0.1)}, "bent", options(false));
    (void)build({folder_->path() / "bent_drive"}, "followed", options(true));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static test::SyntheticWorld::Box house(double x) { return {{x, 6.8, 0.0}, {x + 4.0, 7.4, 3.0}}; }

  /// @param bend_m  how far the poses of the last third are off to the side.
  static fs::path write_drive(const std::string& name, const test::SyntheticWorld& world,
                              double from_m, double to_m, double y_m, std::uint64_t seed,
                              double bend_m = 0.0) {
    test::ScanPattern pattern;
    pattern.columns = 500;
    pattern.noise_m = 0.01;
    pattern.seed = 1000 * seed;
    std::string poses;
    std::size_t scan = 0;
    for (double x = from_m; x <= to_m; x += 1.5, ++scan, ++pattern.seed) {
      const Eigen::Isometry3d T = test::pose_at(x, y_m, 0.01);
      folder_->write(fmt::format("{}_drive/{:06}.bin", name, scan),
                     test::bin_of(world.scan(T, pattern)));
      Eigen::Isometry3d told = T;
      if (x > from_m + 2.0 * (to_m - from_m) / 3.0) told.translation().y() += bend_m;
      poses += test::kitti_line(told);
    }
    folder_->write(name + "_drive/poses.txt", poses);
    return folder_->path() / (name + "_drive");
  }

  static MapBuildOptions options(bool follows) {
    MapBuildOptions options;
    options.register_to = folder_->path() / "map";
    options.follows_map = follows;
    return options;
  }
  static MapBuildResult build(const std::vector<fs::path>& drives, const std::string& name,
                              MapBuildOptions options) {
    options.detector = "geometric";
    options.given_poses = GivenPosesUse::kExact;
    const CancelFlag cancel{false};
    return build_map(drives, folder_->path() / name, options, {}, cancel);
  }

  static std::shared_ptr<const maps::MapPackage> open(const std::string& name) {
    return maps::MapPackage::open(folder_->path() / name);
  }
  static PatchResult patch(const std::string& drive, const std::string& name,
                           const PatchOptions& options = {}) {
    const CancelFlag cancel{false};
    return patch_map(*open("map"), *open(drive), folder_->path() / name, options, {}, cancel);
  }
  /// Measured points in a box of the map frame.
  static std::size_t points_in(const std::string& name, const Eigen::AlignedBox3d& box) {
    const auto map = open(name);
    std::size_t inside = 0;
    for (const maps::TileEntry& entry : map->tiles()) {
      const maps::MapTile tile = map->tile(entry.id);
      for (const maps::MapPoint& point : tile)
        inside += maps::is_measured(point.kind) && box.contains(tile.position(point)) ? 1 : 0;
    }
    return inside;
  }
  static std::uint64_t bytes_in(const fs::path& package) {
    std::uint64_t bytes = 0;
    const auto opened = maps::MapPackage::open(package);
    for (const auto& [path, file] : opened->manifest().files) bytes += file.bytes;
    return bytes;
  }
  static Eigen::AlignedBox3d around(const test::SyntheticWorld::Box& house) {
    const Eigen::Vector3d margin = Eigen::Vector3d::Constant(0.1);
    Eigen::AlignedBox3d box(house.min - margin, house.max + margin);
    box.min().z() = 0.3;
    return box;
  }

  static std::unique_ptr<test::TemporaryFolder> folder_;
};
std::unique_ptr<test::TemporaryFolder> MapPatchTest::folder_;

TEST_F(MapPatchTest, ChangesTheTilesThatTheDriveSawAndNoOthers) {
  const PatchResult result = patch("drive", "patched");
  const auto before = open("map"), after = open("patched"), drive = open("drive");
  EXPECT_EQ(after->digest(), result.digest);
  EXPECT_THAT(after->verify(), IsEmpty());
  const auto ids = tiles_to_patch(*before, *drive, {});
  EXPECT_GT(ids.size(), 3U);
  std::size_t same = 0;
  for (const maps::TileEntry& tile : before->tiles()) {
    if (ids.contains(tile.id)) continue;
    ++same;
    EXPECT_EQ(after->stored_name(tile.id).sha256, before->stored_name(tile.id).sha256);
    // None in the street, where it was driven.
    const Eigen::AlignedBox3d bounds = before->manifest().bounds_of(tile);
    EXPECT_FALSE(bounds.contains(Eigen::Vector3d(85.0, 0.0, bounds.center().z())));
  }
  EXPECT_GT(same, 5U);
  EXPECT_EQ(result.tiles_kept, same);
  EXPECT_EQ(result.tiles_new, ids.size());
  EXPECT_LT(result.worst_seam_m, 0.01);
  EXPECT_GT(result.seams, 10U);
  // More than half of the only region is new, so its pack holds the other tiles, too: nothing lies
  // there twice.
  EXPECT_LT(result.bytes, 1.3 * static_cast<double>(bytes_in(folder_->path() / "map")));
}

TEST_F(MapPatchTest, TakesWhatIsGoneAndAddsWhatIsNew) {
  if (!fs::exists(folder_->path() / "patched")) (void)patch("drive", "patched");
  EXPECT_GT(points_in("map", around(house(kOldX))), 100U);
  EXPECT_EQ(points_in("map", around(house(kNewX))), 0U);
  // A point at the foot or the rim may lie beside a cube that was seen free.
  EXPECT_LT(points_in("patched", around(house(kOldX))),
            points_in("map", around(house(kOldX))) / 10);
  EXPECT_GT(points_in("patched", around(house(kNewX))), 100U);
  // What stands elsewhere still does, about as densely.
  const Eigen::AlignedBox3d street(Eigen::Vector3d(100.0, -12.0, 0.5),
                                   Eigen::Vector3d(105.0, 12.0, 4.0));
  EXPECT_GT(points_in("patched", street), 0.9 * static_cast<double>(points_in("map", street)));
}

TEST_F(MapPatchTest, KeepsDrivesObjectsPosesAndGraph) {
  if (!fs::exists(folder_->path() / "patched")) (void)patch("drive", "patched");
  const auto before = open("map"), after = open("patched"), drive = open("drive");
  ASSERT_EQ(after->manifest().drives.size(), 2U);
  EXPECT_EQ(after->trajectories().size(), 2U);
  EXPECT_EQ(after->trajectories()[1].size(), drive->trajectories()[0].size());
  const auto objects = after->objects();
  EXPECT_EQ(objects.size(), before->objects().size() + drive->objects().size());
  for (const std::string& path : {maps::trajectory_path(0), maps::fates_path(0)})
    EXPECT_EQ(after->manifest().files.at(path).sha256, before->manifest().files.at(path).sha256);
  EXPECT_EQ(after->manifest().files.at(maps::fates_path(1)).sha256,
            drive->manifest().files.at(maps::fates_path(0)).sha256);
  // Numbers of scans go on behind those of the map.
  const auto scans = static_cast<std::uint32_t>(before->trajectories()[0].size());
  std::size_t of_drive = 0;
  for (const maps::TileId id : tiles_to_patch(*before, *drive, {}))
    for (const maps::PointHistory& each : after->history(id)) of_drive += each.first_scan >= scans;
  EXPECT_GT(of_drive, 1000U);
  EXPECT_EQ(after->manifest().sources.at("drive_2"), "again_drive");
  std::ifstream sources(after->folder() / "sources.sha256");
  EXPECT_EQ(static_cast<std::size_t>(std::count(std::istreambuf_iterator<char>(sources), {}, '\n')),
            scans + drive->trajectories()[0].size());
}

TEST_F(MapPatchTest, AnswersInPatchedAndOtherParts) {
  if (!fs::exists(folder_->path() / "patched")) (void)patch("drive", "patched");
  const auto aligner = localization::make_aligner("default", *open("patched"));
  test::SyntheticWorld world = test::street(21, 160.0);
  world.boxes.push_back(house(kNewX));
  test::ScanPattern pattern;
  pattern.noise_m = 0.01;
  for (const double x : {20.0, 52.0, 61.0, 85.0, 109.0, 120.0, 140.0}) {
    const Eigen::Isometry3d T = test::pose_at(x, -0.5, 0.05);
    localization::Prior prior;
    prior.T_map_lidar = test::pose_at(x + 0.6, 0.0, 0.0);
    const auto answer = aligner->align(world.scan(T, pattern), prior);
    EXPECT_EQ(answer.status, localization::PoseStatus::kOk) << x;
    EXPECT_LT((answer.T_map_lidar.translation() - T.translation()).norm(), 0.03) << x;
  }
}

TEST_F(MapPatchTest, HasTheSameBytesForAnyNumberOfThreads) {
  PatchOptions options;
  options.threads = 1;
  const PatchResult one = patch("drive", "one", options);
  options.threads = 3;
  EXPECT_EQ(patch("drive", "three", options).digest, one.digest);
}

TEST_F(MapPatchTest, RefusesADriveWhosePosesAreBentAgainstTheMapWithThePlace) {
  EXPECT_THAT([&] { (void)patch("bent", "refused"); },
              ThrowsSaying<maps::InputError>({"ground and walls 0.0", "m from those of the new",
                                              "within 0.02 m", "without --patch"}));
  EXPECT_FALSE(fs::exists(folder_->path() / "refused"));
}

/// A copy of the drive's map whose points are moved.
std::shared_ptr<const maps::MapPackage> moved(const maps::MapPackage& drive, const fs::path& place,
                                              const Eigen::Vector3d& by_m) {
  maps::MapPackageWriter writer(place);
  writer.set_drives(drive.drive_counts());
  for (const maps::TileEntry& entry : drive.tiles()) {
    const Eigen::Vector3d corner = maps::corner_of(entry.id);
    const auto near = [](double value) { return std::clamp(value, 0.0, 19.9998); };
    std::vector<maps::MapPoint> points = drive.tile(entry.id).points_from(corner);
    for (maps::MapPoint& p : points)
      p = maps::moved_to(p, {near(p.x + by_m.x()), near(p.y + by_m.y()), p.z + by_m.z()});
    writer.add_tile(entry.id, maps::MapTile(drive.manifest().origin, corner, std::move(points)),
                    drive.history(entry.id), drive.evidence(entry.id));
  }
  for (std::size_t i = 0; i < drive.drive_counts().size(); ++i) writer.take_drive(drive, i, i);
  writer.publish(drive.manifest(), "{}");
  return maps::MapPackage::open(place);
}

TEST_F(MapPatchTest, RefusesASeamOfFiveCentimetresInAnyDirection) {
  const CancelFlag cancel{false};
  for (const Eigen::Vector3d& by_m :
       {Eigen::Vector3d(0.0, 0.05, 0.0), Eigen::Vector3d(0.05, 0.0, 0.0),
        Eigen::Vector3d(0.0, 0.0, -0.05), Eigen::Vector3d(0.03, 0.03, 0.03)}) {
    const std::string name = fmt::format("moved_{}_{}_{}", by_m.x(), by_m.y(), by_m.z());
    const auto drive = moved(*open("drive"), folder_->path() / name, by_m);
    EXPECT_THAT(
        [&] { (void)patch_map(*open("map"), *drive, folder_->path() / "no", {}, {}, cancel); },
        ThrowsSaying<maps::InputError>({"ground and walls 0.0"}))
        << by_m.transpose();
  }
  const auto near = moved(*open("drive"), folder_->path() / "near", {0.005, 0.005, 0.005});
  EXPECT_LT(patch_map(*open("map"), *near, folder_->path() / "yes", {}, {}, cancel).worst_seam_m,
            0.02);
}

TEST_F(MapPatchTest, BendsADriveToTheMapWhenItIsBuiltForAPatch) {
  EXPECT_LT(patch("followed", "followed_patch").worst_seam_m, 0.02);
}

TEST_F(MapPatchTest, RefusesMapsThatDoNotGoTogether) {
  EXPECT_THAT([&] { (void)patch("map", "refused"); },
              ThrowsSaying<maps::InputError>({"frame of its own", "--register-to"}));
  MapBuildOptions coarse = options(true);
  coarse.voxel_size_m = 0.2;
  (void)build({folder_->path() / "again_drive"}, "coarse", coarse);
  EXPECT_THAT([&] { (void)patch("coarse", "refused"); },
              ThrowsSaying<maps::InputError>({"voxels of 0.2 m", "--voxel 0.1"}));
  PatchOptions options;
  options.most_seam_m = 1.0;
  EXPECT_THAT([&] { (void)patch("drive", "refused", options); },
              ThrowsSaying<std::invalid_argument>({"most_seam_m"}));
}

TEST(PatchResult, IsReadBack) {
  PatchResult result;
  result.digest = "abc";
  result.tiles_new = 3;
  result.bytes = 1ULL << 40;
  result.worst_seam_m = 0.0125;
  result.worst_seam_at_map = Eigen::Vector3d(1e6 + 0.125, 2.0, 3.0);
  const std::string text = to_json(result);
  EXPECT_EQ(to_json(patch_result_from(text)), text);
  EXPECT_THROW((void)patch_result_from("{}"), std::invalid_argument);
}

}  // namespace map_patch_test
}  // namespace stillmap::mapping
