#include <stillmap/maps/content_digest.hpp>

#include <stillmap/maps/map_graph.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace content_digest_test {

using ::stillmap::test::memory_folder;
using ::stillmap::test::TemporaryFolder;

struct HeldPoint {
  MapPoint point;
  PointHistory history;
};

/// What a map holds, and how it is stored.
struct Held {
  std::vector<HeldPoint> points;
  std::vector<MapObject> objects;
  std::vector<Trajectory> drives;
  std::optional<MapGraph> graph;
  std::vector<Eigen::Isometry3d> places;
  MapManifest manifest;
  bool has_history = true;
  /// Of a tile; the points of a tile are stored in their order.
  double tile_size_m = kTileSizeM;
};

Eigen::Isometry3d pose(double x, double yaw_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = x;
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

MapObject car(double x) {
  MapObject object;
  object.object_class = ObjectClass::kCar;
  object.size_m = {4.5, 1.75, 1.5};
  object.score = 0.75;
  object.motion = ObjectMotion::kMoving;
  object.last_scan = 1;
  object.last_stamp_ns = 100'000'000;
  object.detections = 2;
  object.placements = {{0, {x, 2.0, 0.75}, 0.5}, {1, {x + 1.0, 2.0, 0.75}, 0.25}};
  object.points_removed = 77;
  return object;
}

Held held() {
  Held map;
  for (unsigned i = 0; i < 100; ++i) {
    const auto at = static_cast<float>(i);
    const auto small = static_cast<std::uint8_t>(i);
    map.points.push_back({{at * 0.75F, 3.5F - at, 0.125F * at, at / 128.0F,
                           static_cast<std::uint16_t>(1 + i), static_cast<PointKind>(i % 4), small},
                          {i, 2 * i, 3 * i, {1, -2, 127}, small}});
  }
  map.objects = {car(3.0), car(12.0)};
  map.drives = {Trajectory({{0, pose(0.0, 0.0)}, {100'000'000, pose(1.5, 0.0)}}),
                Trajectory({{0, pose(8.0, 0.0)}})};
  map.graph = {.key_frames = {0, 2}, .loops = {{.from = 0, .to = 2, .weight = 0.5}}};
  map.places = {pose(4.0, 0.0)};
  map.manifest.frame_id = "map";
  map.manifest.voxel_size_m = 0.1;
  return map;
}

std::shared_ptr<const MapPackage> stored(const Held& map, const std::filesystem::path& target) {
  std::map<TileId, std::pair<std::vector<MapPoint>, std::vector<PointHistory>>> tiles;
  for (const auto& [point, history] : map.points) {
    const auto index = [&](float value) {
      return static_cast<std::int32_t>(std::floor(static_cast<double>(value) / map.tile_size_m));
    };
    auto& [points, histories] = tiles[{.level = 0, .x = index(point.x), .y = index(point.y)}];
    points.push_back(point);
    if (map.has_history) histories.push_back(history);
  }
  // Of schema 1, which takes every float as it is, and tiles of any width.
  MapPackageWriter writer(target, {}, 1);
  for (const auto& [id, tile] : tiles) writer.add_tile(id, tile.first, tile.second);
  writer.write_objects(map.objects);
  for (std::size_t drive = 0; drive < map.drives.size(); ++drive)
    writer.write_trajectory(map.drives[drive], drive);
  if (map.graph) write_map_graph(writer.folder(), *map.graph);
  writer.write_places(map.places);
  writer.publish(map.manifest, "{}");
  return MapPackage::open(target);
}

std::string digest_of(const Held& map) {
  const TemporaryFolder folder(memory_folder());
  return content_digest(*stored(map, folder.path() / "map"));
}

void expect_another(const char* what, const std::function<void(Held&)>& change) {
  Held map = held();
  change(map);
  EXPECT_NE(digest_of(map), digest_of(held())) << what;
}

// Computed in Python from the definition in maps/content_digest.md. If this fails, the definition
// has changed and the digests that were recorded mean nothing.
TEST(ContentDigest, IsAsDocumented) {
  EXPECT_EQ(digest_of(held()), "cd7c5d3dfce396672588b6ac206783b15123e7d6f2dabdff1bdc17ff80273087");
}

TEST(ContentDigest, DoesNotTellTilesOrOrder) {
  Held one_tile = held();
  one_tile.tile_size_m = 1000.0;
  Held small_tiles = held();
  small_tiles.tile_size_m = 7.0;
  Held reversed = held();
  std::reverse(reversed.points.begin(), reversed.points.end());
  for (const Held& other : {one_tile, small_tiles, reversed})
    EXPECT_EQ(digest_of(other), digest_of(held()));
}

TEST(ContentDigest, DoesNotTellManifestOrOrigin) {
  Held other = held();
  other.manifest.options = {{"detector", "geometric"}, {"threads", "4"}};
  other.manifest.sources = {{"drive", std::string(64, 'a')}};
  other.manifest.counts = {{"points_in", 5}};
  other.manifest.software_version = "9.9.9";
  other.manifest.voxel_size_m = 0.2;
  other.manifest.frame_id = "elsewhere";
  other.manifest.origin = {-64.0, 128.0, 0.5};
  for (HeldPoint& each : other.points) {
    each.point.x += 64.0F;
    each.point.y -= 128.0F;
    each.point.z -= 0.5F;
  }
  EXPECT_EQ(digest_of(other), digest_of(held()));
}

TEST(ContentDigest, DoesNotTellZerosApart) {
  Held other = held();
  other.points[0].point.x = -0.0F;
  other.points[0].point.intensity = -0.0F;
  EXPECT_EQ(digest_of(other), digest_of(held()));
}

TEST(ContentDigest, TellsEveryFieldOfAPoint) {
  const auto up = [](float& value) {
    value = std::nextafter(value, std::numeric_limits<float>::max());
  };
  expect_another("x", [&](Held& map) { up(map.points[50].point.x); });
  expect_another("y", [&](Held& map) { up(map.points[50].point.y); });
  expect_another("z", [&](Held& map) { up(map.points[50].point.z); });
  expect_another("intensity", [&](Held& map) { up(map.points[50].point.intensity); });
  expect_another("observations", [](Held& map) { ++map.points[50].point.observations; });
  expect_another("kind", [](Held& map) { map.points[50].point.kind = PointKind::kFilled; });
  expect_another("object", [](Held& map) { ++map.points[50].point.object; });
  expect_another("first scan", [](Held& map) { ++map.points[50].history.first_scan; });
  expect_another("last scan", [](Held& map) { ++map.points[50].history.last_scan; });
  expect_another("object's index", [](Held& map) { ++map.points[50].history.object; });
  expect_another("normal", [](Held& map) { ++map.points[50].history.normal[2]; });
  expect_another("planarity", [](Held& map) { ++map.points[50].history.planarity; });
  expect_another("no history", [](Held& map) { map.has_history = false; });
  expect_another("origin", [](Held& map) { map.manifest.origin.z() = 0.001; });
}

TEST(ContentDigest, TellsHowManyPoints) {
  expect_another("one less", [](Held& map) { map.points.pop_back(); });
  expect_another("one twice", [](Held& map) { map.points.push_back(map.points.back()); });
  Held twice = held();
  twice.points.push_back(twice.points.back());
  Held thrice = twice;
  thrice.points.push_back(thrice.points.back());
  EXPECT_NE(digest_of(twice), digest_of(thrice));
  // Two points that swap one value have the same sums of values.
  expect_another("swapped", [](Held& map) {
    std::swap(map.points[3].point.intensity, map.points[4].point.intensity);
  });
}

TEST(ContentDigest, TellsEveryFieldOfAnObject) {
  const auto with = [](const char* what, const std::function<void(MapObject&)>& change) {
    expect_another(what, [&](Held& map) { change(map.objects[1]); });
  };
  with("class", [](MapObject& object) { object.object_class = ObjectClass::kTruck; });
  with("size", [](MapObject& object) { object.size_m.z() += 1e-9; });
  with("score", [](MapObject& object) { object.score = 0.5; });
  with("motion", [](MapObject& object) { object.motion = ObjectMotion::kParked; });
  with("drive", [](MapObject& object) { object.drive = 1; });
  with("first scan", [](MapObject& object) { object.first_scan = 1; });
  with("last scan", [](MapObject& object) { object.last_scan = 2; });
  with("first stamp", [](MapObject& object) { object.first_stamp_ns = -1; });
  with("last stamp", [](MapObject& object) { ++object.last_stamp_ns; });
  with("detections", [](MapObject& object) { ++object.detections; });
  with("points", [](MapObject& object) { ++object.points_removed; });
  with("scan", [](MapObject& object) { object.placements[1].scan = 2; });
  with("centre", [](MapObject& object) { object.placements[1].centre_map.y() += 1e-9; });
  with("yaw", [](MapObject& object) { object.placements[1].yaw_rad += 1e-9; });
  with("placements", [](MapObject& object) { object.placements.pop_back(); });
  expect_another("one less", [](Held& map) { map.objects.pop_back(); });
  // Points and fates name objects by their place in the list.
  expect_another("order", [](Held& map) { std::swap(map.objects[0], map.objects[1]); });
}

TEST(ContentDigest, TellsPoses) {
  expect_another("position", [](Held& map) {
    map.drives[1] = Trajectory({{0, pose(8.0 + 1e-9, 0.0)}});
  });
  expect_another("heading", [](Held& map) { map.drives[1] = Trajectory({{0, pose(8.0, 1e-9)}}); });
  expect_another("stamp", [](Held& map) { map.drives[1] = Trajectory({{1, pose(8.0, 0.0)}}); });
  expect_another("drive", [](Held& map) {
    map.drives.pop_back();
    map.graph.reset();
  });
  expect_another("key frame", [](Held& map) { map.graph->key_frames = {0, 1}; });
  expect_another("loop", [](Held& map) { map.graph->loops[0].weight = 0.25; });
  expect_another("no graph", [](Held& map) { map.graph.reset(); });
  expect_another("place", [](Held& map) { map.places[0] = pose(4.5, 0.0); });
}

TEST(ContentDigest, TellsWhereADriveEnds) {
  Held one = held();
  one.drives = {Trajectory({{0, pose(0.0, 0.0)}, {1, pose(1.0, 0.0)}})};
  one.graph.reset();
  Held two = one;
  two.drives = {Trajectory({{0, pose(0.0, 0.0)}}), Trajectory({{1, pose(1.0, 0.0)}})};
  EXPECT_NE(digest_of(one), digest_of(two));
}

}  // namespace content_digest_test
}  // namespace stillmap::maps
