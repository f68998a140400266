#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/content_digest.hpp>
#include <stillmap/maps/convert_package.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/pose_disagreement.hpp>
#include <stillmap/maps/tile_steps.hpp>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <random>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace convert_package_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kVoxelM = 0.1;
const std::vector<TileId> kTiles = {{.level = 0, .x = -3, .y = 0},
                                    {.level = 0, .x = -1, .y = -1},
                                    {.level = 0, .x = 0, .y = 0},
                                    {.level = 0, .x = 700, .y = -40}};

/// Floats as an early build left them: anywhere in a tile, and on its borders.
std::vector<MapPoint> some_points(TileId id, std::mt19937& random) {
  std::uniform_real_distribution<double> along(0.0, kTileSizeM), height(-5.0, 90.0);
  std::vector<MapPoint> points;
  for (std::uint32_t i = 0; i < 200; ++i) {
    const Eigen::Vector3f p = Eigen::Vector3d(kTileSizeM * id.x + along(random),
                                              kTileSizeM * id.y + along(random), height(random))
                                  .cast<float>();
    points.push_back({p.x(), p.y(), p.z(), 0.37F * static_cast<float>(i),
                      static_cast<std::uint16_t>(i * 400), static_cast<PointKind>(i % 4), 0});
  }
  points[0].x = static_cast<float>(kTileSizeM * id.x);
  points[1].y = std::nextafter(static_cast<float>(kTileSizeM * (id.y + 1)),
                               -std::numeric_limits<float>::infinity());
  return points;
}

std::vector<PointHistory> some_history(std::vector<MapPoint>& points) {
  std::vector<PointHistory> history;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const std::uint32_t object = i % 7 == 0 ? 1 + i % 500 : 0;
    points[i].object = static_cast<std::uint8_t>(object == 0 ? 0 : 1 + (object - 1) % 255);
    history.push_back({i % 3, 3 + i % 2, object, {-127, 5, 40}, static_cast<std::uint8_t>(i)});
  }
  return history;
}

/// Of two drives of three and two scans.
std::vector<MapObject> some_objects() {
  std::vector<MapObject> objects(500);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const std::size_t scan = i < 200 ? i % 3 : 3 + i % 2;
    objects[i].drive = i < 200 ? 0 : 1;
    objects[i].first_scan = objects[i].last_scan = scan;
    objects[i].placements = {{scan, {0.5 * static_cast<double>(i), 2.0, 3.5}, 0.25}};
  }
  return objects;
}

Trajectory drive_of(std::size_t scans) {
  std::vector<StampedPose> poses;
  for (std::size_t i = 0; i < scans; ++i)
    poses.push_back(
        {.stamp_ns = static_cast<std::int64_t>(i), .T_map_lidar = Eigen::Isometry3d::Identity()});
  return Trajectory(std::move(poses));
}

MapManifest some_manifest() {
  MapManifest manifest;
  manifest.frame_id = "enu";
  // No corner of the tiles of the map frame.
  manifest.origin = {448000.125, 5427011.5, 1.0 / 3.0};
  manifest.geodetic_origin = GeodeticOrigin{49.0, 8.4, 116.5};
  manifest.registration = Registration{.previous_digest = std::string(64, 'c'), .residual_m = 0.01};
  manifest.voxel_size_m = kVoxelM;
  manifest.relative_clock = false;
  manifest.software_version = "0.0.9";
  manifest.options = {{"detector", "geometric"}};
  manifest.counts = {{"points_in", 12345678901234U}};
  manifest.sources = {{"drive", "monday"}};
  return manifest;
}

bool is_by_drive(const std::string& path) {
  return path.starts_with("objects") || path.starts_with("fates") ||
         path.starts_with("disagreement");
}

std::vector<std::string> texts_of(const std::vector<MapObject>& objects) {
  std::vector<std::string> texts;
  for (const MapObject& object : objects)
    texts.push_back(fmt::format("{} {} {} {}", object.drive, object.first_scan,
                                object.placements[0].scan, object.placements[0].centre_map.x()));
  return texts;
}

class ConvertPackage : public ::testing::Test {
 protected:
  using Change = std::function<void(TileId, std::vector<MapPoint>&, std::vector<PointHistory>&)>;
  std::shared_ptr<const MapPackage> write(const std::string& name,
                                          const Change& change = {}) const {
    MapPackageWriter writer(folder_.path() / name, {}, 1);
    std::mt19937 random(5);
    for (const TileId id : kTiles) {
      std::vector<MapPoint> points = some_points(id, random);
      std::vector<PointHistory> history = some_history(points);
      if (change) change(id, points, history);
      writer.add_tile(id, points, history);
    }
    // A thinned tile, as the oldest packages have them.
    writer.add_tile({.level = 1, .x = 0, .y = 0},
                    some_points({.level = 0, .x = 0, .y = 0}, random));
    writer.write_trajectory(drive_of(3), 0);
    writer.write_trajectory(drive_of(2), 1);
    writer.write_objects(some_objects());
    for (std::uint32_t scan = 0; scan < 5; ++scan)
      writer.add_fates(
          {{PointFate::kProjected, PointFate::kKept}, {1 + (scan < 3 ? scan : 299), 0}});
    const std::vector<PoseDisagreement> told(5, {0.25F, 0.5F});
    write_pose_disagreements(writer.folder(), told);
    fs::create_directories(writer.folder() / "notes/more");
    std::ofstream(writer.folder() / "notes/more/unknown.txt") << "of a later time";
    writer.publish(some_manifest(), R"({"seconds": 7})");
    return MapPackage::open(folder_.path() / name);
  }
  [[nodiscard]] fs::path target() const { return folder_.path() / "new"; }
  void expect_nothing_left() const {
    EXPECT_FALSE(fs::exists(target()));
    EXPECT_FALSE(fs::exists(folder_.path() / ".new.partial"));
  }

  test::TemporaryFolder folder_;
};

/// What rounds onto the tile's border is in the last voxel.
Eigen::Array3d voxel_of(TileId id, const Eigen::Vector3d& p) {
  const double last = std::round(kTileSizeM / kVoxelM) - 1.0;
  const Eigen::Vector3d corner(kTileSizeM * id.x, kTileSizeM * id.y, 0.0);
  Eigen::Array3d voxel = ((p - corner) / kVoxelM).array().floor();
  voxel.head<2>() = voxel.head<2>().min(last);
  return voxel;
}

void expect_same_place(const MapPackage& before, const MapPackage& after, TileId id) {
  const MapTile from = before.tile(id), to = after.tile(id);
  ASSERT_EQ(from.size(), to.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector3d p = from.from_origin(from[i]), q = to.from_origin(to[i]);
    EXPECT_LE((p - q).cwiseAbs().head<2>().maxCoeff(), kTileStepM + 1e-9);
    EXPECT_LE(std::abs(p.z() - q.z()), kTileStepZM + 1e-9);
    EXPECT_LE((p - q).cwiseAbs().maxCoeff(), 0.5e-3);
    EXPECT_TRUE((voxel_of(id, p) == voxel_of(id, q)).all()) << p.transpose();
    EXPECT_NEAR(to[i].intensity, from[i].intensity, from[i].intensity / 1024.0);
    EXPECT_EQ(to[i].observations, from[i].observations);
    EXPECT_EQ(to[i].kind, from[i].kind);
    EXPECT_EQ(to[i].object, from[i].object);
  }
}

void expect_same_history(const MapPackage& before, const MapPackage& after, TileId id) {
  const std::vector<PointHistory> from = before.history(id), to = after.history(id);
  ASSERT_EQ(from.size(), to.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    EXPECT_EQ(from[i].first_scan, to[i].first_scan);
    EXPECT_EQ(from[i].last_scan, to[i].last_scan);
    EXPECT_EQ(from[i].object, to[i].object);
    EXPECT_EQ(from[i].planarity, to[i].planarity);
    EXPECT_TRUE(std::equal(from[i].normal, from[i].normal + 3, to[i].normal));
  }
}

TEST_F(ConvertPackage, KeepsAllThatThePackageHolds) {
  const auto before = write("old");
  const std::string digest = convert_package(*before, target());
  const auto after = MapPackage::open(target());
  EXPECT_EQ(after->digest(), digest);
  EXPECT_EQ(after->manifest().schema, 2);
  EXPECT_THAT(after->verify(), IsEmpty());
  ASSERT_EQ(after->manifest().extent.tiles, kTiles.size()) << "without the thinned one";
  for (const TileId id : kTiles) {
    expect_same_place(*before, *after, id);
    expect_same_history(*before, *after, id);
  }
  const MapManifest& was = before->manifest();
  const MapManifest& is = after->manifest();
  EXPECT_EQ(is.origin, was.origin);
  EXPECT_EQ(is.frame_id, was.frame_id);
  EXPECT_EQ(is.geodetic_origin->altitude_m, was.geodetic_origin->altitude_m);
  EXPECT_EQ(is.registration->previous_digest, was.registration->previous_digest);
  EXPECT_EQ(is.voxel_size_m, was.voxel_size_m);
  EXPECT_EQ(is.relative_clock, was.relative_clock);
  EXPECT_EQ(is.software_version, was.software_version);
  EXPECT_EQ(is.options, was.options);
  EXPECT_EQ(is.counts, was.counts);
  EXPECT_EQ(is.sources, was.sources);
  for (const auto& [path, file] : was.files) {
    if (path.starts_with("tiles/")) continue;
    if (is_by_drive(path)) continue;
    EXPECT_EQ(is.files.at(path).sha256, file.sha256) << path;
  }
  EXPECT_EQ(texts_of(after->objects()), texts_of(some_objects()));
  for (std::size_t scan = 0; scan < 5; ++scan)
    EXPECT_EQ(after->fates(scan), before->fates(scan)) << scan;
  EXPECT_EQ(read_pose_disagreements(*after).size(), 5U);
  EXPECT_EQ(is.drives, (std::vector<MapManifest::DriveCounts>{{3, 200}, {2, 300}}));
  for (const char* path : {"objects_2.json", "fates_2.bin", "disagreement_2.txt"})
    EXPECT_TRUE(is.files.contains(path)) << path;
  EXPECT_EQ(content_digest(*after).size(), 64U);
  EXPECT_EQ(sha256_of_file(target() / "build.json"),
            sha256_of_file(before->folder() / "build.json"));
}

TEST_F(ConvertPackage, PutsObjectsInTheOrderOfTheirDrives) {
  {
    MapPackageWriter writer(folder_.path() / "old", {}, 1);
    std::mt19937 random(5);
    std::vector<MapPoint> points = some_points(kTiles[0], random);
    std::vector<PointHistory> history = some_history(points);
    for (PointHistory& each : history) each.object %= 3;
    writer.add_tile(kTiles[0], points, history);
    writer.write_trajectory(drive_of(3), 0);
    writer.write_trajectory(drive_of(2), 1);
    // A user added the second one, in both drives.
    std::vector<MapObject> objects = some_objects();
    objects[0].last_scan = 4;
    writer.write_objects({objects[200], objects[0]});
    for (std::uint32_t scan = 0; scan < 5; ++scan)
      writer.add_fates({{PointFate::kProjected, PointFate::kProjected}, {1, 2}});
    writer.publish(some_manifest(), "{}");
  }
  const auto before = MapPackage::open(folder_.path() / "old");
  convert_package(*before, target());
  const auto after = MapPackage::open(target());
  const std::vector<MapObject> objects = after->objects();
  EXPECT_EQ(objects.at(0).drive, 0U);
  EXPECT_EQ(objects.at(0).last_scan, 2U) << "the last one of its drive";
  EXPECT_EQ(objects.at(1).drive, 1U);
  EXPECT_EQ(objects.at(1).placements.at(0).centre_map.x(), 100.0);
  const auto was = before->history(kTiles[0]), is = after->history(kTiles[0]);
  for (std::size_t i = 0; i < was.size(); ++i)
    EXPECT_EQ(is[i].object, was[i].object == 0 ? 0 : 3 - was[i].object);
  EXPECT_THAT(after->fates(0).objects, ElementsAre(0, 1));
  EXPECT_THAT(after->fates(4).objects, ElementsAre(2, 0));
}

TEST_F(ConvertPackage, GivesTheSameBytesEachTime) {
  const auto before = write("old");
  EXPECT_EQ(convert_package(*before, folder_.path() / "one"),
            convert_package(*before, folder_.path() / "other"));
  EXPECT_THROW(convert_package(*MapPackage::open(folder_.path() / "one"), target()),
               std::invalid_argument);
}

TEST_F(ConvertPackage, NeedsNoMoreRoomThanItSays) {
  const auto before = write("old");
  convert_package(*before, target());
  std::uint64_t bytes = 0;
  const auto after = MapPackage::open(target());
  for (const auto& [path, file] : after->manifest().files) bytes += file.bytes;
  const ConversionRoom room = conversion_room(before->manifest());
  EXPECT_GT(room.package_bytes, bytes);
  EXPECT_LT(room.package_bytes, 2 * bytes);
  // Each tile lies in a region of its own.
  EXPECT_GT(room.beside_bytes, 200U * 19U);
  EXPECT_LT(room.beside_bytes, room.package_bytes / 3);
}

TEST_F(ConvertPackage, ADamagedFileIsNamedAndNothingIsLeft) {
  const auto before = write("old");
  const std::string path = "tiles/0_0_0.history";
  std::fstream file(before->folder() / path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(20).put('\x55');
  file.close();
  EXPECT_THAT([&] { convert_package(*before, target()); },
              ThrowsSaying<InputError>({path, "as in manifest.json", "backup"}));
  expect_nothing_left();
}

TEST_F(ConvertPackage, WhatSchema2HasNoPlaceForIsRefused) {
  const auto refuses = [&](const std::string& name, const Change& change, const char* what) {
    const auto before = write(name, [&](TileId id, auto& points, auto& history) {
      if (id == kTiles.back()) change(id, points, history);
    });
    EXPECT_THAT([&] { convert_package(*before, target()); },
                ThrowsSaying<InputError>({"tiles/0_700_-40.bin", what}));
    expect_nothing_left();
  };
  refuses(
      "outside", [](TileId, auto& points, auto&) { points[9].x += 20.0F; }, "in steps");
  refuses(
      "scan", [](TileId, auto&, auto& history) { history[9].last_scan = 5; }, "scan 5");
  refuses(
      "intensity",
      [](TileId, auto& points, auto&) {
        points[9].intensity = std::numeric_limits<float>::quiet_NaN();
      },
      "not finite");
  refuses(
      "object", [](TileId, auto& points, auto&) { points[9].object = 9; }, "otherwise");
}

TEST_F(ConvertPackage, CanBeStoppedAtAnyTime) {
  const auto before = write("old");
  double most = 0.0;
  convert_package(*before, folder_.path() / "whole", {.go_on = [&](double share) {
    EXPECT_GE(share, most);
    most = share;
    return true;
  }});
  EXPECT_GT(most, 0.8);
  EXPECT_LE(most, 1.0);
  for (const double end : {0.1, 0.4, 0.5, 0.7, most}) {
    EXPECT_THROW(
        convert_package(*before, target(), {.go_on = [&](double share) { return share < end; }}),
        WorkStopped);
    expect_nothing_left();
  }
}

}  // namespace convert_package_test
}  // namespace stillmap::maps
