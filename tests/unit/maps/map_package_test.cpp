#include <stillmap/maps/map_package.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <regex>

#include <stillmap/maps/package_files.hpp>
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace map_package_test {

namespace fs = std::filesystem;
using ::stillmap::test::IsNearPose;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr TileId kNear{.level = 0, .x = 0, .y = -1};
constexpr TileId kFar{.level = 2, .x = 7, .y = 3};

MapPoint point(float x, float y, float z) { return {x, y, z, 0.5F, 3, PointKind::kProjected, 2}; }

std::string text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// A file for each tile, as these tests know the layout; `package_schemas_test.cpp` has the other.
constexpr int kFirstSchema = 1;

void put_text(const fs::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

MapManifest sample_manifest() {
  MapManifest manifest;
  manifest.frame_id = "map";
  manifest.origin = {448000.125, 5427000.0, 1.0 / 3.0};
  manifest.geodetic_origin = GeodeticOrigin{49.0, 8.4, 116.5};
  manifest.voxel_size_m = 0.1;
  manifest.software_version = "0.1.0";
  manifest.options = {{"detector", "geometric"}};
  manifest.counts = {{"points_in", 12345678901234U}};
  manifest.sources = {{"drive", std::string(64, 'a')}};
  return manifest;
}

Trajectory sample_trajectory() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(1.0, 2.0, 3.0);
  return Trajectory(
      {{.stamp_ns = 1, .T_map_lidar = T}, {.stamp_ns = 100'000'001, .T_map_lidar = T}});
}

std::string write_sample(const fs::path& target, bool far_first, const std::string& build) {
  const std::array<MapPoint, 2> near_points{point(1, -2, 3), point(4, -5, -6)};
  const std::array<MapPoint, 1> far_points{point(600, 300, 0)};
  MapPackageWriter writer(target, {}, kFirstSchema);
  if (far_first) writer.add_tile(kFar, far_points);
  writer.add_tile(kNear, near_points);
  if (!far_first) writer.add_tile(kFar, far_points);
  writer.write_trajectory(sample_trajectory());
  MapObject object;
  object.placements = {{4, {1.0, 2.0, 3.5}, 0.25}, {5, {2.0, 2.0, 3.5}, 0.5}};
  object.motion = ObjectMotion::kMoving;
  object.drive = 1;
  object.first_scan = 4;
  object.last_scan = 5;
  object.first_stamp_ns = 1'700'000'000'123'456'789;
  object.last_stamp_ns = -5;
  object.detections = 2;
  object.object_class = ObjectClass::kTruck;
  object.score = 0.5;
  object.points_removed = 77;
  writer.write_objects({object});
  return writer.publish(sample_manifest(), build);
}

TEST(MapPackage, ReadsBackWhatWasWritten) {
  const TemporaryFolder folder;
  const std::string digest = write_sample(folder.path() / "map", false, "{}");
  const auto package = MapPackage::open(folder.path() / "map");
  EXPECT_EQ(package->digest(), digest);
  const MapManifest& manifest = package->manifest();
  EXPECT_EQ(manifest.frame_id, "map");
  EXPECT_EQ(manifest.origin, sample_manifest().origin);
  EXPECT_EQ(manifest.geodetic_origin->altitude_m, 116.5);
  EXPECT_EQ(manifest.voxel_size_m, 0.1);
  EXPECT_EQ(manifest.options, sample_manifest().options);
  EXPECT_EQ(manifest.counts, sample_manifest().counts);
  EXPECT_EQ(manifest.sources, sample_manifest().sources);
  const std::vector<TileEntry> tiles = package->tiles();
  ASSERT_EQ(tiles.size(), 2U);
  EXPECT_EQ(tiles[0].id, kNear);
  EXPECT_EQ(tiles[0].from_origin().min(), Eigen::Vector3d(1.0, -5.0, -6.0));
  EXPECT_EQ(tiles[0].from_origin().max(), Eigen::Vector3d(4.0, -2.0, 3.0));
  EXPECT_EQ(manifest.bounds_of(tiles[0]).max(),
            sample_manifest().origin + Eigen::Vector3d(4.0, -2.0, 3.0));
  const MapTile tile = package->tile(kNear);
  ASSERT_EQ(tile.size(), 2U);
  EXPECT_EQ(tile.from_origin(tile[1]), Eigen::Vector3d(4.0, -5.0, -6.0));
  EXPECT_EQ(tile.position(tile[1]), sample_manifest().origin + Eigen::Vector3d(4.0, -5.0, -6.0));
  EXPECT_EQ(tile[1].observations, 3);
  EXPECT_EQ(tile[1].kind, PointKind::kProjected);
  EXPECT_EQ(tile[1].object, 2);
  EXPECT_TRUE(package->has_tile(kNear));
  EXPECT_FALSE(package->has_tile({.level = 0, .x = 5, .y = 5}));
  EXPECT_TRUE(package->tile({.level = 0, .x = 5, .y = 5}).empty());
}

/// A tile of points along a line through it, as a build rounds them.
std::vector<MapPoint> points_along(TileId id) {
  const double width_m = std::ldexp(kTileSizeM, static_cast<int>(id.level));
  std::vector<MapPoint> points;
  for (const double share : {0.0, 1e-9, 0.1, 1.0 / 3.0, 0.5, 0.7, 0.999, 1.0}) {
    const double x = (id.x + share) * width_m, y = (id.y + 1.0 - share) * width_m;
    points.push_back(point(static_cast<float>(x), static_cast<float>(y), -0.1F));
  }
  if (id.x == -1 || id.x == 0) points.push_back(point(-0.0F, 0.0F, -0.0F));
  return points;
}

TEST(MapTile, HasTheVeryCoordinatesThatWereWritten) {
  const TemporaryFolder folder;
  std::map<TileId, std::vector<MapPoint>> written;
  for (const std::int32_t x : {-50'000, -7, -2, -1, 0, 1, 2, 40, 100'000})
    for (const std::uint32_t level : {0U, 2U})
      written[{.level = level, .x = x, .y = 3 - x}] =
          points_along({.level = level, .x = x, .y = 3 - x});
  MapPackageWriter writer(folder.path() / "map", {}, kFirstSchema);
  for (const auto& [id, points] : written) writer.add_tile(id, points);
  writer.publish(sample_manifest(), "{}");
  const auto package = MapPackage::open(folder.path() / "map");
  for (const auto& [id, points] : written) {
    const MapTile tile = package->tile(id);
    ASSERT_EQ(tile.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d p(points[i].x, points[i].y, points[i].z);
      EXPECT_EQ(tile.from_origin(tile[i]), p);
      EXPECT_EQ(tile.position(tile[i]), sample_manifest().origin + p);
    }
    const std::vector<MapPoint> back = package->tile(id).points_from(Eigen::Vector3d::Zero());
    EXPECT_EQ(std::memcmp(back.data(), points.data(), points.size() * sizeof(MapPoint)), 0) << id.x;
  }
}

TEST(MapTile, CountsFromItsCorner) {
  const TemporaryFolder folder;
  const std::array<MapPoint, 2> points{point(641, -299, 7), point(659, -281, -7)};
  MapPackageWriter writer(folder.path() / "map", {}, kFirstSchema);
  writer.add_tile({.level = 0, .x = 32, .y = -15}, points);
  writer.publish(sample_manifest(), "{}");
  const auto package = MapPackage::open(folder.path() / "map");
  const MapTile tile = package->tile({.level = 0, .x = 32, .y = -15});
  EXPECT_THAT((std::array{tile[0].x, tile[0].y, tile[0].z}), ElementsAre(1.0F, 1.0F, 7.0F));
  EXPECT_THAT((std::array{tile[1].x, tile[1].y, tile[1].z}), ElementsAre(19.0F, 19.0F, -7.0F));
}

TEST(MapTile, OutlivesItsPackage) {
  const TemporaryFolder folder;
  write_sample(folder.path() / "map", false, "{}");
  auto package = MapPackage::open(folder.path() / "map");
  const MapTile tile = package->tile(kFar);
  fs::remove_all(folder.path() / "map");
  EXPECT_EQ(package->tile(kNear).size(), 2U) << "an open package stays readable";
  package.reset();
  EXPECT_EQ(tile.from_origin(tile[0]), Eigen::Vector3d(600.0, 300.0, 0.0));
}

Registration sample_registration() {
  Registration registration;
  registration.previous_digest = std::string(64, 'c');
  registration.T_previous_map = exp_se3({0.01, -0.02, 0.0, 0.0, 0.0, 0.001});
  registration.T_map_poses = exp_se3({12.0, -3.0, 0.5, 0.01, 0.02, -3.0});
  registration.residual_m = 0.012;
  registration.residual_rad = 0.0003;
  registration.scans_used = 41;
  registration.scans_asked = 60;
  return registration;
}

TEST(MapPackage, ReadsBackHowItWasRegistered) {
  MapManifest manifest = sample_manifest();
  manifest.registration = sample_registration();
  const std::string text = manifest_text(manifest);
  const auto found = parse_manifest(text, "manifest.json").registration;
  ASSERT_TRUE(found);
  EXPECT_EQ(found->previous_digest, std::string(64, 'c'));
  EXPECT_TRUE(found->T_previous_map.isApprox(sample_registration().T_previous_map, 1e-14));
  EXPECT_TRUE(found->T_map_poses.isApprox(sample_registration().T_map_poses, 1e-14));
  EXPECT_EQ(found->residual_m, 0.012);
  EXPECT_EQ(found->residual_rad, 0.0003);
  EXPECT_EQ(found->scans_used, 41U);
  EXPECT_EQ(found->scans_asked, 60U);
  EXPECT_FALSE(parse_manifest(manifest_text(sample_manifest()), "manifest.json").registration);
}

TEST(MapPackage, RefusesABrokenRegistration) {
  MapManifest manifest = sample_manifest();
  manifest.registration = sample_registration();
  const std::string text = manifest_text(manifest);
  const auto refuses = [&](const std::string& from, const std::string& to,
                           const std::string& said) {
    const std::string changed = std::regex_replace(text, std::regex(from), to);
    ASSERT_NE(changed, text) << from;
    EXPECT_THAT([&] { (void)parse_manifest(changed, "manifest.json"); },
                ThrowsSaying<InputError>({said}))
        << to;
  };
  refuses("cccc", "ccc", ".registration.previous_digest");
  refuses("\"scans_used\": 41", "\"scans_used\": -1", ".registration.scans_used");
  refuses("\"residual_m\": 0.012", "\"residual_m\": -0.012", ".registration.residual_m");
  refuses("\"quaternion\": \\[", "\"quaternion\": [1,", ".quaternion");
  refuses("\"quaternion\": \\[\\s*[^,]*,", "\"quaternion\": [9.0,", ".quaternion");
}

TEST(MapPackage, ReadsBackPlacesOfASensor) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  const std::vector<Eigen::Isometry3d> places{exp_se3({448000.125, 5427000.0, 1.8, 0.1, -0.2, 0.0}),
                                              Eigen::Isometry3d::Identity()};
  MapPackageWriter writer(map, {}, kFirstSchema);
  writer.add_tile(kNear, std::array{point(1, 2, 3)});
  writer.write_places(places);
  writer.publish(sample_manifest(), "{}");
  const auto found = MapPackage::open(map)->places();
  ASSERT_EQ(found.size(), 2U);
  EXPECT_TRUE(found[0].translation().isApprox(places[0].translation(), 1e-9));
  EXPECT_TRUE(found[0].linear().isApprox(places[0].linear(), 1e-6));
  EXPECT_TRUE(found[1].isApprox(places[1], 1e-9));
}

TEST(MapPackage, ReadsBackPathAndObjects) {
  const TemporaryFolder folder;
  write_sample(folder.path() / "map", false, "{}");
  const auto package = MapPackage::open(folder.path() / "map");
  ASSERT_EQ(package->trajectories().size(), 1U);
  const Trajectory trajectory = package->trajectories()[0];
  ASSERT_EQ(trajectory.size(), 2U);
  EXPECT_EQ(trajectory.poses()[1].stamp_ns, 100'000'001);
  EXPECT_THAT(trajectory.poses()[1].T_map_lidar,
              IsNearPose(sample_trajectory().poses()[1].T_map_lidar, 1e-12, 1e-12));
  const std::vector<MapObject> objects = package->objects();
  ASSERT_EQ(objects.size(), 1U);
  ASSERT_EQ(objects[0].placements.size(), 2U);
  EXPECT_EQ(objects[0].placements[0].scan, 4U);
  EXPECT_EQ(objects[0].placements[0].centre_map, Eigen::Vector3d(1.0, 2.0, 3.5));
  EXPECT_EQ(objects[0].placements[1].yaw_rad, 0.5);
  EXPECT_EQ(objects[0].motion, ObjectMotion::kMoving);
  EXPECT_EQ(objects[0].drive, 1U);
  EXPECT_EQ(objects[0].last_scan, 5U);
  EXPECT_EQ(objects[0].first_stamp_ns, 1'700'000'000'123'456'789);
  EXPECT_EQ(objects[0].last_stamp_ns, -5);
  EXPECT_EQ(objects[0].detections, 2U);
  EXPECT_EQ(objects[0].object_class, ObjectClass::kTruck);
  EXPECT_EQ(objects[0].points_removed, 77U);
}

TEST(MapPackage, DigestFollowsTheContentAlone) {
  const TemporaryFolder folder;
  const std::string digest = write_sample(folder.path() / "a", false, R"({"host": "a"})");
  EXPECT_EQ(write_sample(folder.path() / "b", true, R"({"host": "b"})"), digest);
  EXPECT_EQ(text_of(folder.path() / "a/manifest.json"), text_of(folder.path() / "b/manifest.json"));
  EXPECT_EQ(digest.size(), 64U);

  MapPackageWriter writer(folder.path() / "c", {}, kFirstSchema);
  const std::array<MapPoint, 1> other{point(1, -2, 3.001F)};
  writer.add_tile(kNear, other);
  EXPECT_NE(writer.publish(sample_manifest(), "{}"), digest);
}

TEST(MapPackage, HashIsSha256) {
  const TemporaryFolder folder;
  // FIPS 180-2, appendix B.1.
  EXPECT_EQ(sha256_of_file(folder.write("abc", "abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(MapPackage, VerifyNamesEachCorruptFile) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  write_sample(map, false, "{}");
  const auto package = MapPackage::open(map);
  EXPECT_THAT(package->verify(), IsEmpty());
  std::string bytes = text_of(map / "tiles/0_0_-1.bin");
  bytes[5] = static_cast<char>(bytes[5] ^ 1);
  put_text(map / "tiles/0_0_-1.bin", bytes);
  EXPECT_THAT(package->verify(), ElementsAre("tiles/0_0_-1.bin"));
  fs::remove(map / "objects.json");
  put_text(map / "manifest.json", text_of(map / "manifest.json") + " ");
  EXPECT_THAT(package->verify(), ElementsAre("objects.json", "tiles/0_0_-1.bin", "manifest.json"));
}

TEST(MapPackage, OpenNamesMissingAndShortFiles) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  EXPECT_THAT([&] { (void)MapPackage::open(map); },
              ThrowsSaying<InputError>({map.string(), "manifest.json"}));
  write_sample(map, false, "{}");
  fs::resize_file(map / "tiles/2_7_3.bin", 19);
  EXPECT_THAT([&] { (void)MapPackage::open(map); },
              ThrowsSaying<InputError>({"tiles/2_7_3.bin", "19 bytes", "20"}));
  fs::remove(map / "tiles/2_7_3.bin");
  EXPECT_THAT([&] { (void)MapPackage::open(map); },
              ThrowsSaying<InputError>({"tiles/2_7_3.bin", "nothing"}));
}

TEST(MapPackage, RefusesANewerSchema) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  write_sample(map, false, "{}");
  const std::string text = text_of(map / "manifest.json");
  put_text(map / "manifest.json",
           std::regex_replace(text, std::regex(R"("schema": 1)"), R"("schema": 3)"));
  EXPECT_THAT([&] { (void)MapPackage::open(map); },
              ThrowsSaying<InputError>({"schema", "3", "newer stillmap"}));
}

TEST(MapPackage, RefusesAHostileManifest) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  write_sample(map, false, "{}");
  const std::string text = text_of(map / "manifest.json");
  const auto refuses = [&](const std::string& from, const std::string& to,
                           const std::string& said) {
    const std::string changed = std::regex_replace(text, std::regex(from), to);
    ASSERT_NE(changed, text) << from;
    put_text(map / "manifest.json", changed);
    EXPECT_THAT([&] { (void)MapPackage::open(map); }, ThrowsSaying<InputError>({said})) << to;
  };
  refuses("\"objects.json\"", "\"../objects.json\"", "../objects.json");
  refuses("\"objects.json\"", "\"/etc/passwd\"", "/etc/passwd");
  refuses("\"objects.json\"", "\"build.json\"", "build.json");
  refuses("\"objects.json\"", "\"objects.json\\u0000.png\"",
          "objects.json?.png: found an object, expected a path inside the package");
  refuses("\"objects.json\"", "\"tiles//objects.json\"", "a path inside the package");
  refuses("\"points\": 2", "\"points\": 3", "60");
  refuses("\"points\": 2", "\"points\": 18446744073709551615", ".points");
  refuses("\"points\": 2", "\"points\": -2", ".points");
  refuses("\"level\": 2", "\"level\": 3", "tiles/3_7_3.bin");
  refuses("\"voxel_size_m\": 0.1", "\"voxel_size_m\": \"0.1\"", ".voxel_size_m");
  refuses("\"voxel_size_m\": 0.1", "\"voxel_size_m\": 1e999", "JSON");
  refuses("\"latitude_deg\": 49.0", "\"latitude_deg\": 149.0", ".latitude_deg");
  refuses("\"frame_id\"", "\"frame\"", ".frame_id");
  refuses("^\\{", "[", "JSON");
}

TEST(MapPackage, ToleratesUnknownKeysOfItsSchema) {
  const TemporaryFolder folder;
  const fs::path map = folder.path() / "map";
  write_sample(map, false, "{}");
  const std::string text = text_of(map / "manifest.json");
  put_text(map / "manifest.json", "{\"note\": [1, 2]," + text.substr(1));
  EXPECT_EQ(MapPackage::open(map)->manifest().frame_id, "map");
}

TEST(MapPackageWriter, LeavesNoHalfPackageBehind) {
  const TemporaryFolder folder;
  {
    MapPackageWriter writer(folder.path() / "map", {}, kFirstSchema);
    const std::array<MapPoint, 1> points{point(1, 2, 3)};
    writer.add_tile(kNear, points);
    EXPECT_FALSE(fs::exists(folder.path() / "map"));
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(MapPackageWriter, RefusesWhatNoReaderCouldUse) {
  const TemporaryFolder folder;
  MapPackageWriter writer(folder.path() / "map", {}, kFirstSchema);
  const std::array<MapPoint, 1> good{point(1, 2, 3)};
  const std::array<MapPoint, 1> bad{point(1, std::numeric_limits<float>::quiet_NaN(), 3)};
  EXPECT_THAT([&] { writer.add_tile(kNear, std::span<const MapPoint>{}); },
              ThrowsSaying<std::invalid_argument>({"0_0_-1"}));
  EXPECT_THAT([&] { writer.add_tile(kNear, bad); },
              ThrowsSaying<std::invalid_argument>({"not finite"}));
  writer.add_tile(kNear, good);
  EXPECT_THAT([&] { writer.add_tile(kNear, good); },
              ThrowsSaying<std::invalid_argument>({"twice"}));
}

}  // namespace map_package_test
}  // namespace stillmap::maps
