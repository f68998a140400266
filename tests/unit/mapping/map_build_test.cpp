#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "pipeline/map_build_json.hpp"
#include "pipeline/scan_work.hpp"
#include "pipeline/surveyed_scan_bytes.hpp"
#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace map_build_test {

using maps::InputError;
using test::ThrowsSaying;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Key;
using ::testing::Not;

class MapBuild : public ::testing::Test {
 protected:
  MapBuild() : drive_(small_.write(folder_)) {
    options_.threads = 1;
    // Four scans between smooth walls tell little of the way along them, and these poses are true.
    options_.given_poses = GivenPosesUse::kExact;
  }

  MapBuildResult build(const std::string& name = "map") {
    return build_map({drive_}, folder_.path() / "maps" / name, options_, progress_, cancel_);
  }
  [[nodiscard]] std::shared_ptr<const maps::MapPackage> open(
      const std::string& name = "map") const {
    return maps::MapPackage::open(folder_.path() / "maps" / name);
  }
  /// Everything beside the maps, hidden files too.
  [[nodiscard]] std::set<std::string> names_in_maps() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "maps"))
      names.insert(entry.path().filename().string());
    return names;
  }
  void use_boxes() { options_.detector = "boxes:" + small_.write_car(folder_).string(); }
  void SetUp() override { std::filesystem::create_directories(folder_.path() / "maps"); }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  std::filesystem::path drive_;
  MapBuildOptions options_;
  ProgressCallback progress_;
  CancelFlag cancel_{false};
};

std::map<maps::PointKind, std::uint64_t> observations_by_kind(const maps::MapPackage& map) {
  std::map<maps::PointKind, std::uint64_t> observations;
  for (const maps::TileEntry& tile : map.tiles()) {
    for (const maps::MapPoint& point : map.tile(tile.id))
      observations[point.kind] += point.observations;
  }
  return observations;
}

TEST_F(MapBuild, HasTheSameGroundAndObjectsHoweverTheSensorIsMounted) {
  const auto counts = [&](const Eigen::Vector3d& axis, double angle_rad, bool boxes) {
    const test::TemporaryFolder folder;
    test::SmallDrive drive = small_;
    drive.R_old_new = Eigen::AngleAxisd(angle_rad, axis).toRotationMatrix();
    options_.detector = boxes ? "boxes:" + drive.write_car(folder).string() : "geometric";
    const MapBuildResult report =
        build_map({drive.write(folder)}, folder.path() / "map", options_, progress_, cancel_);
    return std::pair(report.points.at("ground"),
                     report.points.at("projected") + report.points.at("deleted"));
  };
  for (const bool boxes : {false, true}) {
    const auto upright = counts(Eigen::Vector3d::UnitX(), 0.0, boxes);
    ASSERT_GT(upright.first, 1000U);
    ASSERT_GT(upright.second, 100U);
    for (const auto& [axis, deg] : {std::pair(Eigen::Vector3d::UnitY().eval(), 25.0),
                                    std::pair(Eigen::Vector3d::UnitX().eval(), -60.0),
                                    std::pair(Eigen::Vector3d::UnitX().eval(), 180.0)}) {
      const auto tilted = counts(axis, deg * std::numbers::pi / 180.0, boxes);
      const auto near = [](std::uint64_t value) { return 0.05 * static_cast<double>(value); };
      EXPECT_NEAR(static_cast<double>(tilted.first), static_cast<double>(upright.first),
                  near(upright.first))
          << deg;
      EXPECT_NEAR(static_cast<double>(tilted.second), static_cast<double>(upright.second),
                  near(upright.second))
          << deg << (boxes ? " boxes" : " geometric");
    }
  }
}

TEST_F(MapBuild, KeepsObstaclesForTheDetectorThatIsJudgedByThem) {
  const DriveSet drives({maps::Drive::open(drive_)}, options_);
  const VoxelGrid grid(Eigen::Vector3d::Zero(), options_.voxel_size_m);
  const auto obstacles = [&] {
    return ScanWork(drives, options_, grid).survey(0).obstacles.voxels.size();
  };
  options_.detector = "geometric";
  EXPECT_GT(obstacles(), 100U);
  use_boxes();
  EXPECT_EQ(obstacles(), 0U);
}

TEST_F(MapBuild, OtherDrivesChangeNothingInTheSurveyOfADrive) {
  // Mounted otherwise, so what is learned of the ground is otherwise.
  const test::TemporaryFolder folder;
  test::SmallDrive tilted;
  tilted.R_old_new =
      Eigen::AngleAxisd(25.0 * std::numbers::pi / 180.0, Eigen::Vector3d::UnitY()).matrix();
  const std::filesystem::path other = tilted.write(folder);
  options_.detector = "geometric";
  const VoxelGrid grid(Eigen::Vector3d::Zero(), options_.voxel_size_m);
  const auto surveyed = [&](const std::vector<std::filesystem::path>& folders, std::size_t first) {
    std::vector<maps::Drive> opened;
    for (const std::filesystem::path& each : folders) opened.push_back(maps::Drive::open(each));
    const DriveSet drives(opened, options_);
    const ScanWork work(drives, options_, grid);
    std::vector<std::string> bytes;
    for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) {
      SurveyedScan scan = work.survey(first + i);
      scan.scan = i;
      scan.stage_seconds.clear();
      bytes.push_back(to_bytes(scan));
    }
    return bytes;
  };
  const auto alone = surveyed({drive_}, 0);
  EXPECT_EQ(surveyed({drive_, other}, 0), alone);
  EXPECT_EQ(surveyed({other, drive_}, test::SmallDrive::kScans), alone);
}

TEST_F(MapBuild, WarnsWhenManyPointsAreNearerThanWhatCarriesTheSensor) {
  use_boxes();
  EXPECT_THAT(build().warnings, IsEmpty());
  options_.min_range_m = 12.0;
  const MapBuildResult report = build("much");
  const std::uint64_t in = report.points.at("in");
  const std::uint64_t near = report.points.at("dropped_too_near");
  ASSERT_GT(near, in / 5);
  EXPECT_THAT(
      report.warnings,
      ElementsAre(testing::StartsWith(fmt::format(
          "{:.0f} % of the points are left out, because they are nearer than --min-range 12 m",
          100.0 * static_cast<double>(near) / static_cast<double>(in)))));
}

TEST(MapBuildReport, IsReadAsItIsWritten) {
  MapBuildResult result;
  EXPECT_EQ(to_json(build_result_from(to_json(result))), to_json(result));
  result.scans = 4;
  result.resumed_scans = 1;
  result.seconds = 2.5;
  result.scans_per_second = 1.6;
  result.peak_rss_mib = 70.5;
  result.points = {{"in", 9}};
  result.objects = {{"parked", 2}};
  result.trajectory = {{"key_frames", 3}};
  result.given_poses.emplace();
  result.given_poses->use = GivenPosesUse::kExact;
  GivenPoseErrors& errors = result.given_poses->errors;
  errors.by_way = {{}, {.way_m = 5.0, .pairs = 2, .median_m = 0.5}};
  errors.loops = {.pairs = 1, .p95_m = 0.25, .max_rad = 0.75};
  errors.sigma_m = 0.125;
  errors.sigma_rad = 0.5;
  errors.asked = 7;
  errors.denied = 6;
  result.given_poses->neighbours_apart = 5;
  result.given_poses->moved = {.max_m = 1.5, .median_rad = 0.5, .p95_rad = 0.625};
  result.pose_faults = {{"gaps", "what", "remedy"}};
  result.found_pose_time_offsets_s = {0.5};
  result.consistency = {.mean_map_entropy = -2.5,
                        .entropy_points = 8,
                        .walls = {.cells = 4, .planar_cells = 2, .median_m = 0.5, .p95_m = 0.75},
                        .ground = {}};
  result.stage_seconds = {{"survey", 0.5}};
  result.warnings = {"w"};
  maps::Registration& registration = result.registration.emplace();
  registration.previous_digest = "p";
  registration.T_previous_map.translation() = Eigen::Vector3d(1.0, 2.0, 3.0);
  registration.T_map_poses.linear() =
      Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitY()).toRotationMatrix();
  registration.residual_m = 0.5;
  registration.residual_rad = 0.25;
  registration.scans_used = 2;
  registration.scans_asked = 3;
  result.merged_from = "m";
  result.digest = "d";
  const MapBuildResult read = build_result_from(to_json(result));
  EXPECT_EQ(to_json(read), to_json(result));
  // Neighbours are the first, also when no two scans are.
  EXPECT_EQ(read.given_poses->errors.by_way.front().pairs, 0U);
  EXPECT_THROW((void)build_result_from("{}"), std::invalid_argument);
  EXPECT_THROW((void)build_result_from(""), std::invalid_argument);
}

TEST_F(MapBuild, ReportsTheConsistencyThatIsFoundInThePackage) {
  options_.threads = 2;
  const MapBuildResult report = build();
  const std::string found = to_json(map_consistency(*open(), 1, {}, cancel_));
  EXPECT_EQ(to_json(report.consistency), found);
  EXPECT_GT(report.consistency.walls.planar_cells, 20U);
  EXPECT_GT(report.consistency.entropy_points, 1000U);
  std::ifstream stream(open()->folder() / "build.json");
  EXPECT_EQ(nlohmann::json::parse(stream).at("consistency"), nlohmann::json::parse(found));
}

TEST_F(MapBuild, CountsEveryPointOnceInTheManifest) {
  maps::PointCloud cloud = small_.scan(0);
  const std::size_t good = cloud.size();
  cloud.positions.emplace_back(1.0F, 0.0F, 0.0F);
  cloud.positions.emplace_back(90.0F, 0.0F, 0.0F);
  cloud.positions.emplace_back(85.0F, 9.0F, 0.0F);
  cloud.positions.emplace_back(std::nanf(""), 0.0F, 0.0F);
  cloud.positions.emplace_back(0.0F, 0.0F, 0.0F);
  folder_.write("drive/000000.bin", test::bin_of(cloud));
  use_boxes();
  const MapBuildResult report = build();
  const auto map = open();
  const auto& counts = map->manifest().counts;
  std::uint64_t in = 5 + good;
  for (std::size_t i = 1; i < test::SmallDrive::kScans; ++i) in += small_.scan(i).size();
  EXPECT_EQ(counts.at("in"), in);
  EXPECT_EQ(counts.at("dropped_too_near"), 1U);
  EXPECT_EQ(counts.at("dropped_too_far"), 2U);
  EXPECT_EQ(counts.at("dropped_non_finite"), 1U);
  EXPECT_EQ(counts.at("dropped_zero_range"), 1U);
  EXPECT_EQ(counts.at("scans"), 4U);
  EXPECT_EQ(counts.at("scans_empty"), 0U);
  EXPECT_EQ(counts.at("objects_boxes"), 4U);
  EXPECT_EQ(counts.at("objects_parked"), 1U);
  EXPECT_EQ(counts.at("objects_moving"), 0U);
  EXPECT_EQ(counts.at("deleted"), 0U);
  const auto observations = observations_by_kind(*map);
  EXPECT_EQ(observations.at(maps::PointKind::kProjected), counts.at("projected"));
  EXPECT_GT(counts.at("projected"), 100U);
  EXPECT_EQ(observations.at(maps::PointKind::kMeasured) +
                observations.at(maps::PointKind::kGround) + counts.at("projected"),
            in - 5);
  std::uint64_t points = 0;
  for (const maps::TileEntry& tile : map->tiles()) points += tile.points;
  EXPECT_EQ(counts.at("static"), points);
  for (const auto& [name, count] : report.points) EXPECT_EQ(counts.at(name), count) << name;
  EXPECT_EQ(report.digest, map->digest());
}

TEST_F(MapBuild, WritesAWholePackageWithPosesObjectsAndSources) {
  use_boxes();
  options_.selection = maps::Selection::parse("::2");
  (void)build();
  const auto map = open();
  EXPECT_THAT(map->verify(), IsEmpty());
  const auto& options = map->manifest().options;
  EXPECT_EQ(options.at("select"), "0::2");
  EXPECT_EQ(options.at("detector"), "boxes:boxes.json");
  EXPECT_EQ(options.at("movable"), "project");
  EXPECT_EQ(map->manifest().sources.at("drive"), "drive");
  EXPECT_EQ(map->manifest().sources.at("boxes_sha256"),
            maps::sha256_of_file(folder_.path() / "boxes.json"));
  EXPECT_TRUE(map->manifest().files.contains("preview.png"));
  ASSERT_EQ(map->trajectories().size(), 1U);
  const maps::Trajectory trajectory = map->trajectories()[0];
  ASSERT_EQ(trajectory.size(), 2U);
  EXPECT_NEAR(trajectory.poses()[1].T_map_lidar.translation().x(), 2.0, 1e-12);
  const std::vector<maps::MapObject> objects = map->objects();
  ASSERT_EQ(objects.size(), 1U);
  EXPECT_EQ(objects[0].motion, maps::ObjectMotion::kParked);
  EXPECT_EQ(objects[0].last_scan, 1U);
  EXPECT_EQ(objects[0].detections, 2U);
  EXPECT_NEAR(objects[0].placements[0].centre_map.x(), 10.15, 1e-6);
  EXPECT_NEAR(objects[0].placements[0].centre_map.y(), 3.9, 1e-6);
  EXPECT_NEAR(objects[0].placements[0].yaw_rad, 0.0, 1e-6);
  EXPECT_EQ(objects[0].points_removed, map->manifest().counts.at("projected"));
  std::ifstream sources(map->folder() / "sources.sha256");
  std::string first;
  std::getline(sources, first);
  EXPECT_EQ(first, maps::sha256_of_file(drive_ / "000000.bin") + "  000000.bin");
}

TEST_F(MapBuild, GivesTheSameBytesForAnyNumberOfThreads) {
  const std::string serial = build("one").digest;
  options_.threads = 2;
  EXPECT_EQ(build("two").digest, serial);
  options_.threads = 5;
  EXPECT_EQ(build("five").digest, serial);
  options_.threads = 0;
  EXPECT_EQ(build("all").digest, serial);
}

TEST_F(MapBuild, PutsNoPointAboveTheGroundWhereTheCarStood) {
  use_boxes();
  (void)build();
  const auto map = open();
  for (const maps::TileEntry& entry : map->tiles()) {
    const maps::MapTile tile = map->tile(entry.id);
    for (const maps::MapPoint& p : tile) {
      const Eigen::Vector3d q = tile.position(p);
      const bool in_car = q.x() > 8.0 && q.x() < 12.3 && q.y() > 3.0 && q.y() < 4.8;
      if (in_car) {
        ASSERT_LT(q.z(), 0.2);
      }
      if (p.kind == maps::PointKind::kProjected) {
        ASSERT_NEAR(q.z(), 0.0, 0.05);
      }
    }
  }
}

TEST_F(MapBuild, DeletesOrKeepsAsAsked) {
  use_boxes();
  options_.projection.policy = MovablePolicy::kDelete;
  const auto deleted = build("deleted").points;
  EXPECT_GT(deleted.at("deleted"), 100U);
  EXPECT_EQ(deleted.at("projected"), 0U);
  options_.projection.policy = MovablePolicy::kKeep;
  const MapBuildResult kept = build("kept");
  EXPECT_EQ(kept.points.at("deleted"), 0U);
  EXPECT_EQ(kept.points.at("projected"), 0U);
  EXPECT_EQ(kept.objects.at("boxes"), 0U);
}

TEST_F(MapBuild, CountsLabelsThatPointOutsideOfTheDrive) {
  maps::BoxSequence boxes;
  boxes.by_scan[0] = {small_.car_in(0)};
  boxes.by_scan[test::SmallDrive::kScans + 3] = {small_.car_in(0), small_.car_in(1)};
  maps::write_boxes(folder_.path() / "outside.json", boxes);
  options_.detector = "boxes:" + (folder_.path() / "outside.json").string();
  const MapBuildResult report = build();
  EXPECT_EQ(report.objects.at("boxes"), 1U);
  EXPECT_EQ(report.objects.at("dropped: frame beyond the drive"), 2U);
}

TEST_F(MapBuild, RefusesABoxThatNoSensorSeesOrNoObjectFills) {
  options_.detector = "boxes:" + (folder_.path() / "wild.json").string();
  const auto refuse = [&](const maps::Box& box, const char* found) {
    maps::BoxSequence boxes;
    boxes.by_scan[1] = {small_.car_in(1), box};
    maps::write_boxes(folder_.path() / "wild.json", boxes);
    EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({"wild.json", found}));
    EXPECT_THAT(names_in_maps(), IsEmpty());
  };
  maps::Box far = small_.car_in(1), huge = small_.car_in(1);
  far.centre.x() = -1e300;
  huge.size_m.y() = 1e12;
  refuse(far, "centre");
  refuse(huge, "size");
}

TEST_F(MapBuild, TellsProgressScanByScan) {
  std::vector<std::size_t> done;
  progress_ = [&](std::string_view stage, std::size_t units, std::size_t total) {
    if (stage == "place") {
      done.push_back(units);
      EXPECT_EQ(total, 4U);
    }
  };
  (void)build();
  EXPECT_THAT(done, ElementsAre(1, 2, 3, 4));
}

TEST_F(MapBuild, CountsAnEmptyScanAndGoesOn) {
  folder_.write("drive/000002.bin", "");
  EXPECT_EQ(build().points.at("scans_empty"), 1U);
}

TEST_F(MapBuild, KeepsAHiddenScanOutAndSaysSo) {
  const std::uint64_t points = small_.scan(2).size();
  (void)build("clean");
  EXPECT_THAT(open("clean")->manifest().counts, Not(Contains(Key("scans_hidden"))));
  // Beyond the range that is left out near the sensor.
  maps::PointCloud shell = small_.scan(2);
  for (Eigen::Vector3f& p : shell.positions) p *= 4.0F / p.norm();
  folder_.write("drive/000002.bin", test::bin_of(shell));
  use_boxes();
  options_.clean = "none";
  for (const GivenPosesUse use : {GivenPosesUse::kExact, GivenPosesUse::kRefine}) {
    options_.given_poses = use;
    const std::string name(name_of(use));
    const MapBuildResult report = build(name);
    EXPECT_EQ(report.points.at("scans_hidden"), 1U);
    EXPECT_EQ(report.points.at("dropped_hidden"), points);
    EXPECT_EQ(report.points.at("scans_empty"), 0U);
    EXPECT_EQ(report.objects.at("boxes"), 3U) << "nothing is detected in it";
    EXPECT_THAT(report.warnings,
                Contains(AllOf(HasSubstr("1 of 4 scans"), HasSubstr("scan 2 (000002.bin)"))));
    const auto map = open(name);
    EXPECT_EQ(map->manifest().counts.at("scans_hidden"), 1U);
    // Nothing in the air between the walls but the car.
    for (const maps::TileEntry& entry : map->tiles()) {
      const maps::MapTile tile = map->tile(entry.id);
      for (const maps::MapPoint& p : tile) {
        const Eigen::Vector3d q = tile.position(p);
        EXPECT_FALSE(q.z() > 0.3 && q.y() > -7.5 && q.y() < 2.5) << q.transpose();
      }
    }
  }
}

TEST_F(MapBuild, LeavesNothingBehindWhenAScanIsTruncated) {
  std::string bytes = test::bin_of(small_.scan(2));
  bytes.resize(bytes.size() - 3);
  folder_.write("drive/000002.bin", bytes);
  for (const int threads : {1, 2}) {
    options_.threads = threads;
    EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({"000002.bin", "multiple of 16"}));
    EXPECT_THAT(names_in_maps(), IsEmpty());
  }
}

TEST_F(MapBuild, LeavesOnlyWhatItGoesOnFromWhenCancelled) {
  for (const int threads : {1, 2}) {
    cancel_ = false;
    options_.threads = threads;
    progress_ = [&](std::string_view, std::size_t done, std::size_t) {
      if (done == 1) cancel_ = true;
    };
    EXPECT_THROW((void)build(), Cancelled);
    EXPECT_THAT(names_in_maps(), ElementsAre(".map.partial"));
  }
}

TEST_F(MapBuild, HoldsEveryNthSelectedScanBackButNeverTheLast) {
  options_.held_back_every = 2;
  options_.selection.begin = 1;
  EXPECT_THAT(options_.held_back_of(8), ElementsAre(2, 4, 6));
  EXPECT_THAT(options_.scans_of(8), ElementsAre(1, 3, 5, 7));
  EXPECT_THAT(options_.held_back_of(7), ElementsAre(2, 4));
  options_.held_back_every = 0;
  EXPECT_THAT(options_.held_back_of(8), IsEmpty());
  options_.held_back_every = 1;
  EXPECT_FALSE(options_.violations().empty());
}

TEST_F(MapBuild, IsMadeFromTheScansThatAreNotHeldBack) {
  options_.held_back_every = 2;
  EXPECT_EQ(build().scans, 3U);
  EXPECT_EQ(open()->manifest().options.at("held_back_every"), "2");
}

TEST_F(MapBuild, RefusesADriveWithoutPosesWhereGivenOnesAreAskedFor) {
  std::filesystem::remove(drive_ / "poses.txt");
  options_.odometry = "given";
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({drive_.string(), "poses"}));
  EXPECT_THAT(names_in_maps(), IsEmpty());
}

TEST_F(MapBuild, TakesGivenPosesForADriveWithoutItsOwn) {
  std::filesystem::rename(drive_ / "poses.txt", folder_.path() / "given.txt");
  options_.poses_file = folder_.path() / "given.txt";
  (void)build();
  EXPECT_EQ(open()->manifest().options.at("poses"), "given.txt");
  EXPECT_EQ(open()->manifest().sources.at("poses_sha256"),
            maps::sha256_of_file(folder_.path() / "given.txt"));
}

TEST_F(MapBuild, TakesThePlaceOfTheGivenPosesFrame) {
  options_.geodetic_origin = maps::GeodeticOrigin{49.0, 8.4, 116.5};
  static_cast<void>(build());
  const maps::MapManifest& manifest = open()->manifest();
  ASSERT_TRUE(manifest.geodetic_origin);
  EXPECT_EQ(manifest.geodetic_origin->longitude_deg, 8.4);
  EXPECT_EQ(manifest.frame_id, "enu");
  std::filesystem::remove(drive_ / "poses.txt");
  EXPECT_THAT([&] { static_cast<void>(build("other")); },
              ThrowsSaying<InputError>({"no poses beside a geodetic origin"}));
  options_.geodetic_origin->latitude_deg = 91.0;
  EXPECT_THAT([&] { static_cast<void>(build("other")); },
              ThrowsSaying<std::invalid_argument>({"latitude_deg: 91"}));
}

TEST_F(MapBuild, RefusesAPoseThatNoDriveReaches) {
  small_.T_map_lidar[2].translation().y() = 1e8;
  std::string poses;
  for (const Eigen::Isometry3d& T : small_.T_map_lidar) poses += test::kitti_line(T);
  folder_.write("drive/poses.txt", poses);
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({"000002.bin", "1e+08 m"}));
}

TEST_F(MapBuild, RefusesADriveWhoseScansAreAllEmpty) {
  for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i)
    folder_.write(fmt::format("drive/{:06}.bin", i), "");
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({drive_.string(), "point"}));
  EXPECT_THAT(names_in_maps(), IsEmpty());
}

TEST_F(MapBuild, RefusesASelectionOfNothing) {
  options_.selection = maps::Selection::parse("10::");
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({"4 scans", "none selected"}));
}

TEST_F(MapBuild, RefusesATargetThatExistsAndLeavesItAlone) {
  folder_.write("maps/map/mine.txt", "mine");
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<InputError>({"map"}));
  EXPECT_THAT(names_in_maps(), ElementsAre("map"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / "maps/map/mine.txt"));
}

TEST_F(MapBuild, RefusesBrokenOptionsByName) {
  const auto expect_refused = [&](const std::string& name) {
    EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<std::invalid_argument>({name}));
    EXPECT_THAT(names_in_maps(), IsEmpty());
    const MapBuildOptions fresh;
    options_ = fresh;
  };
  options_.voxel_size_m = std::numeric_limits<double>::quiet_NaN();
  expect_refused("voxel_size_m");
  options_.max_range_m = 301.0;
  expect_refused("max_range_m");
  options_.min_range_m = -1.0;
  expect_refused("min_range_m");
  options_.threads = -1;
  expect_refused("threads");
  options_.projection.margin_m = 2.0;
  expect_refused("margin_m");
  options_.detector = "oracle";
  expect_refused("oracle");
}

TEST_F(MapBuild, SaysWhatBecameOfEveryPointOfTheFile) {
  maps::PointCloud cloud = small_.scan(1);
  cloud.positions.insert(cloud.positions.begin(), {std::nanf(""), 0.0F, 0.0F});
  cloud.positions.emplace_back(1.0F, 0.0F, 0.0F);
  folder_.write("drive/000001.bin", test::bin_of(cloud));
  use_boxes();
  (void)build();
  const maps::ScanFates fates = open()->fates(1);
  ASSERT_EQ(fates.size(), cloud.size());
  EXPECT_EQ(fates.fates.front(), maps::PointFate::kDropped);
  EXPECT_EQ(fates.fates.back(), maps::PointFate::kDropped);
  maps::Box inside = small_.car_in(1);
  inside.size_m.z() -= 0.1;
  inside.centre.z() += 0.05;
  std::size_t of_car = 0;
  for (std::size_t i = 1; i + 1 < cloud.size(); ++i) {
    if (!inside.contains(cloud.positions[i].cast<double>(), 0.01)) continue;
    ++of_car;
    ASSERT_EQ(fates.fates[i], maps::PointFate::kProjected);
    ASSERT_EQ(fates.objects[i], 1U);
  }
  EXPECT_GT(of_car, 50U);
}

TEST_F(MapBuild, JoinsSeveralDrivesOfOneFrame) {
  const auto alone = build("one").points;
  const std::filesystem::path second = folder_.path() / "second";
  std::filesystem::copy(drive_, second, std::filesystem::copy_options::recursive);
  const MapBuildResult both =
      build_map({drive_, second}, folder_.path() / "maps/both", options_, progress_, cancel_);
  EXPECT_EQ(both.scans, 2 * test::SmallDrive::kScans);
  EXPECT_EQ(both.points.at("in"), 2 * alone.at("in"));
  const auto map = open("both");
  ASSERT_EQ(map->trajectories().size(), 2U);
  EXPECT_EQ(map->trajectories()[1].size(), test::SmallDrive::kScans);
  EXPECT_EQ(map->manifest().sources.at("drive_2"), "second");
  EXPECT_EQ(map->fates(7).fates, map->fates(3).fates);
}

TEST_F(MapBuild, RefusesBoxesOfOneDriveForTwo) {
  use_boxes();
  EXPECT_THAT(
      [&] {
        (void)build_map({drive_, drive_}, folder_.path() / "maps/map", options_, progress_,
                        cancel_);
      },
      ThrowsSaying<std::invalid_argument>({"1 files of boxes", "2 drives"}));
  EXPECT_THAT(names_in_maps(), IsEmpty());
}

TEST_F(MapBuild, AsThePaperPutsBoxesOnTheScansMeanGround) {
  use_boxes();
  apply_paper_preset(options_);
  const MapBuildResult report = build();
  EXPECT_EQ(report.objects.at("unknown"), 4U);
  EXPECT_EQ(report.points.at("filled"), 0U);
  EXPECT_EQ(open()->manifest().options.at("ground_height"), "mean");
  const auto map = open();
  for (const maps::TileEntry& entry : map->tiles()) {
    const maps::MapTile tile = map->tile(entry.id);
    for (const maps::MapPoint& p : tile) {
      if (p.kind != maps::PointKind::kProjected) continue;
      EXPECT_NEAR(tile.position(p).z(), 0.0, 0.02);
    }
  }
}

TEST_F(MapBuild, WithoutFusionLeavesACarWhereItWasMissed) {
  maps::BoxSequence boxes;
  boxes.by_scan[0] = {small_.car_in(0)};
  boxes.by_scan[2] = {small_.car_in(2)};
  boxes.by_scan[0][0].track = boxes.by_scan[2][0].track = 3;
  maps::write_boxes(folder_.path() / "some.json", boxes);
  options_.detector = "boxes:" + (folder_.path() / "some.json").string();
  const std::uint64_t fused = build("fused").points.at("projected");
  options_.fusion = false;
  const std::uint64_t apart = build("apart").points.at("projected");
  EXPECT_GT(fused, apart + apart / 3);
  const auto in_scan_1 = [&](const char* name) {
    const maps::ScanFates fates = open(name)->fates(1);
    return std::count(fates.fates.begin(), fates.fates.end(), maps::PointFate::kProjected);
  };
  EXPECT_GT(in_scan_1("fused"), 50);
  EXPECT_EQ(in_scan_1("apart"), 0);
}

TEST_F(MapBuild, ReplaysAUsersCorrections) {
  use_boxes();
  folder_.write("edits.json", R"({"format": "stillmap-edits", "version": 1, "edits": [
    {"action": "keep", "object": {"centre": [10.2, 3.9, 0.7], "class": "car"}},
    {"action": "remove", "box": {"centre": [5, 8, 1], "size": [3, 1, 1], "yaw": 0}},
    {"action": "keep", "object": {"centre": [500, 0, 0], "class": "bus"}}]})");
  options_.edits_file = folder_.path() / "edits.json";
  const MapBuildResult report = build();
  EXPECT_EQ(report.objects.at("edits_applied"), 2U);
  ASSERT_EQ(report.warnings.size(), 1U);
  EXPECT_THAT(report.warnings[0], testing::HasSubstr("bus"));
  const auto map = open();
  std::size_t of_car = 0, of_wall = 0;
  for (const maps::TileEntry& entry : map->tiles()) {
    const maps::MapTile tile = map->tile(entry.id);
    for (const maps::MapPoint& p : tile) {
      const Eigen::Vector3d q = tile.position(p);
      of_car += std::abs(q.x() - 10.15) < 2.3 && std::abs(q.y() - 3.9) < 1.0 && q.z() > 0.3;
      of_wall +=
          std::abs(q.x() - 5.0) < 1.4 && std::abs(q.y() - 8.0) < 0.4 && std::abs(q.z() - 1.0) < 0.4;
    }
  }
  EXPECT_GT(of_car, 100U);
  EXPECT_EQ(of_wall, 0U);
}

TEST_F(MapBuild, RefusesEditsWithoutFusionAndUnknownCleaning) {
  options_.fusion = false;
  options_.edits_file = folder_.path() / "edits.json";
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<std::invalid_argument>({"edits_file"}));
  options_.fusion = true;
  apply_paper_preset(options_);
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<std::invalid_argument>({"edits_file"}));
  const MapBuildOptions defaults;
  options_ = defaults;
  options_.clean = "soap";
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<std::invalid_argument>({"soap"}));
}

TEST_F(MapBuild, SaysThatNothingIsFilledWhereObjectsAreDeleted) {
  use_boxes();
  options_.projection.policy = MovablePolicy::kDelete;
  EXPECT_EQ(build().points.at("filled"), 0U);
  EXPECT_EQ(open()->manifest().options.at("fill"), "off");
}

TEST_F(MapBuild, RefusesEmptyRangesOfPoints) {
  options_.min_range_m = 20.0;
  options_.max_range_m = 10.0;
  EXPECT_THAT([&] { (void)build(); }, ThrowsSaying<std::invalid_argument>({"max_range_m"}));
}

/// Twenty scans of a street whose given poses are off by 0.1 m in every direction.
class GivenPosesOfABuild : public MapBuild {
 protected:
  GivenPosesOfABuild() {
    const test::SyntheticWorld world = test::street(41);
    test::ScanPattern pattern{.rings = 24, .columns = 360, .noise_m = 0.02};
    test::Random random(7);
    std::string poses;
    for (std::size_t i = 0; i < 20; ++i) {
      const double way_m = static_cast<double>(i);
      truth_.push_back(test::pose_at(20.0 + way_m, 0.4 * std::sin(0.2 * way_m), 0.0));
      pattern.seed = i + 1;
      folder_.write(fmt::format("street/{:06}.bin", i),
                    test::bin_of(world.scan(truth_.back(), pattern)));
      Eigen::Isometry3d T = truth_.back();
      for (double& value : T.translation()) value += 0.1 * random.normal();
      poses += test::kitti_line(T);
    }
    folder_.write("street/poses.txt", poses);
    drive_ = folder_.path() / "street";
    options_.detector = "geometric";
  }
  /// What neighbouring scans of the map are off from each other, at most.
  [[nodiscard]] double worst_m() const {
    const maps::Trajectory path = open()->trajectories().front();
    double worst = 0.0;
    for (std::size_t i = 1; i < truth_.size(); ++i) {
      const Eigen::Isometry3d T_true = truth_[i - 1].inverse() * truth_[i];
      const Eigen::Isometry3d T =
          path.poses()[i - 1].T_map_lidar.inverse() * path.poses()[i].T_map_lidar;
      worst = std::max(worst, (T_true.inverse() * T).translation().norm());
    }
    return worst;
  }

  std::vector<Eigen::Isometry3d> truth_;
};

TEST_F(GivenPosesOfABuild, AreRefinedAndItIsSaidByHowMuch) {
  options_.given_poses = GivenPosesUse::kRefine;
  const MapBuildResult report = build();
  EXPECT_LT(worst_m(), 0.05);
  ASSERT_TRUE(report.given_poses);
  EXPECT_GT(report.given_poses->moved.median_m, 0.05);
  EXPECT_LT(report.given_poses->moved.median_m, 0.3);
  EXPECT_GT(report.given_poses->neighbours_apart, 10U);
  EXPECT_THAT(report.warnings, IsEmpty());
  EXPECT_EQ(open()->manifest().options.at("given_poses"), "refine");
  EXPECT_GE(open()->manifest().counts.at("key_frames"), 15U);
  EXPECT_EQ(open()->manifest().counts.at("poses_moved_median_mm"),
            std::llround(1e3 * report.given_poses->moved.median_m));
}

TEST_F(GivenPosesOfABuild, ThatAreSaidToBeExactStayAndAreChecked) {
  const MapBuildResult report = build();
  EXPECT_GT(worst_m(), 0.2);
  EXPECT_EQ(report.given_poses.value().moved.max_m, 0.0);
  EXPECT_THAT(report.warnings, ElementsAre(::testing::AllOf(
                                   ::testing::HasSubstr("of 19 given poses are more than a voxel"),
                                   ::testing::HasSubstr("build with --given-poses refine"))));
  EXPECT_EQ(open()->manifest().options.at("given_poses"), "exact");
}

TEST_F(MapBuild, RefusesADriveWhoseScansAreAllHidden) {
  maps::PointCloud shell = small_.scan(2);
  for (Eigen::Vector3f& p : shell.positions) p *= 0.5F / p.norm();
  for (int i = 0; i < 4; ++i) folder_.write(fmt::format("drive/{:06}.bin", i), test::bin_of(shell));
  options_.odometry = "default";
  EXPECT_THAT([&] { (void)build(); },
              ThrowsSaying<InputError>({"4 scans, all hidden", "leave this drive out"}));
}

TEST_F(MapBuild, SaysWhereOdometryRestarted) {
  // Carried, covered, from the street into a hall in which nothing is as there.
  const test::SyntheticWorld street = test::street(41);
  test::SyntheticWorld hall;
  hall.boxes = {{{-6.0, -4.0, -3.0}, {-5.5, 4.0, 3.0}}, {{5.5, -4.0, -3.0}, {6.0, 4.0, 3.0}},
                {{-6.0, 3.5, -3.0}, {6.0, 4.0, 3.0}},   {{-6.0, -4.0, -3.0}, {6.0, -3.5, 3.0}},
                {{2.0, 1.0, 0.0}, {3.0, 2.0, 3.0}},     {{-3.0, -2.5, 0.0}, {-2.4, -2.0, 3.0}},
                {{-6.0, -4.0, 2.9}, {6.0, 4.0, 3.4}}};
  test::ScanPattern pattern{.rings = 20, .columns = 360, .noise_m = 0.02};
  for (std::size_t i = 0; i < 32; ++i) {
    const double s = static_cast<double>(i);
    pattern.seed = i + 1;
    maps::PointCloud cloud = i < 16 ? street.scan(test::pose_at(20.0 + 0.9 * s, 0.0), pattern)
                                    : hall.scan(test::pose_at(0.2 * s - 7.2, 0.0), pattern);
    if (i >= 12 && i < 16)
      for (Eigen::Vector3f& p : cloud.positions) p *= 0.3F / p.norm();
    folder_.write(fmt::format("carried/{:06}.bin", i), test::bin_of(cloud));
  }
  drive_ = folder_.path() / "carried";
  options_.detector = "geometric";
  const MapBuildResult report = build();
  EXPECT_GE(report.points.at("scans_hidden"), 4U);
  EXPECT_THAT(report.warnings,
              Contains(AllOf(HasSubstr("odometry lost the place and restarted at scan 2"),
                             HasSubstr("a map of each part (--select BEGIN:END)"))));
}

/// 11 s along the street, faster and slower; the stamps of the poses are 0.3 s too early.
class ClockOfPosesOfABuild : public MapBuild {
 protected:
  ClockOfPosesOfABuild() {
    const test::SyntheticWorld world = test::street(41);
    test::ScanPattern pattern{.rings = 24, .columns = 360, .noise_m = 0.02};
    std::string poses;
    for (std::size_t i = 0; i < 110; ++i) {
      pattern.seed = i + 1;
      folder_.write(fmt::format("street/{:06}.bin", i),
                    test::bin_of(world.scan(truth(i), pattern)));
      poses += test::kitti_line(truth(i + 3));
    }
    folder_.write("street/poses.txt", poses);
    drive_ = folder_.path() / "street";
    options_.detector = "geometric";
    options_.threads = 2;
  }
  static Eigen::Isometry3d truth(std::size_t scan) {
    const double t_s = 0.1 * static_cast<double>(scan);
    return test::pose_at(10.0 + 6.0 * t_s - 3.0 * std::cos(1.1 * t_s), std::sin(0.6 * t_s),
                         0.1 * std::cos(0.6 * t_s));
  }
  static double off_m(const maps::Trajectory& path, std::size_t pose, std::size_t scan) {
    return (path.poses()[pose].T_map_lidar.inverse() * truth(scan)).translation().norm();
  }
};

TEST_F(ClockOfPosesOfABuild, IsSaidWithWhatMendsIt) {
  const MapBuildResult report = build();
  ASSERT_EQ(report.pose_faults.size(), 1U);
  EXPECT_EQ(report.pose_faults[0].code, "pose_clock");
  EXPECT_THAT(report.warnings, Contains(AllOf(HasSubstr("s behind those of the scans"),
                                              HasSubstr("build with --pose-time-offset 0."))));
  EXPECT_THAT(report.found_pose_time_offsets_s, IsEmpty());
  EXPECT_THAT(open()->manifest().options, Not(Contains(Key("pose_time_offset_s"))));
}

TEST_F(ClockOfPosesOfABuild, IsSetWhereAskedFor) {
  options_.finds_pose_time_offset = true;
  const MapBuildResult report = build();
  ASSERT_EQ(report.found_pose_time_offsets_s.size(), 1U);
  const double found_s = report.found_pose_time_offsets_s[0];
  EXPECT_NEAR(found_s, 0.3, 0.02);
  EXPECT_THAT(report.pose_faults, IsEmpty());
  EXPECT_THAT(report.warnings, Contains(HasSubstr("s were added to the stamps of the poses")));
  EXPECT_EQ(open()->manifest().options.at("pose_time_offset_s"), fmt::format("{:.4f}", found_s));
  EXPECT_GT(report.stage_seconds.at("pose time offset"), 0.0);
  EXPECT_GT(report.seconds, report.stage_seconds.at("pose time offset"));
  // No pose reaches back to the first scans.
  const maps::Trajectory path = open()->trajectories().front();
  const std::size_t without = 110 - path.size();
  EXPECT_GE(without, 1U);
  EXPECT_LE(without, 2U);
  for (std::size_t i = 5; i < 100; ++i) EXPECT_LT(off_m(path, i, i + without), 0.15) << i;
}

TEST_F(ClockOfPosesOfABuild, IsNotMeasuredTwice) {
  options_.finds_pose_time_offset = true;
  progress_ = [&](std::string_view stage, std::size_t, std::size_t) {
    if (stage == "survey") cancel_ = true;
  };
  EXPECT_THROW((void)build(), Cancelled);
  cancel_ = false;
  progress_ = {};
  const MapBuildResult report = build();
  EXPECT_NEAR(report.found_pose_time_offsets_s.at(0), 0.3, 0.02);
  EXPECT_THAT(report.stage_seconds, Not(Contains(Key("pose time offset"))));
}

TEST_F(ClockOfPosesOfABuild, IsNotSetWhereASelectionWouldCountOtherScans) {
  options_.finds_pose_time_offset = true;
  options_.selection.begin = 10;
  EXPECT_THAT([&] { (void)build(); },
              ThrowsSaying<InputError>({"--select counts", "--pose-time-offset 0."}));
}

TEST_F(MapBuild, SaysThatAnOffsetOfPosesHasNoEffectWhereTheyAreNotUsed) {
  options_.odometry = "default";
  options_.finds_pose_time_offset = true;
  const MapBuildResult report = build();
  EXPECT_THAT(report.warnings, Contains(HasSubstr("--pose-time-offset has no effect")));
  EXPECT_THAT(report.found_pose_time_offsets_s, IsEmpty());
}

}  // namespace map_build_test
}  // namespace stillmap::mapping
