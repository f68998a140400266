#include <stillmap/simulation/simulate.hpp>

#include <fmt/format.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <set>
#include <stdexcept>

#include "drive_writer.hpp"
#include "ego_motion.hpp"
#include "random.hpp"
#include "scanner.hpp"
#include "sensor.hpp"
#include "world.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kScanPeriod = 0.1;
constexpr std::size_t kMaxScans = 10'000;
constexpr int kMaxThreads = 1024;

void require_usable(const SimulationOptions& options) {
  const std::vector<std::string> violations = options.violations();
  if (violations.empty()) return;
  throw std::invalid_argument(fmt::format("{}", fmt::join(violations, "; ")));
}

World make_world(const SimulationOptions& options) {
  WorldSpec spec{.seed = options.seed, .day = options.day};
  spec.duration_s = kScanPeriod * static_cast<double>(options.scans);
  spec.length_m = EgoMotion::driven_m(spec.duration_s);
  return make_town(spec);
}

/// Tracks that the drive has a point on.
struct Seen {
  std::set<int> parked;
  std::set<int> moving;

  void add(const World& world, const std::vector<maps::Box>& boxes) {
    for (const maps::Box& box : boxes) {
      const bool moves = world.actors[static_cast<std::size_t>(box.track - 1)].moves();
      (moves ? moving : parked).insert(box.track);
    }
  }
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

std::vector<std::string> SimulationOptions::violations() const {
  std::vector<std::string> found;
  if (scenario != "town") {
    found.push_back(fmt::format("scenario: found \"{}\", expected town", scenario));
  }
  if (!sensor_named(sensor)) {
    found.push_back(
        fmt::format("sensor: found \"{}\", expected one of {}", sensor, sensor_names()));
  }
  if (day < 0) found.push_back(fmt::format("day: found {}, expected >= 0", day));
  if (scans < 1 || scans > kMaxScans) {
    found.push_back(fmt::format("scans: found {}, expected 1 to {}", scans, kMaxScans));
  }
  if (threads < 0 || threads > kMaxThreads) {
    found.push_back(fmt::format("threads: found {}, expected 0 to {}", threads, kMaxThreads));
  }
  return found;
}

SimulationReport simulate_drive(const std::filesystem::path& target,
                                const SimulationOptions& options,
                                const mapping::ProgressCallback& progress,
                                const mapping::CancelFlag& cancel) {
  require_usable(options);
  const auto start = std::chrono::steady_clock::now();
  DriveWriter writer(target);
  const Sensor sensor = *sensor_named(options.sensor);
  const World world = make_world(options);
  RayScene scene(world);
  const EgoMotion ego(sensor.height_m);
  tbb::task_arena arena(options.threads == 0 ? tbb::task_arena::automatic : options.threads);
  SimulationReport report;
  Seen seen;
  for (std::size_t i = 0; i < options.scans; ++i) {
    if (cancel.load()) throw mapping::Cancelled();
    const double time_s = kScanPeriod * static_cast<double>(i);
    const Eigen::Isometry3d T_world_lidar = ego.T_world_lidar(world.road, time_s);
    const std::uint64_t key = key_of({options.seed, static_cast<std::uint64_t>(options.day),
                                      static_cast<std::uint64_t>(Stream::kRays), i});
    scene.set_time(time_s);
    const SimulatedScan scan =
        arena.execute([&] { return take_scan(world, scene, sensor, T_world_lidar, key); });
    std::vector<maps::Box> boxes = boxes_of_scan(world, scan, T_world_lidar, time_s);
    seen.add(world, boxes);
    report.points += scan.points.size();
    writer.add(scan, std::move(boxes), T_world_lidar, time_s);
    if (progress) progress("simulate", i + 1, options.scans);
  }
  writer.publish();
  report.scans = options.scans;
  report.rays = options.scans * sensor.columns * sensor.elevations_rad.size();
  report.parked = seen.parked.size();
  report.moving = seen.moving.size();
  report.distance_m = EgoMotion::driven_m(kScanPeriod * static_cast<double>(options.scans - 1));
  report.seconds = seconds_since(start);
  return report;
}

}  // namespace stillmap::simulation
