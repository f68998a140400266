#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_export.hpp>

#include <fstream>
#include <iterator>
#include <set>

#include "support/exported_map.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace map_export_test {

namespace fs = std::filesystem;
using test::published;
using test::SmallMap;
using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;
using enum PointKind;

constexpr GeodeticOrigin kPlace{49.0, 8.4, 116.5};

std::string text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

Trajectory trajectory_from(double x, std::int64_t stamp_ns) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, 0.25, 1.0 / 3.0);
  T.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  return Trajectory({{stamp_ns, T}, {stamp_ns + 100'000'000, T}});
}

/// A point of each kind, in three tiles.
SmallMap sample() {
  SmallMap map;
  map.origin = {7.5, -3.25, 110.0};
  map.points = {{{0.1F, 0.2F, 0.3F}, 0.25F, kMeasured},
                {{19.99F, -0.7F, 1.5F}, 0.5F, kGround},
                {{-12.3F, 33.3F, -2.25F}, 0.75F, kProjected},
                {{-12.4F, 33.4F, -2.5F}, 1.0F, kFilled}};
  map.trajectories = {trajectory_from(1.0, 1'700'000'000'123'456'789)};
  return map;
}

class MapExport : public ::testing::Test {
 protected:
  std::shared_ptr<const MapPackage> map(const SmallMap& map) {
    return published(map, folder_.path() / fmt::format("map{}", maps_++));
  }
  [[nodiscard]] fs::path out(const std::string& name) const { return folder_.path() / name; }
  static std::vector<CloudPoint> read(const fs::path& file) {
    std::vector<CloudPoint> points;
    read_cloud_file(file, [&](std::span<const CloudPoint> some) {
      points.insert(points.end(), some.begin(), some.end());
    });
    return points;
  }
  /// As they come in the tiles' order.
  static std::vector<MapPoint> points_of(const MapPackage& map) {
    std::vector<MapPoint> points;
    for (const TileEntry& tile : map.tiles())
      for (const MapPoint& point : map.tile(tile.id).points_from(Eigen::Vector3d::Zero()))
        points.push_back(point);
    return points;
  }

  test::TemporaryFolder folder_;
  int maps_ = 0;
};

TEST_F(MapExport, LocalPcdHoldsTheTilesToTheBit) {
  const auto package = map(sample());
  const MapExportResult report =
      export_map(*package, "pcd", out("a.pcd"), {.frame = ExportFrame::kLocal});
  EXPECT_EQ(report.origin, sample().origin);
  EXPECT_EQ(report.points, 4U);
  const std::vector<CloudPoint> read_back = read(out("a.pcd"));
  const std::vector<MapPoint> points = points_of(*package);
  ASSERT_EQ(read_back.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(read_back[i].position.cast<float>(),
              Eigen::Vector3f(points[i].x, points[i].y, points[i].z));
    EXPECT_EQ(read_back[i].intensity, points[i].intensity);
  }
}

TEST_F(MapExport, PcdHasThePlainestHeaderAndMapCoordinates) {
  export_map(*map(sample()), "pcd", out("a.pcd"), {});
  const std::string text = text_of(out("a.pcd"));
  EXPECT_THAT(text, HasSubstr("VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\n"
                              "COUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
                              "POINTS 4\nDATA binary\n"));
  EXPECT_EQ(text.size() - (text.find("DATA binary\n") + 12), 4U * 16);
  const Eigen::Vector3d expected = Eigen::Vector3d(-12.3, 33.3, -2.25) + sample().origin;
  EXPECT_LE((read(out("a.pcd"))[0].position - expected).cwiseAbs().maxCoeff(), test::kOffByStepsM);
}

TEST_F(MapExport, KindsAreAFifthFieldOfPcd) {
  export_map(*map(sample()), "pcd", out("a.pcd"), {.kinds = true});
  const std::string text = text_of(out("a.pcd"));
  EXPECT_THAT(text, HasSubstr("FIELDS x y z intensity kind\nSIZE 4 4 4 4 1\nTYPE F F F F U\n"));
  std::multiset<int> kinds;
  for (std::size_t at = text.find("DATA binary\n") + 12 + 16; at < text.size(); at += 17)
    kinds.insert(text[at]);
  EXPECT_THAT(kinds, ElementsAre(0, 1, 2, 3));
}

TEST_F(MapExport, PointsThatWereNotMeasuredCanBeLeftOut) {
  const auto package = map(sample());
  const auto written = [&](const std::set<PointKind>& without, const std::string& name) {
    return export_map(*package, "ply", out(name), {.without = without});
  };
  const MapExportResult all = written({}, "all.ply");
  EXPECT_EQ(all.points, 4U);
  EXPECT_EQ(all.counts.at("left_out"), 0U);
  const MapExportResult real = written({kFilled}, "real.ply");
  EXPECT_EQ(real.points, 3U);
  EXPECT_EQ(real.counts.at("filled"), 0U);
  EXPECT_EQ(real.counts.at("projected"), 1U);
  EXPECT_EQ(written({kProjected, kFilled}, "measured.ply").counts.at("left_out"), 2U);
  EXPECT_EQ(read(out("measured.ply")).size(), 2U);
}

TEST_F(MapExport, FloatsFarFromZeroAreRefusedWithTheRemedy) {
  SmallMap far = sample();
  far.origin = {448'000.0, 5'427'000.0, 110.0};
  const auto package = map(far);
  EXPECT_THAT([&] { export_map(*package, "pcd", out("a.pcd"), {}); },
              ThrowsSaying<InputError>({"5427033 m", "steps of 0.5 m", "local"}));
  EXPECT_THAT([&] { export_map(*package, "autoware", out("a"), {}); },
              ThrowsSaying<InputError>({"steps of 0.5 m"}));
  EXPECT_THAT([&] { export_map(*package, "pcd", out("a.pcd"), {.frame = ExportFrame::kUtm}); },
              ThrowsSaying<std::invalid_argument>({"utm", "map or local", "32-bit floats"}));
  EXPECT_FALSE(fs::exists(out("a.pcd")));
  // Doubles keep them.
  export_map(*package, "ply", out("a.ply"), {});
  const MapTile tile = package->tile({.level = 0, .x = -1, .y = 1});
  EXPECT_EQ(read(out("a.ply"))[0].position, tile.position(tile[0]));
  export_map(*package, "pcd", out("a.pcd"), {.frame = ExportFrame::kLocal});
  EXPECT_THAT(text_of(out("a.pcd")),
              HasSubstr("# map coordinates = these + origin 448000 5427000 110\n"));
  far.origin = {30'000.0, 0.0, 0.0};
  far.place = kPlace;
  EXPECT_THAT([&] { export_map(*map(far), "autoware", out("a"), {.frame = ExportFrame::kUtm}); },
              ThrowsSaying<InputError>({"steps of 0.002 m"}));
}

/// A package may come from anybody.
TEST_F(MapExport, NameOfTheFrameEndsNoLineAndFillsNoHeader) {
  SmallMap odd = sample();
  odd.frame_id = "town\nVIEWPOINT 1 2 3 1 0 0 0\r\"" + std::string(70'000, 'x');
  const auto package = map(odd);
  export_map(*package, "pcd", out("a.pcd"), {});
  EXPECT_THAT(text_of(out("a.pcd")), Not(HasSubstr("\nVIEWPOINT 1")));
  export_map(*package, "ply", out("a.ply"), {});
  EXPECT_THAT(text_of(out("a.ply")), HasSubstr("frame town?VIEWPOINT 1"));
  export_map(*package, "las", out("a.las"), {});
  EXPECT_EQ(read(out("a.las")).size(), odd.points.size());
}

TEST_F(MapExport, PlyInUtmIsWhereTheMapIs) {
  SmallMap placed = sample();
  placed.place = kPlace;
  const auto package = map(placed);
  export_map(*package, "ply", out("a.ply"), {.frame = ExportFrame::kUtm});
  EXPECT_THAT(text_of(out("a.ply")), HasSubstr("comment coordinates EPSG:32632,"));
  const UtmProjection utm(kPlace, {32, true});
  const Eigen::Vector3d back = utm.to_map(read(out("a.ply"))[0].position);
  const MapTile tile = package->tile({.level = 0, .x = -1, .y = 1});
  EXPECT_LT((back - tile.position(tile[0])).norm(), 2e-6);
  EXPECT_THAT(
      [&] { export_map(*map(sample()), "ply", out("b.ply"), {.frame = ExportFrame::kUtm}); },
      ThrowsSaying<InputError>({"without a geodetic origin", "--geo-origin"}));
}

TEST_F(MapExport, AutowareSquaresHoldEachPointOnce) {
  SmallMap town = sample();
  for (int i = 0; i < 2000; ++i)
    town.points.push_back(
        {{0.037F * static_cast<float>(i) - 30.0F, std::sin(static_cast<float>(i)) * 25.0F, 0.5F}});
  town.place = kPlace;
  const auto package = map(town);
  const MapExportResult report = export_map(*package, "autoware", out("a"), {});
  std::size_t points = 0, files = 0;
  for (const fs::directory_entry& file : fs::directory_iterator(out("a") / "pointcloud_map.pcd")) {
    int x = 0, y = 0;
    ASSERT_EQ(std::sscanf(file.path().filename().c_str(), "%d_%d.pcd", &x, &y), 2);
    EXPECT_THAT(text_of(out("a") / "pointcloud_map_metadata.yaml"),
                HasSubstr(fmt::format("\n{}_{}.pcd: [{}, {}]\n", x, y, 20 * x, 20 * y)));
    for (const CloudPoint& point : read(file.path())) {
      ++points;
      EXPECT_GE(point.position.x(), 20.0 * x);
      EXPECT_LT(point.position.x(), 20.0 * x + 20.0);
      EXPECT_GE(point.position.y(), 20.0 * y);
      EXPECT_LT(point.position.y(), 20.0 * y + 20.0);
    }
    ++files;
  }
  EXPECT_EQ(points, town.points.size());
  EXPECT_EQ(files, report.counts.at("squares"));
  EXPECT_EQ(report.files, files + 2);
  EXPECT_THAT(text_of(out("a") / "pointcloud_map_metadata.yaml"),
              StartsWith("x_resolution: 20\ny_resolution: 20\n"));
  EXPECT_EQ(text_of(out("a") / "map_projector_info.yaml"),
            "projector_type: LocalCartesian\nvertical_datum: WGS84\nmap_origin:\n  latitude: 49\n"
            "  longitude: 8.4\n  altitude: 116.5\n");
  EXPECT_THAT(report.notes, ElementsAre(HasSubstr("116.5 m above this map's")));
}

TEST_F(MapExport, AutowareInUtmIsRelativeToTheOriginAndAbsoluteInHeight) {
  SmallMap town = sample();
  town.place = kPlace;
  const auto package = map(town);
  const MapExportResult report =
      export_map(*package, "autoware", out("a"), {.frame = ExportFrame::kUtm});
  EXPECT_THAT(report.notes, IsEmpty());
  EXPECT_THAT(text_of(out("a") / "map_projector_info.yaml"),
              HasSubstr("projector_type: LocalCartesianUTM\n"));
  const CloudPoint point = read(out("a") / "pointcloud_map.pcd" / "0_-1.pcd").at(0);
  const UtmProjection utm(kPlace, {32, true});
  const MapTile tile = package->tile({});
  Eigen::Vector3d expected = utm.to_utm(tile.position(tile[0]));
  expected.head<2>() -= utm.to_utm(Eigen::Vector3d::Zero()).head<2>();
  EXPECT_LT((point.position - expected).norm(), 2e-5);
  EXPECT_NEAR(point.position.z(), 116.5 + 110.3, 1e-3);
  export_map(*map(sample()), "autoware", out("b"), {});
  EXPECT_EQ(text_of(out("b") / "map_projector_info.yaml"), "projector_type: Local\n");
}

TEST_F(MapExport, AutowareInMgrsCountsFromTheCornerOfTheSquare) {
  SmallMap town = sample();
  town.place = kPlace;
  const MapExportResult report =
      export_map(*map(town), "autoware", out("a"), {.frame = ExportFrame::kMgrs});
  EXPECT_THAT(report.notes, ElementsAre(HasSubstr("8 mm coarse")));
  // 456 km east and 5,428 km north. By the letters: zone 32 begins its columns with J (M is the
  // 4th: 400 km), even zones their rows with F (V is the 15th: 1,400 km, and band U above 4,000).
  EXPECT_EQ(text_of(out("a") / "map_projector_info.yaml"),
            "projector_type: MGRS\nvertical_datum: WGS84\nmgrs_grid: 32UMV\n");
  Eigen::Vector3d expected =
      UtmProjection(kPlace, {32, true}).to_utm(town.origin + Eigen::Vector3d(0.1, 0.2, 0.3)) -
      Eigen::Vector3d(400'000.0, 5'400'000.0, 0.0);
  bool found = false;
  for (const fs::directory_entry& tile : fs::directory_iterator(out("a") / "pointcloud_map.pcd"))
    for (const CloudPoint& point : read(tile.path()))
      found = found || (point.position - expected).norm() < 0.01;
  EXPECT_TRUE(found);
  EXPECT_THAT([&] { export_map(*map(town), "ply", out("b"), {.frame = ExportFrame::kMgrs}); },
              ThrowsSaying<std::invalid_argument>({"frame"}));
  // Band T ends and U begins at 48 deg north, within a square whose names are 32TPU and 32UPU.
  town.place = GeodeticOrigin{48.0, 11.2, 0.0};
  town.points = {{{0.0F, -900.0F, 0.0F}}, {{0.0F, 900.0F, 0.0F}}};
  export_map(*map(town), "autoware", out("bands"), {.frame = ExportFrame::kMgrs});
  EXPECT_THAT(text_of(out("bands") / "map_projector_info.yaml"),
              ::testing::ContainsRegex("mgrs_grid: 32[TU]PU\n"));
  // The border of zones 31 and 32, and of two squares.
  town.place = GeodeticOrigin{49.0, 6.3699, 0.0};
  town.points = {{{-9000.0F, 0.0F, 0.0F}}, {{9000.0F, 0.0F, 0.0F}}};
  EXPECT_THAT([&] { export_map(*map(town), "autoware", out("c"), {.frame = ExportFrame::kMgrs}); },
              ThrowsSaying<InputError>({"2 squares of MGRS", "--coordinates utm"}));
}

TEST_F(MapExport, AutowareInTransverseMercatorHasItsZeroAtTheOrigin) {
  SmallMap town = sample();
  town.place = kPlace;
  export_map(*map(town), "autoware", out("a"), {.frame = ExportFrame::kTransverseMercator});
  EXPECT_EQ(text_of(out("a") / "map_projector_info.yaml"),
            "projector_type: TransverseMercator\nvertical_datum: WGS84\nmap_origin:\n"
            "  latitude: 49\n  longitude: 8.4\n  altitude: 0\nscale_factor: 0.9996\n");
  const CloudPoint point = read(out("a") / "pointcloud_map.pcd" / "0_-1.pcd").at(0);
  // Its axes are those of the map, but for the scale; heights are above the ellipsoid.
  EXPECT_NEAR(point.position.x(), 0.9996 * 7.6, 1e-3);
  EXPECT_NEAR(point.position.y(), 0.9996 * -3.05, 1e-3);
  EXPECT_NEAR(point.position.z(), 116.5 + 110.3, 1e-3);
}

/// A street of 12 m with ground up to x = 7, a wall at x = 8 seen from 0.5 m before y = 0.
SmallMap street() {
  SmallMap map;
  map.origin = {100.0, 0.0, 50.0};
  for (int x = 0; x < 28; ++x)
    for (int y = -4; y < 4; ++y)
      map.points.push_back(
          {{0.25F * static_cast<float>(x) + 0.05F, 0.25F * static_cast<float>(y) + 0.05F, 0.0F},
           0.0F,
           kGround,
           0});
  for (int y = -4; y < 4; ++y)
    for (int z = 0; z < 12; ++z)
      map.points.push_back(
          {{8.05F, 0.25F * static_cast<float>(y) + 0.05F, 0.25F * static_cast<float>(z) + 0.05F}});
  // A branch above what drives below it, and a kerb.
  map.points.push_back({{3.05F, 0.55F, 3.0F}});
  map.points.push_back({{4.05F, 0.55F, 0.1F}});
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(100.5, 0.0, 51.5);
  map.trajectories = {Trajectory({{0, T}})};
  return map;
}

struct Picture {
  std::size_t width = 0, height = 0;
  std::string pixels;
  /// Of the cell that holds a point, from the lower left corner.
  [[nodiscard]] int at(double x, double y, double corner_x, double corner_y) const {
    const auto column = static_cast<std::size_t>((x - corner_x) / 0.1);
    const auto row = height - 1 - static_cast<std::size_t>((y - corner_y) / 0.1);
    return static_cast<unsigned char>(pixels.at(row * width + column));
  }
};

Picture picture_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string magic, most;
  Picture picture;
  stream >> magic >> picture.width >> picture.height >> most;
  EXPECT_EQ(magic + most, "P5255");
  stream.get();
  picture.pixels = {std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(picture.pixels.size(), picture.width * picture.height);
  return picture;
}

TEST_F(MapExport, Nav2ShowsWhatStandsAndWhereTheWayIsFree) {
  export_map(*map(street()), "nav2", out("a"), {});
  EXPECT_EQ(text_of(out("a") / "map.yaml"),
            "image: map.pgm\nmode: trinary\nresolution: 0.1\norigin: [100.000000, -1.000000, 0.0]\n"
            "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n");
  const Picture picture = picture_of(out("a") / "map.pgm");
  const auto at = [&](double x, double y) { return picture.at(x, y, 0.0, -1.0); };
  EXPECT_EQ(at(8.05, 0.05), 0) << "the wall";
  EXPECT_EQ(at(2.05, 0.05), 254) << "ground that was seen";
  EXPECT_EQ(at(7.55, 0.05), 254) << "seen through, though no ground was seen there";
  EXPECT_EQ(at(3.05, 0.55), 254) << "below the branch";
  EXPECT_EQ(at(4.05, 0.55), 254) << "the kerb";
  EXPECT_EQ(at(0.25, 0.75), 205) << "neither seen nor passed by a ray";
  // The topmost row is that of the largest y.
  EXPECT_EQ(static_cast<unsigned char>(picture.pixels[80]), 0);
}

TEST_F(MapExport, Nav2BandAndResolutionAreTheUsers) {
  const MapExportResult low =
      export_map(*map(street()), "nav2", out("a"), {.height_band_m = {{0.04, 0.15}}});
  const MapExportResult high = export_map(*map(street()), "nav2", out("b"),
                                          {.resolution_m = 0.5, .height_band_m = {{2.95, 3.5}}});
  EXPECT_EQ(high.counts.at("cells_occupied"), 1U);
  EXPECT_GT(low.counts.at("cells_occupied"), 8U);
  EXPECT_THAT(text_of(out("b") / "map.yaml"), HasSubstr("resolution: 0.5\n"));
}

TEST_F(MapExport, Nav2WithoutGroundOrTooLargeIsRefused) {
  SmallMap bare;
  bare.points = {{{0.0F, 0.0F, 0.0F}}};
  EXPECT_THAT([&] { export_map(*map(bare), "nav2", out("a"), {}); },
              ThrowsSaying<InputError>({"no ground"}));
  SmallMap large = street();
  large.points.push_back({{90'000.0F, 90'000.0F, 0.0F}});
  EXPECT_THAT([&] { export_map(*map(large), "nav2", out("a"), {}); },
              ThrowsSaying<InputError>({"8.1e+11 cells", "--resolution"}));
  EXPECT_THAT([&] { export_map(*map(large), "nav2", out("a"), {.resolution_m = 5.0}); },
              ThrowsSaying<InputError>({"square metres"}));
}

TEST_F(MapExport, TrajectoriesComeBackToTheBit) {
  const auto package = map(sample());
  export_map(*package, "tum", out("a.tum"), {});
  export_map(*package, "kitti", out("a.txt"), {});
  const Trajectory truth = package->trajectories().at(0);
  const Trajectory tum = read_tum_trajectory(out("a.tum"));
  const auto kitti = read_kitti_poses(out("a.txt"));
  ASSERT_EQ(tum.size(), 2U);
  ASSERT_EQ(kitti.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(tum.poses()[i].stamp_ns, truth.poses()[i].stamp_ns);
    EXPECT_EQ(tum.poses()[i].T_map_lidar.translation(), truth.poses()[i].T_map_lidar.translation());
    EXPECT_EQ(kitti[i].translation(), truth.poses()[i].T_map_lidar.translation());
    EXPECT_THAT(kitti[i], test::IsNearPose(truth.poses()[i].T_map_lidar, 0.0, 1e-15));
  }
  export_map(*package, "tum", out("local.tum"), {.frame = ExportFrame::kLocal});
  EXPECT_EQ(read_tum_trajectory(out("local.tum")).poses()[0].T_map_lidar.translation().x(),
            1.0 - 7.5);
}

TEST_F(MapExport, OneOfSeveralTrajectoriesMustBeNamed) {
  SmallMap two = sample();
  two.trajectories.push_back(trajectory_from(5.0, 7));
  const auto package = map(two);
  EXPECT_THAT([&] { export_map(*package, "tum", out("a.tum"), {}); },
              ThrowsSaying<InputError>({"2 trajectories", "--drive", "0 to 1"}));
  export_map(*package, "tum", out("a.tum"), {.drive = 1});
  EXPECT_EQ(read_tum_trajectory(out("a.tum")).poses()[0].stamp_ns, 7);
  EXPECT_THAT([&] { export_map(*package, "kitti", out("b.txt"), {.drive = 2}); },
              ThrowsSaying<InputError>({"drive 2", "0 to 1"}));
  SmallMap none = sample();
  none.trajectories.clear();
  EXPECT_THAT([&] { export_map(*map(none), "tum", out("b.tum"), {}); },
              ThrowsSaying<InputError>({"no trajectory"}));
}

TEST_F(MapExport, WhatAFormatHasNoUseForIsRefused) {
  const auto package = map(sample());
  const auto refused = [&](const std::string& format, const MapExportOptions& options,
                           const std::string& name) {
    EXPECT_THAT([&] { export_map(*package, format, out("a"), options); },
                ThrowsSaying<std::invalid_argument>({name, format}));
  };
  refused("pcd", {.resolution_m = 0.1}, "resolution_m");
  refused("ply", {.kinds = true}, "kinds");
  refused("tum", {.without = {kFilled}}, "without");
  refused("las", {.height_band_m = {{0.0, 1.0}}}, "height_band_m");
  refused("nav2", {.drive = 0}, "drive");
  refused("kitti", {.frame = ExportFrame::kUtm}, "frame");
  EXPECT_THAT([&] { export_map(*package, "dxf", out("a"), {}); },
              ThrowsSaying<std::invalid_argument>({"dxf", "pcd, ply, las"}));
  EXPECT_THAT([&] { export_map(*package, "nav2", out("a"), {.resolution_m = std::nan("")}); },
              ThrowsSaying<std::invalid_argument>({"resolution_m", "nan"}));
  EXPECT_THAT(
      [&] {
        export_map(*package, "nav2", out("a"), {.height_band_m = {{2.0, 1.0}}});
      },
      ThrowsSaying<std::invalid_argument>({"height_band_m", "2 to 1"}));
}

TEST_F(MapExport, NothingIsLeftOfOneThatEndsEarly) {
  const auto package = map(sample());
  for (const MapExportFormat& format : map_export_formats()) {
    MapExportOptions options;
    options.work.go_on = [](double) { return false; };
    EXPECT_THROW(export_map(*package, format.name, out("a"), options), WorkStopped) << format.name;
  }
  std::vector<std::string> left;
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    left.push_back(entry.path().filename().string());
  EXPECT_THAT(left, ElementsAre("map0"));
}

TEST_F(MapExport, AnExistingTargetStaysAsItIs) {
  const auto package = map(sample());
  folder_.write("a.pcd", "mine");
  EXPECT_THAT([&] { export_map(*package, "pcd", out("a.pcd"), {}); },
              ThrowsSaying<InputError>({"a.pcd", "existing"}));
  EXPECT_EQ(text_of(out("a.pcd")), "mine");
  EXPECT_THAT([&] { export_map(*package, "pcd", out("nowhere/a.pcd"), {}); },
              ThrowsSaying<StorageError>({"nowhere"}));
}

TEST_F(MapExport, SameMapSameBytes) {
  const auto package = map(sample());
  for (const MapExportFormat& format : map_export_formats()) {
    // MRPT's program writes simplemaps, where it is (unit/rawlog/simplemap_test.cpp).
    if (format.is_folder || format.name == "simplemap") continue;
    export_map(*package, format.name, out("first"), {});
    export_map(*package, format.name, out("second"), {});
    EXPECT_EQ(text_of(out("first")), text_of(out("second"))) << format.name;
    fs::remove(out("first"));
    fs::remove(out("second"));
  }
}

TEST_F(MapExport, PointsBeyondTheirTilesBoundsAreRefused) {
  const auto package = map(sample());
  const std::string name = package->stored_name({}).file;
  {
    // The step of the first point's x, behind the tile's head.
    std::fstream stream(name.substr(0, name.find(", tile")),
                        std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(32);
    stream.write("\xff\xff", 2);
    ASSERT_TRUE(stream.good()) << name;
  }
  for (const char* format : {"pcd", "nav2", "autoware", "las"})
    EXPECT_THAT([&] { export_map(*package, format, out("a"), {}); },
                ThrowsSaying<InputError>({"tile 0 0", "outside its bounds"}));
}

}  // namespace map_export_test
}  // namespace stillmap::maps
