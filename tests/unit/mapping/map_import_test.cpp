#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/map_import.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_export.hpp>
#include <stillmap/maps/map_package.hpp>

#include <bit>
#include <cstring>
#include <fstream>
#include <iterator>

#include "import/upright.hpp"
#include "support/las_bytes.hpp"
#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace map_import_test {

namespace fs = std::filesystem;
using maps::InputError;
using test::IsNearPose;
using test::ThrowsSaying;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <typename Number>
std::string pcd_of(const std::vector<Eigen::Vector3d>& points) {
  std::string text = fmt::format(
      "VERSION 0.7\nFIELDS x y z\nSIZE {0} {0} {0}\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {1}\nHEIGHT 1\n"
      "POINTS {1}\nDATA binary\n",
      sizeof(Number), points.size());
  for (const Eigen::Vector3d& p : points) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto bytes =
          std::bit_cast<std::array<char, sizeof(Number)>>(static_cast<Number>(p[axis]));
      text.append(bytes.data(), bytes.size());
    }
  }
  return text;
}

class MapImport : public ::testing::Test {
 protected:
  MapImportResult import(const std::string& file, const std::string& bytes,
                         const std::string& map = "map") {
    folder_.write(file, bytes);
    return import_map(folder_.path() / file, folder_.path() / map, options_, {}, cancel_);
  }
  [[nodiscard]] std::shared_ptr<const maps::MapPackage> map(const std::string& name = "map") const {
    return maps::MapPackage::open(folder_.path() / name);
  }
  static std::vector<Eigen::Vector3d> points_of_a_street(const Eigen::Vector3d& shift) {
    std::vector<Eigen::Isometry3d> seen_from;
    for (int x = 0; x <= 60; x += 4) seen_from.push_back(test::pose_at(x, 0.3));
    std::vector<Eigen::Vector3d> points = test::street(11, 80.0).mapped_from(
        seen_from, {.rings = 32, .columns = 500, .noise_m = 0.01, .seed = 3});
    for (Eigen::Vector3d& p : points) p += shift;
    return points;
  }

  test::TemporaryFolder folder_;
  MapImportOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(MapImport, ScansAreFoundInItWithAndWithoutAPrior) {
  const Eigen::Vector3d utm(448000.0, 5427000.0, 110.0);
  const MapImportResult report = import("cloud.pcd", pcd_of<double>(points_of_a_street(utm)));
  EXPECT_THAT(report.warnings, IsEmpty());
  EXPECT_GT(report.counts.at("places"), 10U);
  EXPECT_GT(report.counts.at("ground"), report.counts.at("static") / 10);
  const auto aligner = localization::make_aligner("default", *map());
  const test::SyntheticWorld world = test::street(11, 80.0);
  Eigen::Isometry3d T_truth = test::pose_at(27.0, -0.6, 0.1);
  const maps::PointCloud scan = world.scan(T_truth, {.noise_m = 0.01, .seed = 77});
  T_truth.pretranslate(utm);
  Eigen::Isometry3d T_prior = T_truth;
  T_prior.pretranslate(Eigen::Vector3d(0.8, -0.5, 0.0));
  EXPECT_THAT(aligner->align(scan, localization::Prior{T_prior, {}}).T_map_lidar,
              IsNearPose(T_truth, 0.05, 0.005));
  EXPECT_THAT(aligner->align(scan, std::nullopt).T_map_lidar, IsNearPose(T_truth, 0.05, 0.005));
}

TEST_F(MapImport, MapsOnTheirSideAreSaidAndTurned) {
  const auto points = points_of_a_street(Eigen::Vector3d::Zero());
  const MapImportResult upright = import("upright.pcd", pcd_of<double>(points), "upright");
  EXPECT_THAT(upright.warnings, IsEmpty());
  for (const char* up : {"x", "-x", "y", "-y"}) {
    std::vector<Eigen::Vector3d> turned;
    for (const Eigen::Vector3d& p : points) turned.push_back(R_upright(up).transpose() * p);
    options_.up = "z";
    const std::string name = std::string("map") + up;
    EXPECT_THAT(
        import("turned.pcd", pcd_of<double>(turned), name).warnings,
        ::testing::Contains(::testing::AllOf(HasSubstr("stands on its side"),
                                             ::testing::EndsWith(std::string("--up ") + up))));
    options_.up = up;
    const MapImportResult mended = import("turned.pcd", pcd_of<double>(turned), name + "_up");
    EXPECT_THAT(mended.warnings, IsEmpty());
    EXPECT_EQ(mended.counts.at("ground"), upright.counts.at("ground")) << up;
  }
  options_.up = "north";
  EXPECT_THAT(options_.violations(), ::testing::Contains(HasSubstr("--up")));
}

TEST_F(MapImport, PackageSaysWhatItIsMadeOf) {
  options_.frame_id = "utm-32n";
  const std::vector<Eigen::Vector3d> points{
      {10.26, 20.0, 1.0}, {10.28, 20.0, 1.0}, {14.0, 20.0, 1.0}};
  const MapImportResult report = import("cloud.pcd", pcd_of<double>(points));
  EXPECT_EQ(report.counts.at("in"), 3U);
  EXPECT_EQ(report.counts.at("static"), 2U) << "two of them share a voxel of 0.1 m";
  const auto package = map();
  EXPECT_EQ(package->digest(), report.digest);
  EXPECT_EQ(package->manifest().frame_id, "utm-32n");
  EXPECT_EQ(package->manifest().origin, Eigen::Vector3d(20.0, 20.0, 1.0));
  EXPECT_EQ(package->manifest().sources.at("cloud"), "cloud.pcd");
  EXPECT_THAT(package->trajectories(), IsEmpty());
  EXPECT_THAT(package->verify(), IsEmpty());
  EXPECT_THAT(report.warnings, ::testing::Contains(HasSubstr("no free ground")));
}

TEST_F(MapImport, CoarseCoordinatesAreRefusedOrSaid) {
  const Eigen::Vector3d p(448000.3, 1.0, 1.0);
  EXPECT_THAT([&] { (void)import("utm.pcd", pcd_of<float>({p})); },
              ThrowsSaying<InputError>({"utm.pcd", "448000 m", "32-bit", "doubles"}));
  EXPECT_FALSE(fs::exists(folder_.path() / "map"));
  EXPECT_NO_THROW((void)import("double.pcd", pcd_of<double>({p}), "double"));
  const MapImportResult near = import("near.pcd", pcd_of<float>({0.1 * p}), "near");
  EXPECT_THAT(near.warnings, ::testing::Contains(HasSubstr("coarse")));
}

TEST_F(MapImport, FilesWithoutAPointAreRefusedInWords) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(
      [&] {
        (void)import("nan.pcd", pcd_of<double>({{nan, 1.0, 2.0}}));
      },
      ThrowsSaying<InputError>({"nan.pcd", "finite"}));
  EXPECT_THAT([&] { (void)import("empty.pcd", pcd_of<double>({})); },
              ThrowsSaying<InputError>({"empty.pcd", "no point"}));
  EXPECT_THAT([&] { (void)import("cloud.xyz", "1 2 3"); },
              ThrowsSaying<InputError>({"cloud.xyz", ".pcd, .ply or .las"}));
  test::LasBytes las;
  las.points = {{1, 1, 1, 1, 7}};
  EXPECT_THAT([&] { (void)import("noise.las", las.bytes()); },
              ThrowsSaying<InputError>({"noise.las", "no point"}));
}

constexpr maps::GeodeticOrigin kTownHall{49.0093, 8.4037, 115.0};

/// A street around the town hall, in UTM, with what a file says of that.
test::LasBytes las_of(const std::vector<Eigen::Vector3d>& points_enu, std::uint16_t epsg) {
  const maps::UtmProjection utm(kTownHall, {32, true});
  test::LasBytes las;
  las.offset = {456'000.0, 5'428'000.0, 0.0};
  for (const Eigen::Vector3d& p : points_enu) {
    const Eigen::Vector3d whole =
        ((utm.to_utm(p) - Eigen::Vector3d(456'000.0, 5'428'000.0, 0.0)) / 0.001).array().round();
    las.points.push_back({static_cast<std::int32_t>(whole.x()),
                          static_cast<std::int32_t>(whole.y()),
                          static_cast<std::int32_t>(whole.z())});
  }
  std::string keys(16, '\0');
  test::LasBytes::put<std::uint16_t>(keys, 6, 1);
  test::LasBytes::put<std::uint16_t>(keys, 8, 3072);
  test::LasBytes::put<std::uint16_t>(keys, 12, 1);
  test::LasBytes::put(keys, 14, epsg);
  if (epsg != 0) las.records = {{"LASF_Projection", 34735, keys}};
  return las;
}

/// The one point of a map of one voxel, in map coordinates.
Eigen::Vector3d only_point(const maps::MapPackage& package) {
  const maps::MapTile tile = package.tile(package.tiles().at(0).id);
  return tile.position(tile[0]);
}

TEST_F(MapImport, UtmBecomesALocalFrameThatKnowsItsPlace) {
  const std::vector<Eigen::Vector3d> points = points_of_a_street(Eigen::Vector3d::Zero());
  const MapImportResult report = import("street.las", las_of(points, 32632).bytes());
  EXPECT_THAT(report.warnings, IsEmpty());
  const auto package = map();
  const maps::MapManifest& manifest = package->manifest();
  EXPECT_EQ(manifest.frame_id, "enu");
  EXPECT_EQ(manifest.options.at("utm"), "EPSG:32632");
  ASSERT_TRUE(manifest.geodetic_origin);
  // In the middle of the points; what is there is at the same place on the Earth.
  const Eigen::Isometry3d T_hall_map = maps::T_enu_enu(kTownHall, *manifest.geodetic_origin);
  EXPECT_LT(T_hall_map.translation().norm(), 100.0);
  const auto aligner = localization::make_aligner("default", *package);
  Eigen::Isometry3d T_truth = test::pose_at(27.0, -0.6, 0.1);
  const maps::PointCloud scan = test::street(11, 80.0).scan(T_truth, {.noise_m = 0.01, .seed = 77});
  T_truth = T_hall_map.inverse() * T_truth;
  // North of the map is not that of the zone: 0.45 deg here.
  EXPECT_THAT(aligner->align(scan, localization::Prior{T_truth, {}}).T_map_lidar,
              IsNearPose(T_truth, 0.03, 0.002));
}

TEST_F(MapImport, UsersOriginAndZoneAreTaken) {
  const std::vector<Eigen::Vector3d> points{{12.25, -7.5, 1.25}};
  options_.geodetic_origin = kTownHall;
  static_cast<void>(import("said.las", las_of(points, 32632).bytes(), "said"));
  EXPECT_LT((only_point(*map("said")) - points[0]).norm(), 0.002);
  EXPECT_EQ(map("said")->manifest().geodetic_origin->latitude_deg, kTownHall.latitude_deg);
  options_.utm = maps::UtmZone{32, true};
  static_cast<void>(import("unsaid.las", las_of(points, 0).bytes(), "unsaid"));
  EXPECT_LT((only_point(*map("unsaid")) - points[0]).norm(), 0.002);
  EXPECT_THAT([&] { (void)import("other.las", las_of(points, 32633).bytes(), "other"); },
              ThrowsSaying<InputError>({"other.las", "EPSG:32633", "EPSG:32632"}));
  // Without a zone the coordinates are those of the frame.
  options_.utm.reset();
  static_cast<void>(import("plain.pcd", pcd_of<double>(points), "plain"));
  // The step of a package's coordinates.
  EXPECT_LT((only_point(*map("plain")) - points[0]).norm(), 0.00034);
  EXPECT_EQ(map("plain")->manifest().frame_id, "enu");
  EXPECT_EQ(map("plain")->manifest().geodetic_origin->altitude_m, 115.0);
}

TEST_F(MapImport, OurOwnAutowareMapsComeBackInAnyProjection) {
  const std::vector<Eigen::Vector3d> points{{12.25, -7.5, 1.25}, {61.5, 40.25, 3.25}};
  options_.geodetic_origin = kTownHall;
  static_cast<void>(import("plain.pcd", pcd_of<double>(points), "plain"));
  options_ = {};
  const std::map<std::string, maps::ExportFrame> frames{
      {"LocalCartesian", maps::ExportFrame::kMap},
      {"LocalCartesianUTM", maps::ExportFrame::kUtm},
      {"MGRS", maps::ExportFrame::kMgrs},
      {"TransverseMercator", maps::ExportFrame::kTransverseMercator}};
  for (const auto& [projector, frame] : frames) {
    const fs::path exported = folder_.path() / projector;
    maps::export_map(*map("plain"), "autoware", exported, {.frame = frame});
    const std::string name = "back_" + projector;
    // Autoware takes 0 for the altitude in the file.
    options_.geodetic_origin.reset();
    if (projector == "LocalCartesian") options_.geodetic_origin = kTownHall;
    import_map(exported, folder_.path() / name, options_, {}, cancel_);
    const auto package = map(name);
    EXPECT_THAT(package->manifest().options.at("projector"), ::testing::StartsWith(projector));
    EXPECT_EQ(package->manifest().options.at("import"), "autoware");
    EXPECT_EQ(package->manifest().sources.at("cloud"), projector);
    ASSERT_TRUE(package->manifest().geodetic_origin) << projector;
    // The same places on the Earth.
    const Eigen::Isometry3d T_hall_map =
        maps::T_enu_enu(kTownHall, *package->manifest().geodetic_origin);
    std::size_t found = 0;
    for (const maps::TileEntry& entry : package->tiles()) {
      const maps::MapTile tile = package->tile(entry.id);
      for (const maps::MapPoint& point : tile) {
        const Eigen::Vector3d p = T_hall_map * tile.position(point);
        for (const Eigen::Vector3d& expected : points)
          found += (p - expected).norm() < (projector == "MGRS" ? 0.01 : 0.002) ? 1U : 0U;
      }
    }
    EXPECT_EQ(found, 2U) << projector;
    // A grid has its z up.
    options_.up = "y";
    const auto lying = [&] {
      import_map(exported, folder_.path() / (name + "_y"), options_, {}, cancel_);
    };
    if (projector == "LocalCartesian")
      EXPECT_NO_THROW(lying());
    else
      EXPECT_THAT(lying, ThrowsSaying<maps::InputError>({projector, "--up"})) << projector;
    options_.up = "z";
  }
}

TEST_F(MapImport, AutowaresOwnOriginIsNotReplaced) {
  const std::string cloud = pcd_of<float>({{1, 2, 3}});
  folder_.write("aw/pointcloud_map.pcd/a.pcd", cloud);
  const std::string origin = "map_origin: {latitude: 48.0, longitude: 11.6, altitude: 500}\n";
  folder_.write("aw/map_projector_info.yaml", "projector_type: LocalCartesian\n" + origin);
  const auto import_to = [&](const std::string& name) {
    import_map(folder_.path() / "aw", folder_.path() / name, options_, {}, cancel_);
    return map(name)->manifest().geodetic_origin.value();
  };
  EXPECT_EQ(import_to("own").altitude_m, 0.0);
  options_.geodetic_origin = maps::GeodeticOrigin{48.0, 11.6, 500.0};
  EXPECT_EQ(import_to("same").altitude_m, 500.0);
  options_.geodetic_origin = maps::GeodeticOrigin{48.00001, 11.6, 0.0};
  EXPECT_THAT([&] { (void)import_to("other"); },
              ThrowsSaying<InputError>({"48, 11.6", "48.00001, 11.6", "leave --geo-origin out"}));
  folder_.write("aw/map_projector_info.yaml", "projector_type: Local\n");
  EXPECT_EQ(import_to("local").latitude_deg, 48.00001);
}

TEST_F(MapImport, FoldersThatAreNoAutowareMapAreRefused) {
  folder_.write("tiles/a.pcd", pcd_of<float>({{1, 2, 3}}));
  EXPECT_THAT(
      [&] { import_map(folder_.path() / "tiles", folder_.path() / "m", options_, {}, cancel_); },
      ThrowsSaying<InputError>({"tiles", "without pointcloud_map.pcd", "Autoware"}));
  folder_.write("aw/pointcloud_map.pcd/a.pcd", pcd_of<float>({{1, 2, 3}}));
  folder_.write("aw/map_projector_info.yaml", "projector_type: MGRS\nmgrs_grid: 54SUE\n");
  options_.utm = maps::UtmZone{32, true};
  EXPECT_THAT(
      [&] { import_map(folder_.path() / "aw", folder_.path() / "m", options_, {}, cancel_); },
      ThrowsSaying<InputError>({"aw", "--utm", "leave --utm out"}));
}

TEST_F(MapImport, PlacesThatDoNotFitTheZoneAreRefused) {
  options_.geodetic_origin = kTownHall;
  options_.utm = maps::UtmZone{32, true};
  // Local coordinates, called UTM.
  EXPECT_THAT(
      [&] {
        (void)import("local.pcd", pcd_of<double>({{12.0, -7.0, 1.0}}));
      },
      ThrowsSaying<InputError>({"local.pcd", "km from the geodetic origin", "100 km"}));
  // Eastings with the zone before them, as of EPSG:4647.
  const maps::UtmProjection utm(kTownHall, {32, true});
  const Eigen::Vector3d prefixed = utm.to_utm({5, 5, 0}) + Eigen::Vector3d(32e6, 0.0, 0.0);
  EXPECT_THAT([&] { (void)import("prefixed.pcd", pcd_of<double>({prefixed})); },
              ThrowsSaying<InputError>({"prefixed.pcd", "not of UTM zone 32N"}));
  options_.geodetic_origin->latitude_deg += 1.0;
  EXPECT_THAT(
      [&] {
        (void)import("far.pcd", pcd_of<double>({utm.to_utm({5, 5, 0})}));
      },
      ThrowsSaying<InputError>({"far.pcd", "111 km from"}));
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "map"));
}

TEST_F(MapImport, OtherDatumsAreSaidByTheImportAndByExports) {
  const MapImportResult report = import("etrs.las", las_of({{1, 2, 3}}, 25832).bytes());
  EXPECT_THAT(report.warnings, ::testing::Contains(HasSubstr("'EPSG:25832' are taken as")));
  const auto said = "coordinates of 'EPSG:25832'";
  EXPECT_EQ(map()->manifest().options.at("taken_as_wgs84"), said);
  // A datum that is farther off, which the options take for another.
  options_.utm = maps::UtmZone{32, true};
  EXPECT_THAT(import("ed50.las", las_of({{1, 2, 3}}, 23032).bytes(), "ed50").warnings,
              ::testing::Contains("coordinates of 'EPSG:23032' are taken as EPSG:32632, as the "
                                  "options say"));
  const auto exported = maps::export_map(*map(), "ply", folder_.path() / "out.ply");
  EXPECT_THAT(exported.notes, ::testing::Contains(HasSubstr(said)));
  std::ifstream file(folder_.path() / "out.ply");
  const std::string head{std::istreambuf_iterator<char>(file), {}};
  EXPECT_THAT(head.substr(0, head.find("end_header")), HasSubstr(said));
}

TEST_F(MapImport, OtherProjectionsAreTakenAsTheyAreAndSaid) {
  const MapImportResult report = import("gk.las", las_of({{1, 2, 3}}, 31467).bytes());
  EXPECT_THAT(report.warnings, ::testing::Contains(HasSubstr("EPSG:31467")));
  EXPECT_FALSE(map()->manifest().geodetic_origin);
}

TEST_F(MapImport, OptionsOutOfBoundsAreRefused) {
  options_.geodetic_origin = maps::GeodeticOrigin{91.0, 0.0, 0.0};
  EXPECT_THAT(
      [&] {
        (void)import("cloud.pcd", pcd_of<double>({{1.0, 1.0, 2.0}}));
      },
      ThrowsSaying<std::invalid_argument>({"latitude_deg: 91"}));
  options_.geodetic_origin.reset();

  options_.frame_id = "";
  EXPECT_THAT(
      [&] {
        (void)import("cloud.pcd", pcd_of<double>({{1.0, 1.0, 2.0}}));
      },
      ThrowsSaying<std::invalid_argument>({"frame_id"}));
  options_.frame_id = "local";
  options_.voxel_size_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(
      [&] {
        (void)import("cloud.pcd", pcd_of<double>({{1.0, 1.0, 2.0}}));
      },
      ThrowsSaying<std::invalid_argument>({"voxel_size_m"}));
}

TEST_F(MapImport, SameBytesForAnyNumberOfThreads) {
  const std::string cloud = pcd_of<float>(points_of_a_street({0.0, 0.0, 0.0}));
  options_.threads = 1;
  const std::string digest = import("cloud.pcd", cloud, "alone").digest;
  options_.threads = 3;
  EXPECT_EQ(import("cloud.pcd", cloud, "many").digest, digest);
}

}  // namespace map_import_test
}  // namespace stillmap::mapping
