#include "scanner.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "random.hpp"

namespace stillmap::simulation {
namespace {

constexpr unsigned kInstanceShift = 16;

/// A ray's result before the gaps are closed.
struct Return {
  std::array<float, 4> point{};
  std::uint32_t label = 0;
  bool came_back = false;
};

/// Share of rays lost: little nearby, rising with range, sooner on what is dark or met at a low
/// angle. The scale is such that asphalt fades out at some 60 m and walls are seen to the end, as
/// in HDL-64 scans of streets.
double loss_at(const Hit& hit, const Sensor& sensor) {
  constexpr double kAlways = 0.01;
  const SurfaceProperties& surface = properties_of(hit.surface);
  const double brightness = surface.reflectivity * (0.2 + 0.8 * hit.cos_incidence);
  const double reach = hit.range_m / sensor.max_range_m;
  const double faded = std::min(1.0, 0.25 * reach * reach / std::max(brightness, 0.01));
  return 1.0 - (1.0 - kAlways) * (1.0 - surface.loss) * (1.0 - faded);
}

std::uint32_t label_of(const World& world, const Hit& hit) {
  if (!hit.actor) return properties_of(hit.surface).label;
  const auto instance = static_cast<std::uint32_t>(*hit.actor + 1);
  return world.actors[*hit.actor].label | (instance << kInstanceShift);
}

Return measure(const World& world, const Sensor& sensor, const Hit& hit,
               const Eigen::Vector3d& direction_lidar, Random random) {
  if (random.chance(loss_at(hit, sensor))) return {};
  const double range = hit.range_m + sensor.range_noise_m * random.normal();
  const Eigen::Vector3f p = (range * direction_lidar).cast<float>();
  const double brightness =
      properties_of(hit.surface).reflectivity * (0.35 + 0.65 * hit.cos_incidence);
  const double intensity = std::clamp(brightness * (1.0 + 0.1 * random.normal()), 0.0, 1.0);
  // KITTI stores hundredths.
  const double stored = std::round(100.0 * intensity) / 100.0;
  return {{p.x(), p.y(), p.z(), static_cast<float>(stored)}, label_of(world, hit), true};
}

Eigen::Vector3d ray_direction(const Sensor& sensor, std::size_t ring, std::size_t column) {
  const double azimuth =
      2.0 * std::numbers::pi * static_cast<double>(column) / static_cast<double>(sensor.columns);
  const double elevation = sensor.elevations_rad[ring];
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

/// The smallest upright box along the object's heading that holds every corner of its shape.
maps::Box box_of(const World& world, const Actor& actor, const Eigen::Isometry3d& T_lidar_actor) {
  const Eigen::Vector3d heading = T_lidar_actor.linear().col(0);
  const double yaw = std::atan2(heading.y(), heading.x());
  const Eigen::Matrix3d R_box_lidar =
      Eigen::AngleAxisd(-yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  Eigen::AlignedBox3d bounds;
  for (const Eigen::Vector3f& corner : world.shapes[actor.shape].vertices) {
    bounds.extend(Eigen::Vector3d(R_box_lidar * (T_lidar_actor * corner.cast<double>())));
  }
  maps::Box box;
  box.centre = R_box_lidar.transpose() * bounds.center();
  box.size_m = bounds.sizes();
  box.yaw_rad = yaw;
  box.object_class = actor.object_class;
  return box;
}

}  // namespace

SimulatedScan take_scan(const World& world, const RayScene& scene, const Sensor& sensor,
                        const Eigen::Isometry3d& T_world_lidar, std::uint64_t key) {
  const std::size_t rings = sensor.elevations_rad.size();
  std::vector<Return> returns(rings * sensor.columns);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rings), [&](const auto& range) {
    for (std::size_t ring = range.begin(); ring < range.end(); ++ring) {
      for (std::size_t column = 0; column < sensor.columns; ++column) {
        const std::size_t ray = ring * sensor.columns + column;
        const Eigen::Vector3d direction = ray_direction(sensor, ring, column);
        const std::optional<Hit> hit =
            scene.cast(T_world_lidar.translation(), T_world_lidar.linear() * direction,
                       sensor.min_range_m, sensor.max_range_m);
        if (hit) returns[ray] = measure(world, sensor, *hit, direction, Random(key_of({key, ray})));
      }
    }
  });
  SimulatedScan scan;
  for (const Return& r : returns) {
    if (!r.came_back) continue;
    scan.points.push_back(r.point);
    scan.labels.push_back(r.label);
  }
  return scan;
}

std::vector<maps::Box> boxes_of_scan(const World& world, const SimulatedScan& scan,
                                     const Eigen::Isometry3d& T_world_lidar, double time_s) {
  std::set<std::uint32_t> seen;
  for (const std::uint32_t label : scan.labels) {
    if (const std::uint32_t instance = label >> kInstanceShift; instance > 0) seen.insert(instance);
  }
  std::vector<maps::Box> boxes;
  for (const std::uint32_t instance : seen) {
    const Actor& actor = world.actors[instance - 1];
    maps::Box box =
        box_of(world, actor, T_world_lidar.inverse() * T_world_actor(world, actor, time_s));
    box.track = static_cast<int>(instance);
    boxes.push_back(box);
  }
  return boxes;
}

}  // namespace stillmap::simulation
