#include <stillmap/maps/error.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "sensing/sensor.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::simulation {
namespace sensor_test {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

double azimuth_deg(const Beam& beam) {
  return std::atan2(beam.direction.y(), beam.direction.x()) * kDegPerRad;
}

double elevation_deg(const Beam& beam) { return std::asin(beam.direction.z()) * kDegPerRad; }

double wrapped_deg(double angle) { return std::remainder(angle, 360.0); }

std::map<std::uint16_t, std::vector<Beam>> by_ring(const std::vector<Beam>& beams) {
  std::map<std::uint16_t, std::vector<Beam>> rings;
  for (const Beam& beam : beams) rings[beam.ring].push_back(beam);
  return rings;
}

std::string file_text(const std::string& extra = "", const std::string& direction = "clockwise") {
  return R"({"format": "stillmap-sensor", "version": 1, "name": "mine", "rate_hz": 20,
    "columns": 360, "min_range_m": 0.5, "max_range_m": 50, "range_noise_m": 0.01,
    "divergence_rad": 0.003, "height_m": 2,
    "beams": [{"elevation_deg": -10}, {"elevation_deg": 10, "azimuth_offset_deg": 5}])" +
         extra + R"(, "direction": ")" + direction + R"("})";
}

class SpinningSensors : public ::testing::TestWithParam<const char*> {};

struct Expected {
  std::size_t rings;
  std::size_t columns;
  double top_deg;
  double bottom_deg;
  /// Of the encoder; 0 where azimuths are not rounded.
  double encoder_deg = 0.0;
};

const std::map<std::string, Expected> kExpected{{"hdl64", {64, 2158, 2.0, -24.33, 0.09}},
                                                {"os1-64", {64, 1024, 16.6, -16.6}},
                                                {"os1-128", {128, 1024, 22.5, -22.5}},
                                                {"vlp16", {16, 1808, 15.0, -15.0}}};

TEST_P(SpinningSensors, HaveTheRaysOfTheirDataSheet) {
  const auto sensor = make_sensor(GetParam());
  const Expected& expected = kExpected.at(GetParam());
  const auto rings = by_ring(sensor->beams(0));
  EXPECT_EQ(sensor->properties().name, GetParam());
  EXPECT_EQ(sensor->properties().rings, expected.rings);
  ASSERT_EQ(rings.size(), expected.rings);
  double above_deg = 90.0;
  for (const auto& [ring, beams] : rings) {
    EXPECT_EQ(beams.size(), expected.columns);
    EXPECT_LT(elevation_deg(beams[0]), above_deg) << "ring " << ring;
    above_deg = elevation_deg(beams[0]);
  }
  EXPECT_NEAR(elevation_deg(rings.at(0)[0]), expected.top_deg, 0.06);
  EXPECT_NEAR(above_deg, expected.bottom_deg, 0.06);
}

TEST_P(SpinningSensors, LookAroundOnceInUnitVectors) {
  const auto sensor = make_sensor(GetParam());
  const double step_deg = 360.0 / static_cast<double>(kExpected.at(GetParam()).columns);
  const double rounding_deg = kExpected.at(GetParam()).encoder_deg + 0.01;
  for (const auto& [ring, beams] : by_ring(sensor->beams(0))) {
    for (std::size_t i = 0; i < beams.size(); ++i) {
      ASSERT_NEAR(beams[i].direction.norm(), 1.0F, 1e-6F);
      const double next_deg = azimuth_deg(beams[(i + 1) % beams.size()]);
      // Neighbours in the file are neighbours in direction, counter-clockwise.
      ASSERT_NEAR(wrapped_deg(next_deg - azimuth_deg(beams[i])), step_deg, rounding_deg) << i;
    }
    EXPECT_LT(std::fmod(azimuth_deg(beams[0]) + 720.0, 360.0), step_deg + rounding_deg) << ring;
  }
}

TEST_P(SpinningSensors, TurnClockwiseAndFaceForwardAtTheStamp) {
  const auto sensor = make_sensor(GetParam());
  const double half_s = 0.5 * sensor->properties().period_s;
  for (const auto& [ring, beams] : by_ring(sensor->beams(0))) {
    std::vector<Beam> in_time = beams;
    std::sort(in_time.begin(), in_time.end(),
              [](const Beam& a, const Beam& b) { return a.time_s < b.time_s; });
    // Lasers look to fixed sides of the heading, so take each ring's own side off.
    const double side_deg =
        wrapped_deg(azimuth_deg(in_time[0]) + 360.0 / (2.0 * half_s) * in_time[0].time_s);
    EXPECT_LT(std::abs(side_deg), 8.1);
    EXPECT_NEAR(in_time.front().time_s, -half_s, 1e-4);
    EXPECT_NEAR(in_time.back().time_s, half_s, 1e-4);
    for (const Beam& beam : in_time) {
      ASSERT_LE(std::abs(beam.time_s), half_s);
      const double heading_deg = wrapped_deg(azimuth_deg(beam) - side_deg);
      const double turned_deg = -360.0 * beam.time_s / (2.0 * half_s);
      // The side was read off a rounded azimuth too.
      ASSERT_NEAR(wrapped_deg(heading_deg - turned_deg), 0.0,
                  kExpected.at(GetParam()).encoder_deg + 0.01);
    }
  }
}

TEST_P(SpinningSensors, SweepTheSameEachTime) {
  const auto sensor = make_sensor(GetParam());
  const std::vector<Beam> first = sensor->beams(0);
  const std::vector<Beam> later = make_sensor(GetParam())->beams(7);
  ASSERT_EQ(first.size(), later.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    ASSERT_EQ(first[i].direction, later[i].direction);
    ASSERT_EQ(first[i].time_s, later[i].time_s);
  }
}

INSTANTIATE_TEST_SUITE_P(Simulation, SpinningSensors,
                         ::testing::Values("hdl64", "os1-64", "os1-128", "vlp16"),
                         [](const auto& sensor) {
                           std::string name = sensor.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST(Sensor, HdlLasersLookToDifferentSidesAtOneInstant) {
  const auto sensor = make_sensor("hdl64");
  double least_deg = 90.0;
  double most_deg = -90.0;
  for (const Beam& beam : sensor->beams(0)) {
    if (std::abs(beam.time_s) > 2.5e-5F) continue;
    least_deg = std::min(least_deg, azimuth_deg(beam));
    most_deg = std::max(most_deg, azimuth_deg(beam));
  }
  EXPECT_NEAR(least_deg, -8.0, 0.3);
  EXPECT_NEAR(most_deg, 8.0, 0.3);
}

TEST(Sensor, HdlAzimuthsAreWholeStepsOfItsEncoder) {
  const auto sensor = make_sensor("hdl64");
  const double first_deg = azimuth_deg(sensor->beams(0)[0]);
  for (std::size_t i = 0; i < 2158; ++i) {
    const double steps = (azimuth_deg(sensor->beams(0)[i]) - first_deg) / 0.09;
    ASSERT_NEAR(steps, std::round(steps), 2e-3) << i;
  }
}

TEST(Sensor, Vlp16FiresItsLasersOneAfterTheOther) {
  const auto sensor = make_sensor("vlp16");
  std::set<float> times;
  for (const Beam& beam : sensor->beams(0)) times.insert(beam.time_s);
  EXPECT_EQ(times.size(), 16U * 1808U);
  // Ring 0 looks up 15 degrees and is the last of the sequence, ring 15 the first.
  std::vector<float> first(16, 1.0F);
  for (const Beam& beam : sensor->beams(0))
    first[beam.ring] = std::min(first[beam.ring], beam.time_s);
  EXPECT_NEAR(first[0] - first[15], 15 * 2.304e-6, 1e-8);
  EXPECT_NEAR(first[7] - first[15], 2.304e-6, 1e-8);
}

/// Cells of 0.5 degrees that rays go through.
std::set<std::pair<int, int>> cells_of(Sensor& sensor, std::size_t scans) {
  std::set<std::pair<int, int>> cells;
  for (std::size_t scan = 0; scan < scans; ++scan) {
    for (const Beam& beam : sensor.beams(scan)) {
      cells.emplace(std::lround(2.0 * azimuth_deg(beam)), std::lround(2.0 * elevation_deg(beam)));
    }
  }
  return cells;
}

TEST(Sensor, AviaFillsItsViewOverScans) {
  const auto sensor = make_sensor("avia");
  const std::vector<Beam> first = sensor->beams(0);
  const std::vector<Beam> second = sensor->beams(1);
  ASSERT_EQ(first.size(), 24'000U);
  std::size_t equal = 0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    if ((first[i].direction - second[i].direction).norm() < 1e-3F) ++equal;
  }
  EXPECT_LT(equal, 500U);
  const std::size_t one = cells_of(*sensor, 1).size();
  const std::size_t ten = cells_of(*sensor, 10).size();
  EXPECT_GT(static_cast<double>(ten), 1.3 * static_cast<double>(one));
  // The ellipse of the view has 70.4 x 77.2 x pi / 4 square degrees, four cells each.
  EXPECT_GT(static_cast<double>(ten), 0.9 * 4.0 * 70.4 * 77.2 * std::numbers::pi / 4.0);
}

TEST(Sensor, AviaKeepsToItsViewInTheOrderOfTime) {
  const auto sensor = make_sensor("avia");
  double widest_deg = 0.0;
  double highest_deg = 0.0;
  float before_s = -1.0F;
  for (std::size_t scan = 0; scan < 10; ++scan) {
    for (const Beam& beam : sensor->beams(scan)) {
      ASSERT_NEAR(beam.direction.norm(), 1.0F, 1e-6F);
      ASSERT_LE(std::abs(beam.time_s), 0.05F);
      ASSERT_TRUE(beam.time_s > before_s || beam.time_s == -0.05F);
      before_s = beam.time_s;
      widest_deg = std::max(widest_deg, std::abs(azimuth_deg(beam)));
      highest_deg = std::max(highest_deg, std::abs(elevation_deg(beam)));
    }
  }
  EXPECT_NEAR(2.0 * widest_deg, 70.4, 0.2);
  EXPECT_NEAR(2.0 * highest_deg, 77.2, 0.3);
}

TEST(Sensor, ReadsADescription) {
  const test::TemporaryFolder folder;
  const auto sensor = make_sensor(folder.write("mine.json", file_text()).string());
  EXPECT_EQ(sensor->properties().name, "mine");
  EXPECT_DOUBLE_EQ(sensor->properties().period_s, 0.05);
  EXPECT_DOUBLE_EQ(sensor->properties().max_range_m, 50.0);
  EXPECT_DOUBLE_EQ(sensor->properties().half_range_m, 50.0);
  EXPECT_DOUBLE_EQ(sensor->properties().height_m, 2.0);
  EXPECT_EQ(sensor->properties().rings, 2U);
  ASSERT_EQ(sensor->beams(0).size(), 720U);
  EXPECT_NEAR(elevation_deg(sensor->beams(0)[0]), 10.0, 1e-4);
  for (const Beam& beam : sensor->beams(0)) {
    const double side_deg = beam.ring == 0 ? 5.0 : 0.0;
    ASSERT_NEAR(wrapped_deg(azimuth_deg(beam) - side_deg + 360.0 * 20.0 * beam.time_s), 0.0, 1e-2);
  }
}

TEST(Sensor, TurnsCounterClockwiseWhenTold) {
  const test::TemporaryFolder folder;
  const auto sensor =
      make_sensor(folder.write("mine.json", file_text("", "counter_clockwise")).string());
  for (const Beam& beam : sensor->beams(0)) {
    if (beam.ring == 0) continue;
    ASSERT_NEAR(wrapped_deg(azimuth_deg(beam) - 360.0 * 20.0 * beam.time_s), 0.0, 1e-2);
  }
}

TEST(Sensor, RefusesBrokenDescriptionsByKeyAndValue) {
  const test::TemporaryFolder folder;
  const auto replaced = [](std::string text, const std::string& from, const std::string& to) {
    return text.replace(text.find(from), from.size(), to);
  };
  const struct {
    std::string text;
    std::vector<std::string> says;
  } cases[] = {
      {file_text(R"(, "colour": "red")"), {"unknown key \"colour\"", "only format"}},
      {replaced(file_text(), R"("columns": 360,)", ""), {".columns", "nothing", "a value"}},
      {replaced(file_text(), "360", "\"many\""), {".columns", "many", "a whole number"}},
      {replaced(file_text(), "360", "360.5"), {".columns", "360.5", "whole"}},
      {replaced(file_text(), "360", "0"), {".columns", "found 0", "1 to 8192"}},
      {replaced(file_text(), "\"rate_hz\": 20", "\"rate_hz\": 1e9"), {".rate_hz", "50"}},
      {replaced(file_text(), "\"max_range_m\": 50", "\"max_range_m\": 1e999"), {"number"}},
      {replaced(file_text(), "\"min_range_m\": 0.5", "\"min_range_m\": 60"),
       {".max_range_m", "more than min_range_m"}},
      {replaced(file_text(), "\"elevation_deg\": 10", "\"elevation_deg\": 100"),
       {".beams[1].elevation_deg", "100", "-90.0 to 90.0"}},
      {replaced(file_text(), "azimuth_offset_deg", "azimuth"), {".beams[1]", "\"azimuth\""}},
      {file_text("", "widdershins"), {".direction", "widdershins", "counter_clockwise"}},
      {"[]", {"an array", "an object"}},
      {"{", {"JSON"}},
  };
  for (const auto& broken : cases) {
    const std::string file = folder.write("broken.json", broken.text).string();
    std::vector<std::string> says = broken.says;
    says.push_back(file);
    EXPECT_THAT([&] { (void)make_sensor(file); }, test::ThrowsSaying<maps::InputError>(says))
        << broken.text;
  }
  const std::string folder_name = folder.path().string();
  EXPECT_THAT([&] { (void)make_sensor(folder_name); },
              test::ThrowsSaying<maps::StorageError>({folder_name}));
}

TEST(Sensor, RefusesAnUnknownNameByNamingTheKnownOnes) {
  EXPECT_THAT([] { (void)make_sensor("hdl65"); },
              test::ThrowsSaying<std::invalid_argument>({"hdl65", sensor_names()}));
  EXPECT_EQ(sensor_names(), "hdl64 os1-64 os1-128 vlp16 avia");
}

}  // namespace sensor_test
}  // namespace stillmap::simulation
