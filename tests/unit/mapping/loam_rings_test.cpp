#include "odometry/loam/rings.hpp"

#include "support/synthetic_world.hpp"

#include <stillmap/maps/error.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

namespace stillmap::mapping::loam {
namespace loam_rings_test {

/// A scan with the ring of every point.
struct Known {
  maps::Scan scan;
  std::vector<std::uint32_t> ring;
};

/// As a sensor in a street lists it, ring by ring from `start_rad` on; each laser has an azimuth of
/// its own, and rays into the sky do not come back.
Known known_rings(int rings, double start_rad, double direction, double own_azimuth_rad) {
  const test::SyntheticWorld world = test::street(3, 30.0);
  const Eigen::Isometry3d T = test::pose_at(15.0, 0.0);
  Known known;
  for (int r = 0; r < rings; ++r) {
    const double elevation = (2.0 - 26.0 * r / (rings - 1.0)) * std::numbers::pi / 180.0;
    for (int k = 0; k < 450; ++k) {
      const double azimuth = direction * (start_rad + own_azimuth_rad * ((r % 3) - 1) +
                                          2.0 * std::numbers::pi * k / 450);
      const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = world.cast(T.translation(), ray);
      if (!(range < 80.0)) continue;
      known.scan.cloud.positions.push_back((range * ray).cast<float>());
      known.ring.push_back(static_cast<std::uint32_t>(r));
    }
  }
  return known;
}

/// Points whose ring is another than that of most points of their found ring.
std::size_t strangers(const Known& known, const Rings& rings) {
  std::size_t wrong = 0;
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const auto points = rings.ring(r);
    const std::uint32_t middle = known.ring[points[points.size() / 2]];
    for (const std::uint32_t p : points) wrong += known.ring[p] != middle ? 1 : 0;
  }
  return wrong;
}

TEST(LoamRings, AreExactWhereTheyAreListedOneAfterAnother) {
  for (const double direction : {1.0, -1.0}) {
    for (const double start : {0.0, 2.0}) {
      const Known known = known_rings(64, start, direction, 0.0);
      const Rings rings = find_rings(known.scan);
      EXPECT_EQ(rings.size(), 64U) << direction << " " << start;
      EXPECT_EQ(strangers(known, rings), 0U) << direction << " " << start;
      EXPECT_EQ(rings.points.size(), known.ring.size());
    }
  }
}

TEST(LoamRings, AreExactWhereEachLaserHasAnAzimuthOfItsOwn) {
  const Known known = known_rings(64, 0.3, 1.0, 0.05);
  const Rings rings = find_rings(known.scan);
  EXPECT_EQ(rings.size(), 64U);
  EXPECT_EQ(strangers(known, rings), 0U);
}

TEST(LoamRings, ComeFromTheElevationWherePointsAreListedColumnByColumn) {
  Known known = known_rings(32, 0.0, 1.0, 0.0);
  std::vector<std::uint32_t> order(known.ring.size());
  std::iota(order.begin(), order.end(), 0U);
  const auto& all = known.scan.cloud.positions;
  const auto column = [&](std::uint32_t i) {
    return std::lround(std::atan2(all[i].y(), all[i].x()) * 225.0 / std::numbers::pi);
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return column(a) < column(b); });
  Known turned;
  for (const std::uint32_t i : order) {
    turned.scan.cloud.positions.push_back(all[i]);
    turned.ring.push_back(known.ring[i]);
  }
  const Rings rings = find_rings(turned.scan);
  EXPECT_EQ(rings.size(), 32U);
  EXPECT_EQ(strangers(turned, rings), 0U);
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const auto points = rings.ring(r);
    for (std::size_t k = 1; k < points.size(); ++k) {
      const auto& p = turned.scan.cloud.positions[points[k - 1]];
      const auto& q = turned.scan.cloud.positions[points[k]];
      EXPECT_LE(std::atan2(p.y(), p.x()), std::atan2(q.y(), q.x()));
    }
  }
}

TEST(LoamRings, AreNoneOfFewPoints) {
  maps::Scan scan;
  EXPECT_EQ(find_rings(scan).size(), 0U);
  scan.cloud.positions.assign(500, {5.0F, 1.0F, 0.0F});
  EXPECT_EQ(find_rings(scan).size(), 0U);
}

TEST(LoamRings, LeaveOutWhatIsNotFiniteOrTheVehiclesOwn) {
  Known known = known_rings(64, 0.0, 1.0, 0.0);
  known.scan.cloud.positions[100].x() = std::numeric_limits<float>::quiet_NaN();
  known.scan.cloud.positions[200] = {0.5F, 0.0F, 0.0F};
  const Rings rings = find_rings(known.scan);
  EXPECT_EQ(rings.points.size(), known.ring.size() - 2);
  EXPECT_EQ(strangers(known, rings), 0U);
}

TEST(LoamRings, OfASensorWithoutAnyAreRefusedByName) {
  maps::Scan scan;
  scan.source = "walk/000001.pcd";
  test::Random random(5);
  for (int i = 0; i < 5000; ++i) {
    const double a = random.uniform(-0.6, 0.6);
    const double e = random.uniform(-0.6, 0.6);
    scan.cloud.positions.push_back(
        (10.0 * Eigen::Vector3d(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)))
            .cast<float>());
  }
  try {
    static_cast<void>(find_rings(scan));
    FAIL() << "taken for a sensor with rings";
  } catch (const maps::InputError& error) {
    EXPECT_NE(std::string(error.what()).find("walk/000001.pcd"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("5000 points"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("spins"), std::string::npos);
  }
}

}  // namespace loam_rings_test
}  // namespace stillmap::mapping::loam
