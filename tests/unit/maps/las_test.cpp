#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_export.hpp>

#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>

#include "exports/crs_text.hpp"
#include "formats/crs.hpp"
#include "formats/las.hpp"
#include "support/exported_map.hpp"
#include "support/las_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace las_test {

using test::LasBytes;
using test::ThrowsSaying;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct Read {
  std::vector<CloudPoint> points;
  CloudSummary summary;
  std::size_t most_at_once = 0;
};

/// From bytes that end where a read beyond them is seen by the sanitizer.
Read read(const std::string& text) {
  const std::vector<char> bytes(text.begin(), text.end());
  Read read;
  read.summary = stream_las(std::as_bytes(std::span(bytes)), "town.las",
                            [&](std::span<const CloudPoint> some) {
                              read.points.insert(read.points.end(), some.begin(), some.end());
                              read.most_at_once = std::max(read.most_at_once, some.size());
                            });
  return read;
}

LasBytes sample(std::uint8_t minor = 2, std::uint8_t format = 0) {
  LasBytes las;
  las.minor = minor;
  las.format = format;
  las.offset = {448'000.0, 5'427'000.0, 100.0};
  las.points = {{1234, -5678, 90, 65535}, {-1, 0, 2'000'000'000, 0}};
  return las;
}

TEST(Las, EveryVersionAndPointFormat) {
  for (const int minor : {0, 1, 2, 3, 4}) {
    for (int format = 0; format <= 10; ++format) {
      for (const int extra : {0, 7}) {
        LasBytes las = sample(static_cast<std::uint8_t>(minor), static_cast<std::uint8_t>(format));
        las.extra_bytes = static_cast<std::uint16_t>(extra);
        const Read all = read(las.bytes());
        ASSERT_EQ(all.points.size(), 2U) << minor << " " << format;
        EXPECT_EQ(all.points[0].position,
                  Eigen::Vector3d(1234 * 0.001 + 448'000.0, -5678 * 0.001 + 5'427'000.0,
                                  90 * 0.001 + 100.0));
        EXPECT_EQ(all.points[0].intensity, 65535.0F);
        EXPECT_EQ(all.points[1].position.z(), 2'000'100.0);
        EXPECT_FALSE(all.summary.single_precision);
      }
    }
  }
}

TEST(Las, WithheldPointsAndNoiseAreLeftOutAndCounted) {
  for (const int format : {0, 6}) {
    LasBytes las = sample(4, static_cast<std::uint8_t>(format));
    las.points[1].withheld = true;
    las.points.push_back({5, 5, 5, 1, 7});
    las.points.push_back({6, 6, 6, 1, 1});
    const Read all = read(las.bytes());
    EXPECT_EQ(all.points.size(), 2U);
    EXPECT_EQ(all.summary.withheld, 2U);
    EXPECT_EQ(all.summary.points_in_file, 4U);
  }
}

TEST(Las, PointsThatTheHeaderDoesNotCountAreNotPassedOverInSilence) {
  for (const int minor : {2, 3, 4}) {
    LasBytes las = sample(static_cast<std::uint8_t>(minor), minor == 4 ? 6 : 0);
    std::string bytes = las.bytes();
    LasBytes::put(bytes, minor == 4 ? 247 : 107, std::uint32_t{0});
    EXPECT_THAT([&] { read(bytes); }, ThrowsSaying<InputError>({"count of 0", "lasinfo -repair"}))
        << minor;
    las.points.clear();
    if (minor == 4) las.long_records = {{"other", 7, std::string(100, 'x')}};
    EXPECT_THAT(read(las.bytes()).points, IsEmpty()) << minor;
  }
}

TEST(Las, ManyPointsComeInPieces) {
  LasBytes las = sample();
  las.points.assign(200'000, {});
  const Read all = read(las.bytes());
  EXPECT_EQ(all.points.size(), 200'000U);
  EXPECT_LE(all.most_at_once, 65536U);
  las.points.clear();
  EXPECT_THAT(read(las.bytes()).points, IsEmpty());
}

TEST(Las, ZoneFromWktBeforeOrBehindThePoints) {
  for (const bool behind : {false, true}) {
    LasBytes las = sample(4, 6);
    las.encoding = 16;
    const LasBytes::Record wkt{"LASF_Projection", 2112, utm_wkt({32, true}) + '\0'};
    (behind ? las.long_records : las.records).push_back(wkt);
    const Read all = read(las.bytes());
    EXPECT_EQ(all.summary.utm, (UtmZone{32, true}));
    EXPECT_EQ(all.summary.coordinates, "WGS 84 / UTM zone 32N");
  }
}

std::string geo_keys(const std::vector<std::array<std::uint16_t, 2>>& keys) {
  std::string bytes(8 + 8 * keys.size(), '\0');
  LasBytes::put<std::uint16_t>(bytes, 0, 1);
  LasBytes::put(bytes, 6, static_cast<std::uint16_t>(keys.size()));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    LasBytes::put(bytes, 8 + 8 * i, keys[i][0]);
    LasBytes::put<std::uint16_t>(bytes, 12 + 8 * i, 1);
    LasBytes::put(bytes, 14 + 8 * i, keys[i][1]);
  }
  return bytes;
}

TEST(Las, ZoneFromGeoKeys) {
  LasBytes las = sample();
  las.records = {{"other", 7, "x"},
                 {"LASF_Projection", 34735, geo_keys({{1024, 1}, {3072, 32756}, {3076, 9001}})}};
  EXPECT_EQ(read(las.bytes()).summary.utm, (UtmZone{56, false}));
  las.records[1].content = geo_keys({{1024, 1}, {3072, 31467}, {4096, 5703}});
  EXPECT_EQ(read(las.bytes()).summary.utm, std::nullopt);
  EXPECT_EQ(read(las.bytes()).summary.coordinates, "EPSG:31467");
  EXPECT_EQ(read(las.bytes()).summary.heights, "EPSG:5703");
}

TEST(Las, FeetAndDegreesAreRefusedWithTheRemedy) {
  LasBytes las = sample();
  las.records = {{"LASF_Projection", 34735, geo_keys({{1024, 1}, {3072, 2229}, {3076, 9003}})}};
  EXPECT_THAT([&] { read(las.bytes()); }, ThrowsSaying<InputError>({"0.3048", "metres", "pdal"}));
  las.records = {{"LASF_Projection", 34735,
                  geo_keys({{1024, 1}, {3072, 32632}, {3076, 9001}, {4096, 5703}, {4099, 9002}})}};
  EXPECT_THAT([&] { read(las.bytes()); }, ThrowsSaying<InputError>({"0.3048", "metres"}));
  las.records = {{"LASF_Projection", 34735, geo_keys({{1024, 2}, {2048, 4326}})}};
  EXPECT_THAT([&] { read(las.bytes()); }, ThrowsSaying<InputError>({"longitude and latitude"}));
}

TEST(Las, CompressedFilesAreRefusedWithTheRemedy) {
  LasBytes las = sample();
  std::string laz = las.bytes();
  laz[104] = static_cast<char>(0x80);
  EXPECT_THAT([&] { read(laz); }, ThrowsSaying<InputError>({"LAZ", "pdal translate"}));
  las.records = {{"laszip encoded", 22204, "1234"}};
  EXPECT_THAT([&] { read(las.bytes()); }, ThrowsSaying<InputError>({"LAZ"}));
  las.records = {{"copc", 1, std::string(160, '\0')}};
  EXPECT_THAT([&] { read(las.bytes()); }, ThrowsSaying<InputError>({"COPC"}));
  const test::TemporaryFolder folder;
  EXPECT_THAT([&] { read_cloud_file(folder.write("a.laz", "LASF"), {}); },
              ThrowsSaying<InputError>({"a.laz", "LAZ", "laszip"}));
}

TEST(Las, BrokenHeadersNameWhatIsWrong) {
  const auto broken = [](auto number, std::size_t place, const std::string& text) {
    std::string bytes = sample(4, 6).bytes();
    LasBytes::put(bytes, place, number);
    EXPECT_THAT([&] { read(bytes); }, ThrowsSaying<InputError>({"town.las", text})) << place;
  };
  broken(char{'X'}, 0, "begins with LASF");
  broken(std::uint8_t{2}, 24, "LAS 2.4");
  broken(std::uint8_t{5}, 25, "LAS 1.5");
  broken(std::uint16_t{300}, 94, "header of 300");
  broken(std::uint16_t{65535}, 94, "header of 65535");
  broken(std::uint32_t{100}, 96, "points from byte 100");
  broken(std::uint32_t{4'000'000'000U}, 96, "points from byte 4000000000");
  broken(std::uint32_t{4'000'000'000U}, 100, "a record");
  broken(std::uint8_t{11}, 104, "point format 11");
  broken(std::uint16_t{29}, 105, "points of 29 bytes");
  broken(std::uint64_t{3}, 247, "3 points of 30 bytes");
  broken(~std::uint64_t{0}, 247, "points of 30 bytes");
  broken(0.0, 131, "scale");
  broken(std::nan(""), 139, "scale");
  broken(std::numeric_limits<double>::infinity(), 155, "offset");
  broken(std::uint32_t{1}, 243, "a record");
}

TEST(Las, HeaderAloneIsCheckedBeforeTheRestIsThere) {
  const std::string whole = sample(4, 6).bytes();
  const auto check = [](const std::string& head) {
    check_cloud_header(std::as_bytes(std::span(head)), "las", "upload");
  };
  EXPECT_NO_THROW(check(whole.substr(0, 375)));
  for (std::size_t size = 0; size < 375; ++size)
    EXPECT_THAT([&] { check(whole.substr(0, size)); }, ThrowsSaying<InputError>({"upload"}));
  std::string laz = whole;
  laz[104] = static_cast<char>(0x86);
  EXPECT_THAT([&] { check(laz); }, ThrowsSaying<InputError>({"LAZ"}));
}

TEST(Las, CutOffAnywhereIsAClearError) {
  LasBytes las = sample(4, 6);
  las.encoding = 16;
  las.records = {{"LASF_Projection", 2112, utm_wkt({32, true}) + '\0'}};
  las.long_records = {{"LASF_Projection", 2112, utm_wkt({32, true}) + '\0'}};
  const std::string whole = las.bytes();
  ASSERT_EQ(read(whole).points.size(), 2U);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_THAT([&] { read(whole.substr(0, size)); }, ThrowsSaying<InputError>({"town.las"}))
        << size;
}

TEST(Las, WhatTheExportWritesComesBackToTheMillimetre) {
  const test::TemporaryFolder folder;
  test::SmallMap town;
  town.origin = {100.5, 200.25, 30.0};
  for (int i = 0; i < 500; ++i)
    town.points.push_back({{static_cast<float>(i) * 0.137F, std::sin(static_cast<float>(i)) * 30.0F,
                            0.01F * static_cast<float>(i)},
                           static_cast<float>(i) / 1000.0F,
                           static_cast<PointKind>(i % 4)});
  for (const bool placed : {false, true}) {
    town.place = placed ? std::optional<GeodeticOrigin>({49.0, 8.4, 116.5}) : std::nullopt;
    const auto package = test::published(town, folder.path() / (placed ? "placed" : "local"));
    const auto file = folder.path() / (placed ? "placed.las" : "local.las");
    export_map(*package, "las", file, {});
    std::vector<CloudPoint> points;
    const CloudSummary summary = read_cloud_file(file, [&](std::span<const CloudPoint> some) {
      points.insert(points.end(), some.begin(), some.end());
    });
    EXPECT_EQ(summary.utm.has_value(), placed);
    EXPECT_EQ(summary.coordinates, placed ? "WGS 84 / UTM zone 32N" : "town");
    const UtmProjection utm({49.0, 8.4, 116.5}, {32, true});
    std::size_t i = 0;
    for (const TileEntry& entry : package->tiles()) {
      const MapTile tile = package->tile(entry.id);
      for (const MapPoint& point : tile) {
        const Eigen::Vector3d p_map = tile.position(point);
        const Eigen::Vector3d back =
            placed ? utm.to_map(points.at(i).position) : points.at(i).position;
        EXPECT_LT((back - p_map).cwiseAbs().maxCoeff(), 0.00051);
        EXPECT_NEAR(points[i].intensity, point.intensity * 65535.0F, 0.51);
        ++i;
      }
    }
    EXPECT_EQ(i, points.size());
  }
}

TEST(Las, WrittenHeaderSaysWhatTheSpecificationAsks) {
  const test::TemporaryFolder folder;
  test::SmallMap town;
  town.points = {{{1.0F, 2.0F, 3.0F}, 0.5F, PointKind::kMeasured},
                 {{-4.0F, 2.5F, 3.0F}, 1.0F, PointKind::kGround},
                 {{-4.0F, 2.5F, 9.0F}, 0.0F, PointKind::kFilled}};
  const auto package = test::published(town, folder.path() / "map");
  export_map(*package, "las", folder.path() / "a.las", {});
  std::ifstream stream(folder.path() / "a.las", std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  const auto at = [&]<typename Number>(std::size_t place, Number) {
    Number number;
    std::memcpy(&number, &bytes.at(place), sizeof number);
    return number;
  };
  EXPECT_EQ(bytes.substr(0, 4), "LASF");
  EXPECT_EQ(at(6, std::uint16_t{}), 16) << "WKT";
  EXPECT_EQ(bytes[25], 4);
  EXPECT_EQ(at(94, std::uint16_t{}), 375);
  EXPECT_EQ(bytes[104], 6);
  EXPECT_EQ(at(105, std::uint16_t{}), 30);
  EXPECT_EQ(at(107, std::uint32_t{}), 0U) << "the old count";
  EXPECT_EQ(at(247, std::uint64_t{}), 3U);
  EXPECT_EQ(at(255, std::uint64_t{}), 3U) << "first returns";
  EXPECT_EQ(at(131, double{}), 0.001);
  // max x, min x, max y, min y, max z, min z
  EXPECT_NEAR(at(179, double{}), 1.0, 1e-9);
  EXPECT_NEAR(at(187, double{}), -4.0, 1e-9);
  EXPECT_NEAR(at(219, double{}), 3.0, 1e-9);
  const std::size_t first = at(96, std::uint32_t{});
  EXPECT_EQ(bytes.size(), first + 3 * 30);
  EXPECT_THAT(bytes.substr(375, first - 375), HasSubstr("LOCAL_CS[\"town\""));
  std::map<int, int> synthetic_by_class;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t point = first + 30 * i;
    EXPECT_EQ(bytes[point + 14], 0x11) << "return 1 of 1";
    synthetic_by_class[bytes[point + 16]] += bytes[point + 15];
  }
  EXPECT_EQ(synthetic_by_class, (std::map<int, int>{{1, 0}, {2, 1}}));
}

TEST(CoordinateSystem, WktAsOthersWriteIt) {
  // WKT 2, as PROJ writes it.
  const CoordinateSystem two = read_wkt(
      R"(COMPOUNDCRS["x",PROJCRS["ETRS89 / UTM zone 32N",BASEGEOGCRS["ETRS89",DATUM["d",)"
      R"(ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1]]],ID["EPSG",4258]],)"
      R"(CONVERSION["UTM zone 32N",METHOD["Transverse Mercator",ID["EPSG",9807]],)"
      R"(PARAMETER["False easting",500000,LENGTHUNIT["metre",1]]],CS[Cartesian,2],)"
      R"(AXIS["E",east,ORDER[1],LENGTHUNIT["metre",1]],ID["EPSG",25832]],)"
      R"(VERTCRS["DHHN2016 height",VDATUM["v"],CS[vertical,1],AXIS["h",up,LENGTHUNIT["metre",1]]]])");
  EXPECT_EQ(two.utm, (UtmZone{32, true}));
  EXPECT_EQ(two.name, "ETRS89 / UTM zone 32N");
  EXPECT_EQ(two.vertical_name, "DHHN2016 height");
  EXPECT_EQ(two.metres_per_unit, 1.0);
  EXPECT_FALSE(two.is_geographic);
  // ESRI's, without a code.
  const CoordinateSystem esri = read_wkt(
      R"(PROJCS["WGS_1984_UTM_Zone_11S",GEOGCS["GCS_WGS_1984",UNIT["Degree",0.0174532925]],)"
      R"(PROJECTION["Transverse_Mercator"],UNIT["Meter",1.0]])");
  EXPECT_EQ(esri.utm, (UtmZone{11, false}));
  const CoordinateSystem feet =
      read_wkt(R"(PROJCS["NAD83 / California 5 ftUS",UNIT["US survey foot",0.3048006096]])");
  EXPECT_EQ(feet.utm, std::nullopt);
  EXPECT_EQ(feet.metres_per_unit, 0.3048006096);
  EXPECT_TRUE(read_wkt(R"(GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]])").is_geographic);
  // The zone before the easting: called UTM, and is not (EPSG:4647), with a code or without.
  const std::string prefixed = R"_(PROJCS["ETRS89 / UTM zone 32N (zE-N)",)_";
  for (const std::string facts :
       {R"(AUTHORITY["EPSG","4647"]])", R"(PARAMETER["false_easting",32500000]])"})
    EXPECT_EQ(read_wkt(prefixed + facts).utm, std::nullopt) << facts;
  EXPECT_EQ(read_wkt(prefixed + R"(PARAMETER["false_easting",500000]])").utm, (UtmZone{32, true}));
  // A code that is not known here, of an ordinary zone (USGS).
  EXPECT_EQ(read_wkt(R"_(PROJCS["NAD83(2011) / UTM zone 17N",PARAMETER["false_easting",500000],)_"
                     R"_(UNIT["metre",1],AUTHORITY["EPSG","6346"]])_")
                .utm,
            (UtmZone{17, true}));
  // A base that is UTM's does not make it UTM.
  EXPECT_EQ(read_wkt(R"(PROJCS["x",GEOGCS["y",AUTHORITY["EPSG","32632"]]])").utm, std::nullopt);
}

TEST(CoordinateSystem, AnyBytesAreSurvived) {
  for (const std::string text :
       {"", "[", "]", "\"", "PROJCS[", "PROJCS]", ",,,", "UNIT[\"m\",x]]]]", "PROJCS[\"a"}) {
    EXPECT_EQ(read_wkt(text).utm, std::nullopt);
  }
  EXPECT_EQ(read_wkt(std::string(100'000, '[')).utm, std::nullopt);
  EXPECT_EQ(read_geo_keys({}).utm, std::nullopt);
  const std::string lying = geo_keys({{3072, 32632}});
  std::string longer = lying;
  LasBytes::put<std::uint16_t>(longer, 6, 65535);
  EXPECT_EQ(read_geo_keys(std::as_bytes(std::span(longer))).utm, (UtmZone{32, true}));
}

}  // namespace las_test
}  // namespace stillmap::maps
