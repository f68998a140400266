#include <stillmap/maps/map_export.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "support/tiled_map.hpp"

namespace stillmap::maps {
namespace tileset_export_test {

namespace fs = std::filesystem;
using nlohmann::json;
using test::map_point;
using test::TemporaryFolder;
using test::ThrowsSaying;
using test::write_map;

std::string text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void collect(const json& node, std::set<std::string>& uris) {
  if (node.contains("content")) uris.insert(node["content"]["uri"].get<std::string>());
  for (const json& child : node.value("children", json::array())) collect(child, uris);
}

/// Points of a GLB as `glb.hpp` says: they are its end.
std::vector<MapPoint> points_in(const std::string& glb) {
  std::uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, glb.data() + 12, sizeof(json_bytes));
  std::vector<MapPoint> points((glb.size() - 28 - json_bytes) / sizeof(MapPoint));
  std::memcpy(points.data(), glb.data() + 28 + json_bytes, points.size() * sizeof(MapPoint));
  return points;
}

class Export : public ::testing::Test {
 protected:
  TemporaryFolder folder_{test::memory_folder()};
  const fs::path out_ = folder_.path() / "out";
};

TEST_F(Export, UnknownFormatNamesThoseThereAre) {
  const auto map = write_map(folder_.path() / "map", {map_point(1, 2, 3)});
  EXPECT_THAT([&] { export_map(*map, "shp", out_); },
              ThrowsSaying<std::invalid_argument>({"'shp'", "3dtiles"}));
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(Export, TilesetNamesTheFilesThatAreThere) {
  const auto map = write_map(folder_.path() / "map", test::scattered(60.0));
  const MapExportResult report = export_map(*map, "3dtiles", out_);
  EXPECT_EQ(report.points, 16U * 60U * 60U);
  std::set<std::string> named{"tileset.json"};
  collect(json::parse(text_of(out_ / "tileset.json"))["root"], named);
  std::set<std::string> there;
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(out_)) {
    if (!entry.is_regular_file()) continue;
    there.insert(entry.path().lexically_relative(out_).generic_string());
    bytes += entry.file_size();
  }
  EXPECT_EQ(named, there);
  EXPECT_EQ(report.files, there.size());
  EXPECT_EQ(report.bytes, bytes);
  std::size_t points = 0;
  for (const std::string& name : there)
    if (name.starts_with("0/")) points += points_in(text_of(out_ / name)).size();
  EXPECT_EQ(points, report.points);
}

TEST_F(Export, KindsThatAreLeftOutAreOnNoLevel) {
  const auto map = write_map(folder_.path() / "map", test::scattered(60.0));
  MapExportOptions options;
  options.without = {PointKind::kProjected, PointKind::kFilled};
  const MapExportResult report = export_map(*map, "3dtiles", out_, options);
  EXPECT_EQ(report.points, 8U * 60U * 60U);
  std::size_t levels = 0;
  for (const auto& entry : fs::recursive_directory_iterator(out_)) {
    if (entry.path().extension() != ".glb") continue;
    levels += entry.path().lexically_relative(out_).begin()->string() == "1" ? 1 : 0;
    for (const MapPoint& p : points_in(text_of(entry.path()))) EXPECT_TRUE(is_measured(p.kind));
  }
  EXPECT_GT(levels, 0U);
}

TEST_F(Export, LiesInMapCoordinatesOrOnTheEarth) {
  MapManifest manifest;
  manifest.origin = {100.0, 200.0, 3.0};
  export_map(*write_map(folder_.path() / "local", {map_point(1, 2, 3)}, manifest), "3dtiles", out_);
  const auto transform = [](const fs::path& folder) {
    return json::parse(text_of(folder / "tileset.json"))["root"]["transform"]
        .get<std::vector<double>>();
  };
  EXPECT_EQ(transform(out_),
            (std::vector<double>{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 200, 3, 1}));
  // On the equator at 90 degrees east up is +y, east -x, north +z.
  manifest.geodetic_origin = GeodeticOrigin{0.0, 90.0, 10.0};
  export_map(*write_map(folder_.path() / "earth", {map_point(1, 2, 3)}, manifest), "3dtiles",
             folder_.path() / "earth_out");
  const std::vector<double> found = transform(folder_.path() / "earth_out");
  const std::vector<double> expected = {
      -1, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, -100, 6378137.0 + 10.0 + 3.0, 200, 1};
  ASSERT_EQ(found.size(), 16U);
  for (std::size_t i = 0; i < 16; ++i) EXPECT_NEAR(found[i], expected[i], 1e-6) << i;
}

TEST_F(Export, WhatExistsIsNotTouchedAndWhatFailsLeavesNothing) {
  const auto map = write_map(folder_.path() / "map", test::scattered(60.0));
  fs::create_directory(out_);
  EXPECT_THAT([&] { export_map(*map, "3dtiles", out_); },
              ThrowsSaying<InputError>({out_.string(), "an existing path"}));
  EXPECT_TRUE(fs::is_empty(out_));
  fs::remove(out_);
  MapExportOptions options;
  options.without = {PointKind::kMeasured, PointKind::kGround, PointKind::kProjected,
                     PointKind::kFilled};
  EXPECT_THROW(export_map(*map, "3dtiles", out_, options), InputError);
  options.without.clear();
  options.work.go_on = [](double) { return false; };
  EXPECT_THROW(export_map(*map, "3dtiles", out_, options), WorkStopped);
  EXPECT_FALSE(fs::exists(out_));
  EXPECT_FALSE(fs::exists(folder_.path() / ".out.partial"));
}

}  // namespace tileset_export_test
}  // namespace stillmap::maps
