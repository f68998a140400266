#include <stillmap/maps/tileset.hpp>

#include <stillmap/maps/glb.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/tiled_map.hpp"

namespace stillmap::maps {
namespace tileset_test {

using nlohmann::json;
using test::map_point;
using test::TemporaryFolder;
using test::write_map;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

struct Glb {
  json document;
  std::string binary;
};

std::uint32_t number_at(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

/// Takes a GLB apart as its specification says. Chunks end where the file does.
Glb read_glb(const std::string& bytes) {
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(number_at(bytes, 4), 2U);
  EXPECT_EQ(number_at(bytes, 8), bytes.size());
  const std::uint32_t json_bytes = number_at(bytes, 12);
  EXPECT_EQ(json_bytes % 4, 0U);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  const std::uint32_t binary_bytes = number_at(bytes, 20 + json_bytes);
  EXPECT_EQ(bytes.substr(24 + json_bytes, 4), std::string("BIN\0", 4));
  EXPECT_EQ(28 + json_bytes + binary_bytes, bytes.size());
  return {json::parse(bytes.substr(20, json_bytes)), bytes.substr(28 + json_bytes)};
}

TEST(Glb, HoldsTheTilesBytesAsTheyLie) {
  const std::vector<MapPoint> points = {map_point(0.1F, -2.5F, 3.0F, PointKind::kProjected, 770),
                                        map_point(4.0F, 5.0F, -6.25F)};
  const TileEntry tile{
      .id = {}, .points = 2, .min = {0.1F, -2.5F, -6.25F}, .max = {4.0F, 5.0F, 3.0F}};
  const Glb glb = read_glb(glb_of(tile, points));
  ASSERT_EQ(glb.binary.size(), 40U);
  EXPECT_EQ(std::memcmp(glb.binary.data(), points.data(), 40), 0);
  const json& views = glb.document["bufferViews"];
  EXPECT_EQ(views[0]["byteStride"], 20);
  EXPECT_EQ(glb.document["buffers"][0]["byteLength"], 40);
  EXPECT_EQ(glb.document["meshes"][0]["primitives"][0]["mode"], 0);
  for (const auto& [name, offset, type] :
       {std::tuple{"POSITION", 0, "VEC3"}, {"_INTENSITY", 12, "SCALAR"}, {"_POINT", 16, "VEC4"}}) {
    const json& attributes = glb.document["meshes"][0]["primitives"][0]["attributes"];
    const json& accessor = glb.document["accessors"].at(attributes.at(name).get<std::size_t>());
    EXPECT_EQ(accessor.value("byteOffset", 0), offset) << name;
    EXPECT_EQ(accessor["type"], type) << name;
    EXPECT_EQ(accessor["count"], 2) << name;
  }
}

TEST(Glb, BoundsAreTheFloatsToTheLastBit) {
  const std::vector<MapPoint> points = {map_point(0.1F, 1.0F / 3.0F, 1e-7F)};
  const TileEntry tile{
      .id = {}, .points = 1, .min = {0.1F, 1.0F / 3.0F, 1e-7F}, .max = {0.1F, 1.0F / 3.0F, 1e-7F}};
  const json accessor = read_glb(glb_of(tile, points)).document["accessors"][0];
  for (const char* bound : {"min", "max"}) {
    EXPECT_EQ(accessor[bound][0].get<double>(), static_cast<double>(0.1F));
    EXPECT_EQ(accessor[bound][1].get<double>(), static_cast<double>(1.0F / 3.0F));
    EXPECT_EQ(accessor[bound][2].get<double>(), static_cast<double>(1e-7F));
  }
}

TEST(Glb, NodeTurnsUpSoThat3DTilesTurnsItBack) {
  const TileEntry tile{.id = {}, .points = 1};
  const json document = read_glb(glb_of(tile, std::vector{map_point(0, 0, 0)})).document;
  const auto matrix = document["nodes"][0]["matrix"].get<std::vector<double>>();
  const Eigen::Matrix4d node = Eigen::Map<const Eigen::Matrix4d>(matrix.data());
  // 3D Tiles 1.1: glTF's y up becomes z up by (x, y, z) -> (x, -z, y).
  Eigen::Matrix4d back = Eigen::Matrix4d::Identity();
  back.block<3, 3>(0, 0) << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  EXPECT_EQ(back * node, Eigen::Matrix4d::Identity());
}

TEST(Glb, NodePutsTheTileWhereItIsFromTheOrigin) {
  const std::vector<MapPoint> points = {map_point(0.5F, 19.5F, 3.0F)};
  // 1,000 km away, where a float would be 60 mm coarse.
  const TileEntry tile{.id = {.level = 0, .x = 50'000, .y = -3},
                       .points = 1,
                       .min = {1'000'000.5, -40.5, 3.0},
                       .max = {1'000'000.5, -40.5, 3.0}};
  const json document = read_glb(glb_of(tile, points)).document;
  const json bound = {0.5, 19.5, 3.0};
  EXPECT_EQ(document["accessors"][0]["min"], bound);
  EXPECT_EQ(document["accessors"][0]["max"], bound);
  // x, y, z -> x, z, -y: the corner is 1,000,000, -60, 0.
  EXPECT_EQ(document["nodes"][0]["matrix"],
            json({1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 1'000'000, 0, 60, 1}));
}

TEST(Glb, TileWithoutPointsOrWithTooManyIsNone) {
  EXPECT_THROW((void)glb_head({.id = {}, .points = 0}), std::invalid_argument);
  EXPECT_THROW((void)glb_head({.id = {}, .points = 300'000'000}), std::invalid_argument);
  EXPECT_THROW((void)glb_of({.id = {}, .points = 2}, std::vector{map_point(0, 0, 0)}),
               std::invalid_argument);
}

class TilesetTest : public ::testing::Test {
 protected:
  Tileset tileset(const std::vector<MapPoint>& points, const MapManifest& manifest = {}) {
    map_ = write_map(folder_.path() / "map", points, manifest);
    MapLevels::make(*map_);
    levels_ = MapLevels::open(*map_);
    return {*map_, *levels_};
  }
  /// A point in the middle of each tile of a square.
  static std::vector<MapPoint> one_a_tile(int tiles) {
    std::vector<MapPoint> points;
    for (int x = 0; x < tiles; ++x)
      for (int y = 0; y < tiles; ++y)
        points.push_back(map_point(20.0F * static_cast<float>(x) + 10.0F,
                                   20.0F * static_cast<float>(y) + 10.0F, 1.0F));
    return points;
  }
  /// Every node of a tileset with its parent's.
  static void walk(const json& node, const json* parent,
                   const std::function<void(const json&, const json*)>& visit) {
    visit(node, parent);
    for (const json& child : node.value("children", json::array())) walk(child, &node, visit);
  }

  TemporaryFolder folder_{test::memory_folder()};
  std::shared_ptr<const MapPackage> map_;
  std::shared_ptr<const MapLevels> levels_;
};

bool is_inside(const json& inner, const json& outer) {
  const auto a = inner["boundingVolume"]["box"].get<std::vector<double>>();
  const auto b = outer["boundingVolume"]["box"].get<std::vector<double>>();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double half_a = a[3 + 4 * axis];
    const double half_b = b[3 + 4 * axis];
    if (a[axis] - half_a < b[axis] - half_b - 1e-9) return false;
    if (a[axis] + half_a > b[axis] + half_b + 1e-9) return false;
  }
  return true;
}

TEST_F(TilesetTest, NamesEveryTileOnceInsideItsParentWithSmallerErrors) {
  const Tileset tiles = tileset(test::scattered(130.0));
  EXPECT_THAT(tiles.cuts(), IsEmpty());
  const json document = json::parse(tiles.text());
  EXPECT_EQ(document["asset"]["version"], "1.1");
  EXPECT_EQ(document["root"]["refine"], "REPLACE");
  std::set<std::string> named;
  walk(document["root"], nullptr, [&](const json& node, const json* parent) {
    if (node.contains("content")) {
      EXPECT_TRUE(named.insert(node["content"]["uri"].get<std::string>()).second);
    }
    if (parent == nullptr) return;
    EXPECT_LT(node["geometricError"], (*parent)["geometricError"]);
    EXPECT_TRUE(is_inside(node, *parent)) << node["content"];
  });
  std::set<std::string> expected;
  const auto uri = [](TileId id) {
    return std::to_string(id.level) + "/" + std::to_string(id.x) + "/" + std::to_string(id.y) +
           ".glb";
  };
  for (const TileEntry& tile : map_->tiles()) expected.insert(uri(tile.id));
  for (const TileEntry& tile : levels_->tiles()) expected.insert(uri(tile.id));
  EXPECT_EQ(named, expected);
}

TEST_F(TilesetTest, BoxesHoldAllPointsBelowThemAndErrorsAreTheVoxels) {
  const Tileset tiles = tileset(test::scattered(130.0));
  walk(json::parse(tiles.text())["root"], nullptr, [&](const json& node, const json*) {
    if (!node.contains("content")) return;
    TileId id;
    ASSERT_EQ(std::sscanf(node["content"]["uri"].get<std::string>().c_str(), "%u/%d/%d.glb",
                          &id.level, &id.x, &id.y),
              3);
    EXPECT_DOUBLE_EQ(node["geometricError"].get<double>(),
                     id.level == 0 ? 0.0 : std::ldexp(0.1, static_cast<int>(id.level)));
    const auto box = node["boundingVolume"]["box"].get<std::vector<double>>();
    for (const TileEntry& tile : map_->tiles()) {
      if (tile.id.x >> id.level != id.x || tile.id.y >> id.level != id.y) continue;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_GE(tile.min[axis], box[axis] - box[3 + 4 * axis]);
        EXPECT_LE(tile.max[axis], box[axis] + box[3 + 4 * axis]);
        EXPECT_GT(box[3 + 4 * axis], 0.0);
      }
    }
  });
}

TEST_F(TilesetTest, TellsTheLevelsTheirPointsAndTheOrigin) {
  MapManifest manifest;
  manifest.origin = {448000.125, 5427000.0, 3.0};
  const json extras = json::parse(tileset(test::scattered(130.0), manifest).text())["extras"];
  EXPECT_EQ(extras["levels"], levels_->top());
  EXPECT_EQ(extras["points"].size(), levels_->top() + 1);
  EXPECT_EQ(extras["points"][0], 16 * 130 * 130);
  EXPECT_EQ(extras["origin"], json({448000.125, 5427000.0, 3.0}));
  EXPECT_EQ(extras["digest"], map_->digest());
  EXPECT_EQ(extras["voxel_size_m"], 0.1);
}

TEST_F(TilesetTest, BigMapIsCutIntoTilesetsOfBoundedSize) {
  const Tileset tiles = tileset(one_a_tile(80));
  ASSERT_THAT(tiles.cuts(), Not(IsEmpty()));
  std::set<std::string> named, sets;
  const auto collect = [&](const std::string& text, const std::string& folder) {
    EXPECT_LT(text.size(), 300'000U);
    walk(json::parse(text)["root"], nullptr, [&](const json& node, const json* parent) {
      if (parent != nullptr) {
        EXPECT_TRUE(is_inside(node, *parent));
      }
      if (!node.contains("content")) return;
      std::string uri = node["content"]["uri"];
      if (!folder.empty()) {
        EXPECT_EQ(uri.substr(0, 6), "../../");
        uri = uri.substr(6);
      }
      EXPECT_TRUE((uri.ends_with(".json") ? sets : named).insert(uri).second) << uri;
    });
  };
  collect(tiles.text(), "");
  for (const TileId cut : tiles.cuts()) {
    EXPECT_EQ(cut.level % Tileset::kCutEvery, 0U);
    collect(tiles.cut_text(cut), "cut");
  }
  EXPECT_EQ(sets.size(), tiles.cuts().size());
  EXPECT_EQ(named.size(), map_->manifest().extent.tiles + levels_->tiles().size());
  EXPECT_THROW((void)tiles.cut_text({.level = 0, .x = 0, .y = 0}), std::invalid_argument);
}

TEST_F(TilesetTest, EmptyMapIsATilesetOfNothing) {
  const json document = json::parse(tileset({}).text());
  EXPECT_FALSE(document["root"].contains("children"));
  EXPECT_EQ(document["root"]["boundingVolume"]["box"].size(), 12U);
}

TEST_F(TilesetTest, OnePointIsATileOfItsOwn) {
  const json root = json::parse(tileset({map_point(1, 2, 3)}).text())["root"];
  ASSERT_EQ(root["children"].size(), 1U);
  EXPECT_EQ(root["children"][0]["content"]["uri"], "0/0/0.glb");
  EXPECT_NEAR(root["children"][0]["boundingVolume"]["box"][0].get<double>(), 1.0, 0.001);
}

TEST_F(TilesetTest, TransformIsThatOfTheOriginColumnByColumn) {
  const Tileset tiles = tileset({map_point(1, 2, 3)});
  EXPECT_THAT(tiles.text(), Not(HasSubstr("transform")));
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T(0, 3) = 7.5;
  T(1, 0) = 2.0;
  EXPECT_THAT(json::parse(tiles.text(T))["root"]["transform"].get<std::vector<double>>(),
              ElementsAre(1, 2, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 7.5, 0, 0, 1));
}

}  // namespace tileset_test
}  // namespace stillmap::maps
