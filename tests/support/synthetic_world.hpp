#pragma once

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

/// Worlds of boxes, upright cylinders and flat ground, scanned by exact ray casting: the truth is
/// the formula.
namespace stillmap::test {

/// Uniform numbers in [0, 1) from a seed; the same on every machine (SplitMix64).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double uniform() {
    state_ += 0x9E3779B97F4A7C15ULL;
    std::uint64_t x = state_;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1p-53;
  }
  double uniform(double from, double to) { return from + (to - from) * uniform(); }
  /// Mean 0, deviation 1; a sum of 12 uniforms, so never beyond 6.
  double normal() {
    double sum = -6.0;
    for (int k = 0; k < 12; ++k) sum += uniform();
    return sum;
  }

 private:
  std::uint64_t state_;
};

/// How a spinning sensor looks around.
struct ScanPattern {
  int rings = 32;
  int columns = 720;
  double lowest_rad = -0.43;
  double highest_rad = 0.10;
  double max_range_m = 70.0;
  /// Deviation of the range [m].
  double noise_m = 0.0;
  std::uint64_t seed = 1;
};

class SyntheticWorld {
 public:
  struct Box {
    Eigen::Vector3d min, max;
  };
  struct Cylinder {
    Eigen::Vector2d centre;
    double radius_m, top_m;
  };

  std::vector<Box> boxes;
  std::vector<Cylinder> cylinders;
  bool has_ground = true;

  /// Distance along a ray [m] (unit direction) to the first surface, infinite when there is none.
  [[nodiscard]] double cast(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) const {
    double nearest = std::numeric_limits<double>::infinity();
    if (has_ground && direction.z() < 0.0) nearest = -from.z() / direction.z();
    for (const Box& box : boxes) nearest = std::min(nearest, to_box(box, from, direction));
    for (const Cylinder& cylinder : cylinders) {
      nearest = std::min(nearest, to_cylinder(cylinder, from, direction));
    }
    return nearest;
  }

  /// One sweep at one instant, in the lidar frame.
  [[nodiscard]] maps::PointCloud scan(const Eigen::Isometry3d& T_world_lidar,
                                      const ScanPattern& pattern) const {
    Random random(pattern.seed);
    maps::PointCloud cloud;
    for (int ring = 0; ring < pattern.rings; ++ring) {
      const double share = ring / std::max(1.0, pattern.rings - 1.0);
      const double elevation =
          pattern.lowest_rad + share * (pattern.highest_rad - pattern.lowest_rad);
      for (int column = 0; column < pattern.columns; ++column) {
        const double azimuth = 2.0 * std::numbers::pi * column / pattern.columns;
        const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                        std::cos(elevation) * std::sin(azimuth),
                                        std::sin(elevation));
        const double range = cast(T_world_lidar.translation(), T_world_lidar.linear() * direction);
        const double noise = pattern.noise_m > 0.0 ? pattern.noise_m * random.normal() : 0.0;
        if (range < pattern.max_range_m) {
          cloud.positions.push_back(((range + noise) * direction).cast<float>());
        }
      }
    }
    return cloud;
  }

  /// One sweep of a sensor that moves on meanwhile, clockwise from behind, with the times of its
  /// points: p in the lidar frame of its own instant, T_world_lidar exp(twist t).
  /// @param T_world_lidar  at the stamp. @param twist  (tx ty tz rx ry rz) [m/s, rad/s].
  [[nodiscard]] maps::PointCloud sweep(const Eigen::Isometry3d& T_world_lidar,
                                       const Eigen::Matrix<double, 6, 1>& twist,
                                       const ScanPattern& pattern, double begin_s,
                                       double end_s) const {
    Random random(pattern.seed);
    maps::PointCloud cloud;
    for (int column = 0; column < pattern.columns; ++column) {
      const double share = static_cast<double>(column) / pattern.columns;
      const double t = begin_s + share * (end_s - begin_s);
      const Eigen::Isometry3d T = T_world_lidar * maps::exp_se3(twist * t);
      const double azimuth = std::numbers::pi * (1.0 - 2.0 * share);
      for (int ring = 0; ring < pattern.rings; ++ring) {
        const double elevation =
            pattern.lowest_rad +
            ring / std::max(1.0, pattern.rings - 1.0) * (pattern.highest_rad - pattern.lowest_rad);
        const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                        std::cos(elevation) * std::sin(azimuth),
                                        std::sin(elevation));
        const double range = cast(T.translation(), T.linear() * direction);
        if (!(range < pattern.max_range_m)) continue;
        cloud.positions.push_back(
            ((range + pattern.noise_m * random.normal()) * direction).cast<float>());
        cloud.time_offsets_s.push_back(static_cast<float>(t));
      }
    }
    return cloud;
  }

  /// Map points [m]: scans from these poses put together, one point in a cell of `cell_m`.
  [[nodiscard]] std::vector<Eigen::Vector3d> mapped_from(
      const std::vector<Eigen::Isometry3d>& T_world_lidar, ScanPattern pattern,
      double cell_m = 0.1) const {
    std::vector<std::pair<std::uint64_t, Eigen::Vector3d>> keyed;
    for (const Eigen::Isometry3d& T : T_world_lidar) {
      for (const Eigen::Vector3f& p : scan(T, pattern).positions) {
        const Eigen::Vector3d q = T * p.cast<double>();
        const Eigen::Vector3i cell = (q / cell_m).array().floor().cast<int>() + (1 << 20);
        keyed.emplace_back((static_cast<std::uint64_t>(cell.x()) << 42) |
                               (static_cast<std::uint64_t>(cell.y()) << 21) |
                               static_cast<std::uint64_t>(cell.z()),
                           q);
      }
      ++pattern.seed;
    }
    std::stable_sort(keyed.begin(), keyed.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<Eigen::Vector3d> points;
    for (std::size_t i = 0; i < keyed.size(); ++i) {
      if (i == 0 || keyed[i].first != keyed[i - 1].first) points.push_back(keyed[i].second);
    }
    return points;
  }

 private:
  static double to_box(const Box& box, const Eigen::Vector3d& from,
                       const Eigen::Vector3d& direction) {
    double enter = -std::numeric_limits<double>::infinity();
    double leave = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      const double a = (box.min[axis] - from[axis]) / direction[axis];
      const double b = (box.max[axis] - from[axis]) / direction[axis];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    return enter <= leave && enter > 0.0 ? enter : std::numeric_limits<double>::infinity();
  }

  static double to_cylinder(const Cylinder& cylinder, const Eigen::Vector3d& from,
                            const Eigen::Vector3d& direction) {
    const Eigen::Vector2d offset = from.head<2>() - cylinder.centre;
    const double a = direction.head<2>().squaredNorm();
    const double b = offset.dot(direction.head<2>());
    const double c = offset.squaredNorm() - cylinder.radius_m * cylinder.radius_m;
    const double root = b * b - a * c;
    if (!(root > 0.0)) return std::numeric_limits<double>::infinity();
    const double range = (-b - std::sqrt(root)) / a;
    const double height = from.z() + range * direction.z();
    return range > 0.0 && height < cylinder.top_m ? range : std::numeric_limits<double>::infinity();
  }
};

/// A pose at sensor height with a heading.
inline Eigen::Isometry3d pose_at(double x, double y, double yaw_rad = 0.0, double z = 1.8) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, z);
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

/// A street along x from 0 to `length_m`: houses of various depth with gaps, parked cars, poles and
/// trunks.
inline SyntheticWorld street(std::uint64_t seed, double length_m = 120.0) {
  Random random(seed);
  SyntheticWorld world;
  for (const double side : {-1.0, 1.0}) {
    const auto across = [&](double near, double far) {
      return side > 0.0 ? Eigen::Vector2d(near, far) : Eigen::Vector2d(-far, -near);
    };
    for (double x = -20.0; x < length_m + 20.0;) {
      const double width = random.uniform(6.0, 15.0);
      const double front = random.uniform(7.5, 11.0);
      const Eigen::Vector2d y = across(front, front + 10.0);
      world.boxes.push_back({{x, y[0], 0.0}, {x + width, y[1], random.uniform(4.0, 10.0)}});
      x += width + random.uniform(0.5, 6.0);
    }
    for (double x = random.uniform(0.0, 8.0); x < length_m; x += random.uniform(6.0, 22.0)) {
      const Eigen::Vector2d y = across(3.6, 5.4);
      world.boxes.push_back(
          {{x, y[0], 0.0}, {x + random.uniform(3.8, 5.0), y[1], random.uniform(1.4, 1.9)}});
    }
    for (double x = random.uniform(0.0, 10.0); x < length_m; x += random.uniform(12.0, 25.0)) {
      world.cylinders.push_back(
          {{x, side * random.uniform(6.0, 6.6)}, random.uniform(0.1, 0.3), 6.0});
    }
  }
  return world;
}

/// A hall of 30 x 20 m around the origin with some furniture.
inline SyntheticWorld room() {
  SyntheticWorld world;
  world.boxes = {{{-15.5, -10.5, 0}, {15.5, -10.0, 5}}, {{-15.5, 10.0, 0}, {15.5, 10.5, 5}},
                 {{-15.5, -10.5, 0}, {-15.0, 10.5, 5}}, {{15.0, -10.5, 0}, {15.5, 10.5, 5}},
                 {{4.0, 3.0, 0}, {7.0, 4.5, 2}},        {{-9.0, -6.0, 0}, {-8.0, -2.0, 2.5}},
                 {{-3.0, 7.0, 0}, {0.0, 8.0, 1.5}}};
  world.cylinders = {{{8.0, -6.0}, 0.3, 5.0}, {{-6.0, 5.0}, 0.3, 5.0}};
  return world;
}

/// Two smooth walls along x, longer than any sensor sees: nothing tells where along it one is.
inline SyntheticWorld corridor() {
  SyntheticWorld world;
  world.boxes = {{{-300.0, -4.5, 0}, {300.0, -4.0, 4}}, {{-300.0, 4.0, 0}, {300.0, 4.5, 4}}};
  return world;
}

/// Flat ground and nothing else.
inline SyntheticWorld field() { return {}; }

}  // namespace stillmap::test
