#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/autoware_map.hpp>
#include <stillmap/maps/error.hpp>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace autoware_map_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class AutowareMaps : public ::testing::Test {
 protected:
  AutowareMaps() {
    for (const char* const name : {"0_0.pcd", "20_0.pcd"})
      folder_.write(fs::path("pointcloud_map.pcd") / name, "");
  }
  [[nodiscard]] AutowareMap read() const { return read_autoware_map(folder_.path()); }
  [[nodiscard]] AutowareMap read(const std::string& projector) const {
    folder_.write("map_projector_info.yaml", projector);
    return read();
  }
  [[nodiscard]] std::vector<std::string> names(const AutowareMap& map) const {
    std::vector<std::string> names;
    for (const fs::path& cloud : map.clouds) names.push_back(cloud.filename().string());
    return names;
  }
  void expect_error(const std::string& projector, const std::vector<std::string>& words) const {
    EXPECT_THAT([&] { (void)read(projector); }, ThrowsSaying<InputError>(words)) << projector;
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(AutowareMaps, HaveTheTilesThatTheirMetadataNames) {
  EXPECT_TRUE(is_autoware_map(folder_.path()));
  EXPECT_TRUE(is_autoware_map(folder_.path() / "pointcloud_map.pcd"));
  EXPECT_THAT(names(read()), ElementsAre("0_0.pcd", "20_0.pcd"));
  EXPECT_THAT(names(read_autoware_map(folder_.path() / "pointcloud_map.pcd/")),
              ElementsAre("0_0.pcd", "20_0.pcd"));
  EXPECT_THAT(read().notes, ElementsAre(HasSubstr("no map_projector_info.yaml")));
  folder_.write("pointcloud_map_metadata.yaml",
                "x_resolution: 20.0\r\ny_resolution: 20.0\r\n0_0.pcd: [0, 0]\r\n");
  EXPECT_THAT(names(read()), ElementsAre("0_0.pcd"));
  EXPECT_THAT(read().notes, Contains(HasSubstr("1 files left out")));
  folder_.write("pointcloud_map_metadata.yaml", "0_0.pcd: [0, 0]\n\"7_0.pcd\":\n  - 7\n  - 0\n");
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"1 tiles", "7_0.pcd", "copy"}));
}

TEST_F(AutowareMaps, MayBeOneFile) {
  fs::remove_all(folder_.path() / "pointcloud_map.pcd");
  EXPECT_FALSE(is_autoware_map(folder_.path()));
  folder_.write("pointcloud_map.pcd", "");
  EXPECT_THAT(names(read()), ElementsAre("pointcloud_map.pcd"));
  const fs::path file = folder_.path() / "pointcloud_map.pcd";
  EXPECT_FALSE(is_autoware_map(file)) << "a cloud like any other";
  folder_.write("map_projector_info.yaml", "projector_type: Local\n");
  EXPECT_TRUE(is_autoware_map(file));
  EXPECT_THAT(names(read_autoware_map(file)), ElementsAre("pointcloud_map.pcd"));
}

TEST_F(AutowareMaps, LieWhereTheirProjectorSays) {
  const AutowareMap local = read("projector_type: Local\n");
  EXPECT_FALSE(local.origin || local.grid);
  const std::string origin =
      "vertical_datum: WGS84\nmap_origin:\n  latitude: 35.0 # [deg]\n  longitude: 139.5\n";
  const AutowareMap cartesian = read("projector_type: LocalCartesian\n" + origin);
  EXPECT_EQ(cartesian.origin.value().longitude_deg, 139.5);
  EXPECT_EQ(cartesian.origin->altitude_m, 0.0);
  EXPECT_FALSE(cartesian.grid);
  EXPECT_THAT(cartesian.heights, IsEmpty());
  // The zero of the coordinates is the origin.
  for (const char* const type : {"LocalCartesianUTM", "TransverseMercator"}) {
    const AutowareMap map = read("projector_type: " + std::string(type) + "\n" + origin);
    const GeodeticOrigin place = place_in_grid(Eigen::Vector3d(0, 0, 12), map.grid.value());
    EXPECT_NEAR(place.latitude_deg, 35.0, 1e-11) << type;
    EXPECT_NEAR(place.longitude_deg, 139.5, 1e-11) << type;
    EXPECT_NEAR(place.altitude_m, 12.0, 1e-9) << type;
  }
  // Autoware's loader takes 0 for the altitude, whatever is written.
  for (const char* const type : {"LocalCartesian", "LocalCartesianUTM", "TransverseMercator"}) {
    const AutowareMap map =
        read("projector_type: " + std::string(type) + "\n" + origin + "  altitude: 116.5\n");
    EXPECT_EQ(map.origin.value().altitude_m, 0.0) << type;
    EXPECT_THAT(map.notes, ElementsAre(HasSubstr("map_origin.altitude 116.5 is taken as 0")));
    if (map.grid)
      EXPECT_NEAR(place_in_grid(Eigen::Vector3d(0, 0, 12), *map.grid).altitude_m, 12.0, 1e-9);
    else
      EXPECT_THAT(map.notes, ElementsAre(HasSubstr("give --geo-origin 35,139.5,116.5")));
  }
  EXPECT_EQ(read("projector_type: TransverseMercator\nscale_factor: 1.0\n"
                 "map_origin: {latitude: 35.0, longitude: 139.5}\n")
                .grid->scale,
            1.0);
  EXPECT_EQ(read("projector_type: LocalCartesian\nvertical_datum: EGM2008\n"
                 "map_origin: {latitude: 35.0, longitude: 139.5}\n")
                .heights,
            "EGM2008");
}

TEST_F(AutowareMaps, OfMgrsCountFromTheCornerOfTheirSquare) {
  const AutowareMap map = read("projector_type: MGRS\nvertical_datum: WGS84\nmgrs_grid: 54SUE\n");
  EXPECT_EQ(map.place_text, "54SUE");
  // The pair of autoware_geography_utils' test.
  const GeodeticOrigin place = place_in_grid(Eigen::Vector3d(86128.0, 43002.0, 10.0), *map.grid);
  EXPECT_NEAR(place.latitude_deg, 35.62426, 1e-5);
  EXPECT_NEAR(place.longitude_deg, 139.74252, 1e-5);
}

TEST_F(AutowareMaps, SayWhatIsWrongWithTheirProjector) {
  expect_error("vertical_datum: WGS84\n", {"map_projector_info.yaml", "no projector_type"});
  expect_error("projector_type: Lambert\n", {"projector_type 'Lambert'", "TransverseMercator"});
  expect_error("projector_type: MGRS\n", {"no mgrs_grid"});
  for (const char* const name : {"54SUQQ", "54", "SUE", "99SUE", "54SUE12", "ZAH"})
    expect_error("projector_type: MGRS\nmgrs_grid: " + std::string(name), {name, "as 54SUE"});
  expect_error("projector_type: LocalCartesian\n", {"no map_origin.latitude"});
  expect_error("projector_type: LocalCartesian\nmap_origin: {latitude: 95, longitude: 0}\n",
               {"latitude_deg: 95"});
  expect_error("projector_type: LocalCartesianUTM\nmap_origin: {latitude: 88, longitude: 0}\n",
               {"latitude 88 in UTM"});
  expect_error(
      "projector_type: TransverseMercator\nmap_origin: {latitude: 8, longitude: 0}\n"
      "scale_factor: 0\n",
      {"scale_factor 0"});
}

TEST_F(AutowareMaps, AreReadOrRefusedWhereverTheirFilesAreCut) {
  const std::string projector =
      "projector_type: TransverseMercator\nvertical_datum: WGS84\nmap_origin:\n  latitude: 35.5\n"
      "  longitude: 139.5\n  altitude: 0.0\nscale_factor: 0.9996\n";
  for (std::size_t size = 0; size < projector.size(); ++size) {
    try {
      (void)read(projector.substr(0, size));
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("map_projector_info.yaml"));
    }
  }
}

}  // namespace autoware_map_test
}  // namespace stillmap::maps
