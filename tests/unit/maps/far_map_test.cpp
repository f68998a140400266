#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/glb.hpp>
#include <stillmap/maps/map_difference.hpp>
#include <stillmap/maps/map_export.hpp>
#include <stillmap/maps/map_levels.hpp>
#include <stillmap/maps/tileset.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "support/temporary_folder.hpp"
#include "support/tiled_map.hpp"

namespace stillmap::maps {
namespace far_map_test {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::IsEmpty;
using ::testing::Not;

/// Regions by which a map is moved: 1,000 km to the east, 640 km to the south.
constexpr int kEastRegions = 1562;
constexpr int kSouthRegions = 1000;
constexpr int kTilesOfRegion = 32;
constexpr double kRegionM = kTilesOfRegion * kTileSizeM;
/// By which a float at 1,000 km from the origin is off, at most.
constexpr double kBarM = 0.0005;

Eigen::Vector3d shift_of(bool is_far) {
  return is_far ? Eigen::Vector3d(kEastRegions * kRegionM, -kSouthRegions * kRegionM, 0.0)
                : Eigen::Vector3d::Zero();
}

TileId moved(TileId id, bool is_far) {
  if (!is_far) return id;
  return {.level = id.level,
          .x = id.x + (kEastRegions * kTilesOfRegion >> id.level),
          .y = id.y - (kSouthRegions * kTilesOfRegion >> id.level)};
}

std::string bytes_of(std::span<const MapPoint> points) {
  std::string bytes(points.size_bytes(), '\0');
  std::memcpy(bytes.data(), points.data(), bytes.size());
  return bytes;
}

/// The same points at the map's origin and 1,000 km away from it.
class FarMap : public ::testing::Test {
 protected:
  /// @param points  from a place at the origin of a map that is not far.
  std::shared_ptr<const MapPackage> map(const std::vector<MapPoint>& points, bool is_far,
                                        const Eigen::Vector3d& origin = Eigen::Vector3d::Zero()) {
    std::map<TileId, std::vector<MapPoint>> tiles;
    for (const MapPoint& p : points) {
      const TileId id{.level = 0,
                      .x = static_cast<std::int32_t>(std::floor(p.x / kTileSizeM)),
                      .y = static_cast<std::int32_t>(std::floor(p.y / kTileSizeM))};
      tiles[id].push_back(moved_to(p, Eigen::Vector3d(p.x, p.y, p.z) - corner_of(id)));
    }
    const fs::path folder = folder_.path() / std::to_string(count_++);
    MapPackageWriter writer(folder);
    for (const auto& [id, local] : tiles) {
      const TileId there = moved(id, is_far);
      writer.add_tile(there, MapTile(origin, corner_of(there), local));
    }
    MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = origin;
    manifest.voxel_size_m = 0.1;
    writer.publish(manifest, "{}");
    return MapPackage::open(folder);
  }
  static std::shared_ptr<const MapLevels> levels_of(const MapPackage& map) {
    MapLevels::make(map);
    return MapLevels::open(map);
  }

  test::TemporaryFolder folder_{test::memory_folder()};
  int count_ = 0;
  const std::vector<MapPoint> points_ = test::scattered(130.0);
};

TEST_F(FarMap, TilesHaveTheSameBytes) {
  const auto near = map(points_, false);
  const auto far = map(points_, true);
  ASSERT_THAT(near->tiles(), Not(IsEmpty()));
  for (const TileEntry& tile : near->tiles()) {
    const TileId there = moved(tile.id, true);
    EXPECT_EQ(bytes_of(near->tile(tile.id).points_from(corner_of(tile.id))),
              bytes_of(far->tile(there).points_from(corner_of(there))));
  }
  const std::vector<TileEntry> here = near->tiles(), away = far->tiles();
  for (std::size_t i = 0; i < here.size(); ++i) {
    const Eigen::AlignedBox3d box = here[i].from_origin();
    const Eigen::AlignedBox3d there = away[i].from_origin();
    EXPECT_EQ(there.min() - shift_of(true), box.min());
    EXPECT_EQ(there.max() - shift_of(true), box.max());
  }
}

TEST_F(FarMap, LevelsHaveTheSameBytesAndPlaces) {
  const auto near = levels_of(*map(points_, false));
  const auto far = levels_of(*map(points_, true));
  ASSERT_GE(near->top(), 2U);
  ASSERT_EQ(near->tiles().size(), far->tiles().size());
  for (const TileEntry& tile : near->tiles()) {
    const TileEntry* there = far->find(moved(tile.id, true));
    ASSERT_NE(there, nullptr);
    EXPECT_EQ(bytes_of(near->points(tile.id)), bytes_of(far->points(there->id)));
    EXPECT_EQ(there->from_origin().min() - shift_of(true), tile.from_origin().min());
  }
}

/// Where the node of a GLB puts points: what is added to them, z up.
Eigen::Vector3d place_in(const std::string& glb) {
  std::uint32_t bytes = 0;
  std::memcpy(&bytes, glb.data() + 12, sizeof(bytes));
  const json matrix = json::parse(glb.substr(20, bytes))["nodes"][0]["matrix"];
  return {matrix[12].get<double>(), -matrix[14].get<double>(), matrix[13].get<double>()};
}

TEST_F(FarMap, GlbIsTheSameButForItsPlaceInDoubles) {
  const auto near = map(points_, false);
  const auto far = map(points_, true);
  const std::vector<TileEntry> here = near->tiles(), away = far->tiles();
  for (std::size_t i = 0; i < here.size(); ++i) {
    const TileEntry& tile = here[i];
    const TileEntry& there = away[i];
    const std::string glb = glb_of(tile, near->tile(tile.id).points_from(corner_of(tile.id)));
    const std::string far_glb = glb_of(there, far->tile(there.id).points_from(corner_of(there.id)));
    EXPECT_EQ(place_in(far_glb) - shift_of(true), place_in(glb));
    const std::size_t binary = tile.points * sizeof(MapPoint);
    EXPECT_EQ(far_glb.substr(far_glb.size() - binary), glb.substr(glb.size() - binary));
    EXPECT_EQ(far_glb.substr(far_glb.find("\"accessors\""), 200),
              glb.substr(glb.find("\"accessors\""), 200));
  }
}

TEST_F(FarMap, TilesetHasTheSameBoxesElsewhere) {
  const auto boxes = [&](bool is_far) {
    const auto package = map(points_, is_far);
    std::vector<double> all;
    const std::function<void(const json&)> walk = [&](const json& node) {
      auto box = node["boundingVolume"]["box"].get<std::vector<double>>();
      for (std::size_t axis = 0; axis < 3; ++axis)
        box[axis] -= shift_of(is_far)[static_cast<Eigen::Index>(axis)];
      all.insert(all.end(), box.begin(), box.end());
      for (const json& child : node.value("children", json::array())) walk(child);
    };
    walk(json::parse(Tileset(*package, *levels_of(*package)).text())["root"]);
    return all;
  };
  const std::vector<double> near = boxes(false);
  const std::vector<double> far = boxes(true);
  ASSERT_EQ(near.size(), far.size());
  // Told to the millimetre, rounded outwards.
  for (std::size_t i = 0; i < near.size(); ++i) EXPECT_NEAR(near[i], far[i], 0.0011) << i;
}

TEST_F(FarMap, DifferencesHaveTheSameBytesAndPlaces) {
  const std::vector<MapPoint> others = test::scattered(130.0, 2);
  const auto made = [&](bool is_far) {
    const auto one = map(points_, is_far);
    const auto other = map(others, is_far);
    MapDifference::make(*one, *other, 0.15);
    return MapDifference::open(*one, *other, 0.15);
  };
  const auto near = made(false);
  const auto far = made(true);
  ASSERT_THAT(near->tiles(), Not(IsEmpty()));
  ASSERT_EQ(near->tiles().size(), far->tiles().size());
  for (const DifferenceTile& tile : near->tiles()) {
    const TileId id = moved(tile.entry.id, true);
    const DifferenceTile* there = far->find(tile.side, id.x, id.y);
    ASSERT_NE(there, nullptr);
    EXPECT_EQ(bytes_of(near->points(tile)), bytes_of(far->points(*there)));
    EXPECT_EQ(there->counts.area_m2, tile.counts.area_m2);
    EXPECT_EQ(there->entry.from_origin().max() - shift_of(true), tile.entry.from_origin().max());
  }
}

TEST_F(FarMap, VersionWithAnOriginBesideItIsTheSameMap) {
  const auto far = map(points_, true);
  const auto beside = map(points_, false, shift_of(true));
  for (const auto& [one, other] : {std::pair{far, beside}, {beside, far}}) {
    MapDifference::make(*one, *other, MapDifference::kSmallestToleranceM);
    EXPECT_THAT(MapDifference::open(*one, *other, MapDifference::kSmallestToleranceM)->tiles(),
                IsEmpty());
  }
}

TEST_F(FarMap, ExportsHaveTheSamePoints) {
  const auto written = [&](const std::string& format, ExportFrame frame, bool is_far) {
    const fs::path file = folder_.path() / (std::to_string(count_++) + "." + format);
    const MapExportResult report =
        export_map(*map(points_, is_far), format, file, {.frame = frame});
    std::vector<Eigen::Vector3d> points;
    read_cloud_file(file, [&](std::span<const CloudPoint> some) {
      for (const CloudPoint& point : some)
        points.push_back(point.position + (report.origin - shift_of(is_far)));
    });
    return points;
  };
  // Of LAS only the millimetre counts.
  for (const auto& [format, frame, off_m] : {std::tuple{"ply", ExportFrame::kMap, 1e-6},
                                             {"las", ExportFrame::kMap, 1e-6},
                                             {"pcd", ExportFrame::kLocal, kBarM},
                                             {"ply", ExportFrame::kLocal, 1e-6}}) {
    const auto near = written(format, frame, false);
    const auto far = written(format, frame, true);
    ASSERT_EQ(near.size(), points_.size()) << format;
    ASSERT_EQ(near.size(), far.size()) << format;
    double most_m = 0.0;
    for (std::size_t i = 0; i < near.size(); ++i)
      most_m = std::max(most_m, (near[i] - far[i]).cwiseAbs().maxCoeff());
    EXPECT_LE(most_m, off_m) << format;
  }
}

}  // namespace far_map_test
}  // namespace stillmap::maps
