#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include "formats/nmea.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace nmea_test {

using ::testing::SizeIs;

// Examples that NMEA's readers publish, with their checksums.
const std::string kGga = "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n";
const std::string kRmc = "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n";
/// 23 March 1994, 12:35:19 UTC: 8,847 days and 45,319 s.
constexpr std::int64_t kStamp = 764'426'119'000'000'000;

class Nmea : public ::testing::Test {
 protected:
  struct Log : NmeaTrack {
    std::vector<NmeaFix> fixes;
  };
  [[nodiscard]] Log read(const std::string& text, std::int64_t near_ns = 0) const {
    Log log;
    static_cast<NmeaTrack&>(log) = read_nmea(folder_.write("track.nmea", text), near_ns,
                                             [&](const NmeaFix& fix) { log.fixes.push_back(fix); });
    return log;
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(Nmea, PositionsHaveDateAndHeightAboveTheEllipsoid) {
  for (const std::string& text : {kGga + kRmc, kRmc + kGga, "764426119.25 " + kGga + kRmc}) {
    const Log track = read(text);
    ASSERT_THAT(track.fixes, SizeIs(1));
    EXPECT_EQ(track.fixes[0].stamp_ns, kStamp);
    ASSERT_TRUE(track.fixes[0].place);
    EXPECT_NEAR(track.fixes[0].place->latitude_deg, 48.0 + 7.038 / 60.0, 1e-9);
    EXPECT_NEAR(track.fixes[0].place->longitude_deg, 11.0 + 31.0 / 60.0, 1e-9);
    EXPECT_NEAR(track.fixes[0].place->altitude_m, 592.3, 1e-9);
    EXPECT_TRUE(track.has_date);
    EXPECT_EQ(track.broken, 0U);
    EXPECT_EQ(track.above_sea, 0U);
  }
}

TEST_F(Nmea, WithoutADateTheNearestDayCounts) {
  for (const std::int64_t hours : {-11, 0, 11}) {
    const Log track = read(kGga, kStamp + hours * 3'600'000'000'000);
    EXPECT_EQ(track.fixes.at(0).stamp_ns, kStamp) << hours;
    EXPECT_FALSE(track.has_date);
  }
}

TEST_F(Nmea, GoesOverMidnight) {
  const Log track = read(
      "$GNGGA,235959.50,4807.038,S,01131.000,W,4,08,0.9,5,M,,M,,\n"
      "$GNZDA,235959.50,23,03,1994,00,00\n"
      "$GNGGA,000000.25,4807.038,S,01131.000,W,4,08,0.9,5,M,,M,,\n");
  ASSERT_THAT(track.fixes, SizeIs(2));
  EXPECT_EQ(track.fixes[1].stamp_ns - track.fixes[0].stamp_ns, 750'000'000);
  EXPECT_EQ(track.fixes[1].stamp_ns % 86'400'000'000'000, 250'000'000);
  EXPECT_LT(track.fixes[0].place.value().latitude_deg, 0.0);
  EXPECT_LT(track.fixes[0].place->longitude_deg, 0.0);
  EXPECT_EQ(track.above_sea, 2U);
}

TEST_F(Nmea, WhatCannotBeReadIsLeftOut) {
  std::string wrong = kGga;
  wrong[20] = '9';
  const Log track = read(wrong + kGga + "$GPGGA,,,,,,0,,,,M,,M,,*66\n" +
                         "$GPGGA,123520,,,,,0,00,,,M,,M,,\n$GPGSV,1,1,00\nnoise\n");
  EXPECT_THAT(track.fixes, SizeIs(2));
  EXPECT_FALSE(track.fixes[1].place) << "no fix";
  EXPECT_EQ(track.broken, 1U);
  EXPECT_THAT([&] { (void)read(kRmc); },
              test::ThrowsSaying<InputError>({"track.nmea", "no GGA", "another file"}));
}

TEST_F(Nmea, IsReadOrRefusedWhereverItIsCut) {
  const std::string without_checksum = kGga.substr(0, kGga.find('*')) + "\r\n";
  for (const std::string& gga : {kGga, without_checksum}) {
    const std::string text = gga + kRmc;
    for (std::size_t size = 0; size < text.size(); ++size) {
      try {
        const Log log = read(text.substr(0, size));
        ASSERT_THAT(log.fixes, SizeIs(1)) << size;
        EXPECT_EQ(log.NmeaTrack::fixes, 1U);
        ASSERT_TRUE(log.fixes[0].place) << size;
        EXPECT_NEAR(log.fixes[0].place->longitude_deg, 11.0 + 31.0 / 60.0, 1e-9) << size;
        EXPECT_NEAR(log.fixes[0].place->altitude_m, 592.3, 1e-9) << size;
      } catch (const InputError&) {
        EXPECT_LT(size, gga.size());
      }
    }
  }
}

TEST_F(Nmea, FixesBeforeTheFirstDateHaveIt) {
  const Log log = read(
      "$GNGGA,235959.50,4807.038,N,01131.000,E,4,08,0.9,5,M,,M,,\n"
      "$GNZDA,000000.00,24,03,1994,00,00\n"
      "$GNGGA,000000.50,4807.038,N,01131.000,E,4,08,0.9,5,M,,M,,\n");
  ASSERT_THAT(log.fixes, SizeIs(2));
  EXPECT_EQ(log.fixes[0].stamp_ns, 764'467'199'500'000'000);
  EXPECT_EQ(log.fixes[1].stamp_ns, 764'467'200'500'000'000);
}

}  // namespace nmea_test
}  // namespace stillmap::maps
