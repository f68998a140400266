/// Points where nothing can be: mirror images below the ground, rain, what travels with the sensor.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <vector>

#include "cleaning/buried_points.hpp"
#include "cleaning/unconfirmed_points.hpp"
#include "support/point_clouds.hpp"
#include "support/synthetic_world.hpp"
#include "views/own_vehicle.hpp"
#include "views/weather_returns.hpp"

namespace stillmap::mapping {
namespace impossible_points_test {

using test::pose_at;
using test::ScanPattern;
using test::SyntheticWorld;

constexpr double kSensorM = 1.7;

/// A sensor 1.7 m over ground of 30 x 20 m that was measured every 0.1 m, and points to ask about.
struct Street {
  std::function<double(double x, double y)> height = [](double, double) { return 0.0; };
  std::function<bool(double x, double y)> measured = [](double, double) { return true; };
  /// Other measured ground, local frame.
  std::vector<Eigen::Vector3f> above;

  [[nodiscard]] std::vector<Eigen::Vector3f> ground() const {
    std::vector<Eigen::Vector3f> points;
    for (int ix = -150; ix < 150; ++ix) {
      for (int iy = -100; iy < 100; ++iy) {
        const double x = 0.1 * ix + 0.03, y = 0.1 * iy + 0.04;
        if (measured(x, y)) points.push_back(Eigen::Vector3d(x, y, height(x, y)).cast<float>());
      }
    }
    return points;
  }
  /// @param asked     local frame. @param off_m  by which the scan's pose is too high.
  /// @return flags of `asked`; no point of the ground may be flagged.
  [[nodiscard]] std::vector<std::uint8_t> buried(const std::vector<Eigen::Vector3f>& asked,
                                                 double off_m = 0.0) const {
    Eigen::Isometry3d T_local_lidar = pose_at(0.0, 0.0);
    T_local_lidar.translation().z() = kSensorM;
    std::vector<Eigen::Vector3f> positions = ground();
    const std::size_t count = positions.size();
    std::vector<Eigen::Vector3f> seen = positions;
    seen.insert(seen.end(), above.begin(), above.end());
    const Eigen::Isometry3f T_lidar_local = T_local_lidar.inverse().cast<float>();
    for (auto* points : {&positions, &seen}) {
      for (Eigen::Vector3f& p : *points) p = T_lidar_local * p;
    }
    FusedGround fused;
    const GroundCells cells = reduce_ground(
        test::cloud_of(seen), std::vector<std::uint8_t>(seen.size(), 1), {}, T_local_lidar);
    for (int scan = 0; scan < 5; ++scan) fused.add(cells);
    fused.finish({});
    for (const Eigen::Vector3f& p : asked) positions.push_back(T_lidar_local * p);
    std::vector<bool> is_ground(positions.size());
    std::fill_n(is_ground.begin(), count, true);
    T_local_lidar.translation().z() += off_m;
    const auto flags = find_buried_points(positions, is_ground, T_local_lidar, fused);
    EXPECT_EQ(std::count(flags.begin(), flags.begin() + static_cast<std::ptrdiff_t>(count), 1), 0);
    return {flags.begin() + static_cast<std::ptrdiff_t>(count), flags.end()};
  }
};

const std::vector<Eigen::Vector3f> kMirrored = {
    {6.0F, 0.0F, -0.5F}, {8.0F, 1.0F, -1.0F}, {12.0F, -3.0F, -2.5F}, {25.0F, 4.0F, -4.0F}};

TEST(BuriedPoints, AreMirrorImagesBelowTheRoad) {
  EXPECT_THAT(Street().buried(kMirrored), testing::Each(1));
  Street hill;
  hill.height = [](double x, double) { return 0.1 * x; };
  EXPECT_THAT(hill.buried({{6.0F, 0.0F, 0.1F}, {8.0F, 1.0F, -0.2F}}), testing::Each(1));
  EXPECT_THAT(hill.buried({{6.0F, 0.0F, 0.65F}, {-8.0F, 1.0F, -0.75F}}), testing::Each(0));
}

TEST(BuriedPoints, AreTheSameWhereAPassLiesHigherOrLower) {
  for (const double off_m : {-0.6, 0.6}) {
    EXPECT_THAT(Street().buried(kMirrored, off_m), testing::Each(1)) << off_m;
    EXPECT_THAT(Street().buried({{8.0F, 0.0F, 0.05F}, {8.0F, 3.0F, 1.0F}}, off_m), testing::Each(0))
        << off_m;
  }
}

TEST(BuriedPoints, AreNotInADitchOrACellarsRamp) {
  Street street;
  street.measured = [](double x, double) { return x < 3.0 || x > 6.0; };
  // On the bottom and on the far side; the ray passes over the near edge.
  EXPECT_THAT(street.buried({{5.0F, 0.0F, -1.0F}, {6.0F, 0.5F, -1.5F}}), testing::Each(0));
}

TEST(BuriedPoints, AreNotOnTheFaceOfAWallWithGroundOnTop) {
  Street street;
  street.height = [](double x, double) { return x > 6.0 ? 0.8 : 0.0; };
  std::vector<Eigen::Vector3f> face;
  for (float z = 0.05F; z < 0.8F; z += 0.1F) face.emplace_back(6.02F, 0.0F, z);
  EXPECT_THAT(street.buried(face), testing::Each(0));
}

TEST(BuriedPoints, AreNotUnderABridge) {
  Street street;
  for (float x = 4.0F; x < 12.0F; x += 0.1F) {
    for (float y = -9.0F; y < 9.0F; y += 0.1F) street.above.emplace_back(x, y, 5.0F);
  }
  EXPECT_THAT(street.buried({{8.0F, 0.0F, 0.5F}, {9.0F, 2.0F, 3.0F}}), testing::Each(0));
}

TEST(BuriedPoints, NeedGroundThatTellsHowHighTheScanLies) {
  Street street;
  street.measured = [](double x, double y) { return std::abs(x) < 0.5 && std::abs(y) < 0.5; };
  EXPECT_THAT(street.buried(kMirrored), testing::Each(0));
}

ScanPattern dense() {
  return {.rings = 48,
          .columns = 1600,
          .lowest_rad = -0.42,
          .highest_rad = 0.05,
          .max_range_m = 60.0,
          .noise_m = 0.01};
}

SyntheticWorld walls() {
  SyntheticWorld world;
  world.boxes = {{{-300.0, 9.0, 0.0}, {300.0, 9.5, 6.0}},
                 {{-300.0, -9.5, 0.0}, {300.0, -9.0, 6.0}}};
  for (double x = -90.0; x < 90.0; x += 9.0) world.cylinders.push_back({{x, 6.0}, 0.05, 4.0});
  return world;
}

Eigen::Isometry3d standing_at(double x) {
  Eigen::Isometry3d T = pose_at(x, 0.0);
  T.translation().z() = kSensorM;
  return T;
}

/// Moves every `step`th point to a drop somewhere on its ray.
std::vector<bool> add_drops(std::vector<Eigen::Vector3f>& positions, std::size_t step) {
  test::Random random(5);
  std::vector<bool> drops(positions.size());
  for (std::size_t i = 0; i < positions.size(); i += step) {
    const auto range = static_cast<float>(random.uniform(3.0, 15.0));
    if (range > positions[i].norm() - 1.0F) continue;
    positions[i] *= range / positions[i].norm();
    drops[i] = true;
  }
  return drops;
}

TEST(WeatherReturns, AreNoneInClearWeather) {
  EXPECT_TRUE(find_weather_returns(walls().scan(standing_at(0.0), dense()).positions).empty());
  EXPECT_TRUE(find_weather_returns({}).empty());
  auto positions = walls().scan(standing_at(0.0), dense()).positions;
  add_drops(positions, 400);
  EXPECT_TRUE(find_weather_returns(positions).empty()) << "a few drops are no rain";
}

TEST(WeatherReturns, AreDropsAndNotWallsAndPoles) {
  auto positions = walls().scan(standing_at(0.0), dense()).positions;
  const std::vector<bool> drops = add_drops(positions, 25);
  const std::vector<bool> flags = find_weather_returns(positions);
  ASSERT_EQ(flags.size(), positions.size());
  std::size_t all = 0, found = 0, wrong = 0;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    all += drops[i] ? 1 : 0;
    found += drops[i] && flags[i] ? 1 : 0;
    wrong += !drops[i] && flags[i] ? 1 : 0;
  }
  EXPECT_GT(all, 800U);
  EXPECT_GT(found, all * 8 / 10);
  EXPECT_LT(wrong, positions.size() / 500);
}

/// Views of the walls from every metre.
struct Views {
  std::vector<RangeView> kept;
  PosedViews posed;

  explicit Views(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto T = standing_at(static_cast<double>(i));
      posed.T_local_lidar.push_back(T);
      kept.emplace_back(walls().scan(T, dense()).positions, std::vector<std::uint8_t>{});
    }
    posed.read = [this](std::size_t i) { return std::make_shared<const RangeView>(kept[i]); };
  }
};

TEST(UnconfirmedPoints, AreDoubtfulOnesThatNoNeighbourHit) {
  const Views views(5);
  // In the lidar frame of scan 2: on a wall, in the air, and in the air without doubt.
  const std::vector<Eigen::Vector3f> points = {
      {1.0F, 9.0F, 0.5F}, {4.0F, 4.0F, -0.5F}, {4.0F, 4.0F, -0.5F}};
  EXPECT_THAT(find_unconfirmed_points(points, {true, true, false}, 2, views.posed),
              testing::ElementsAre(0, 1, 0));
  EXPECT_TRUE(find_unconfirmed_points(points, {}, 2, views.posed).empty());
}

/// A vehicle with a trailer, if it has one, between walls and guard rails.
struct Tow {
  bool has_trailer = true;
  static constexpr double kFrontM = -3.5, kBackM = -6.0;

  [[nodiscard]] std::vector<Eigen::Vector3f> scan(double x) const {
    SyntheticWorld world = walls();
    for (const double y : {-3.0, 3.0})
      world.boxes.push_back({{-300.0, y - 0.05, 0.5}, {300.0, y + 0.05, 0.8}});
    if (has_trailer) world.boxes.push_back({{x + kBackM, -1.0, 0.3}, {x + kFrontM, 1.0, 2.3}});
    return world.scan(standing_at(x), dense()).positions;
  }
  [[nodiscard]] OwnVehicle found(double metres) const {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 0.0; x <= metres; x += 1.0) poses.push_back(standing_at(x));
    std::vector<OwnVehicle::Sample> samples;
    const auto is_ground = [](const Eigen::Vector3f& p) { return p.z() < -1.64F; };
    for (const auto& [scan, before] : OwnVehicle::choose_samples(poses)) {
      std::vector<Eigen::Vector3f> standing = this->scan(static_cast<double>(scan));
      std::erase_if(standing, is_ground);
      const std::vector<Eigen::Vector3f> earlier = this->scan(static_cast<double>(before));
      std::vector<std::uint8_t> ground;
      for (const Eigen::Vector3f& p : earlier) ground.push_back(is_ground(p) ? 1 : 0);
      samples.push_back(
          {standing, RangeView(earlier, ground), poses[before].inverse() * poses[scan]});
    }
    return OwnVehicle(samples);
  }
};

TEST(OwnVehicle, IsTheTrailerAndNoGuardRail) {
  const OwnVehicle vehicle = Tow().found(60.0);
  std::size_t trailer = 0, held = 0;
  for (const Eigen::Vector3f& p : Tow().scan(30.0)) {
    const bool on_trailer =
        p.x() < -3.4F && p.x() > -6.1F && std::abs(p.y()) < 1.05F && p.z() > -1.45F;
    trailer += on_trailer ? 1 : 0;
    held += on_trailer && vehicle.holds(p) ? 1 : 0;
    EXPECT_FALSE(!on_trailer && vehicle.holds(p)) << p.transpose();
  }
  EXPECT_GT(trailer, 500U);
  EXPECT_GT(held, trailer * 9 / 10) << trailer;
  EXPECT_TRUE(Tow{.has_trailer = false}.found(60.0).empty());
  EXPECT_TRUE(OwnVehicle().empty());
}

TEST(OwnVehicle, IsNotKnownWhereTheSensorStands) {
  const std::vector<Eigen::Isometry3d> standing(500, standing_at(0.0));
  EXPECT_TRUE(OwnVehicle::choose_samples(standing).empty());
  EXPECT_TRUE(OwnVehicle::choose_samples({}).empty());
}

}  // namespace impossible_points_test
}  // namespace stillmap::mapping
