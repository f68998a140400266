#include <stillmap/simulation/simulate.hpp>

#include <stillmap/maps/peak_memory.hpp>

#include <fmt/format.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include "geometry/random.hpp"
#include "output/drive_writer.hpp"
#include "scenarios/world.hpp"
#include "sensing/ego_motion.hpp"
#include "sensing/scanner.hpp"
#include "sensing/sensor.hpp"

namespace stillmap::simulation {
namespace {

constexpr std::size_t kMaxScans = 10'000;
/// The world of the city does not grow with the drive.
constexpr std::size_t kMaxCityScans = 100'000;
constexpr int kMaxThreads = 1024;
/// Labels have 16 bits for the track, and 0 is none.
constexpr std::size_t kMaxTracks = 65'535;

std::optional<OutputLayout> layout_named(const std::string& name) {
  if (name == "kitti-odometry") return OutputLayout::kKittiOdometry;
  if (name == "kitti-raw") return OutputLayout::kKittiRaw;
  if (name == "pcd") return OutputLayout::kPcd;
  return std::nullopt;
}

/// Tracks that the drive has a point on.
struct Tracks {
  std::set<int> parked;
  std::set<int> moving;

  void add(const World& world, const std::vector<maps::Box>& boxes) {
    for (const maps::Box& box : boxes) {
      const bool moves = world.actors[static_cast<std::size_t>(box.track - 1)].moves();
      (moves ? moving : parked).insert(box.track);
    }
  }
};

/// Waits for a task group whatever happens.
struct Joined {
  tbb::task_group& group;
  explicit Joined(tbb::task_group& g) : group(g) {}
  Joined(const Joined&) = delete;
  Joined& operator=(const Joined&) = delete;
  ~Joined() {
    try {
      group.wait();
    } catch (...) {
      // Another exception is on its way already.
    }
  }
};

/// Traffic makes way for a vehicle that drives as it does, and nobody parks where one drives. Other
/// carriers would pass through others: who comes near is not there.
void make_room(World& world, const EgoMotion& ego, double duration_s) {
  if (ego.carrier() == Carrier::kVehicle) return;
  constexpr double kStepS = 0.1;
  constexpr double kRoomM = 5.0;
  std::vector<Eigen::Vector2d> way;
  for (double time_s = 0.0; time_s <= duration_s; time_s += kStepS)
    way.emplace_back(ego.T_world_lidar(time_s).translation().head<2>());
  std::erase_if(world.actors, [&](const Actor& actor) {
    for (std::size_t i = 0; i < way.size(); ++i) {
      const double time_s = kStepS * static_cast<double>(i);
      if (!actor.present(time_s)) continue;
      const Eigen::Vector2d at = T_world_actor(world, actor, time_s).translation().head<2>();
      if ((at - way[i]).norm() < kRoomM) return true;
    }
    return false;
  });
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::uint64_t key_for(const SimulationOptions& options, Stream stream) {
  return key_of(
      {options.seed, static_cast<std::uint64_t>(options.day), static_cast<std::uint64_t>(stream)});
}

Eigen::Isometry3d T_usual_lidar_of(const std::array<double, 6>& mount) {
  return Eigen::Translation3d(mount[0], mount[1], mount[2]) *
         Eigen::AngleAxisd(kRadPerDeg * mount[5], Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(kRadPerDeg * mount[4], Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(kRadPerDeg * mount[3], Eigen::Vector3d::UnitX());
}

/// A lidar in another place is another one of its kind. 0 in the usual place.
std::uint64_t unit_of(const std::array<double, 6>& mount) {
  std::uint64_t unit = 0;
  for (const double value : mount) {
    if (value != 0.0 || unit != 0) unit = key_of({unit, std::bit_cast<std::uint64_t>(value)});
  }
  return unit;
}

std::uint64_t key_of_unit(std::uint64_t key, std::uint64_t unit) {
  return unit == 0 ? key : key_of({key, unit});
}

/// Of the whole drive, whatever part is taken.
std::size_t drive_scans(const SimulationOptions& options) {
  return options.of > 0 ? options.of : options.first + options.scans;
}

/// At least as much of the world as is driven through.
World world_of(const SimulationOptions& options, double reach_m, double duration_s,
               const mapping::CancelFlag& cancel) {
  return make_world(
      {.scenario = options.scenario,
       .seed = options.seed,
       .day = options.day,
       .change = options.change,
       .parked_share = options.parked_share,
       .duration_s = std::max(1.0, pace_of(*carrier_named(options.carrier))) * duration_s,
       .standing = options.standing,
       .reach_m = reach_m,
       .cancel = &cancel});
}

}  // namespace

std::vector<std::string> SimulationOptions::violations() const {
  std::vector<std::string> found;
  if (!is_scenario(scenario)) {
    found.push_back(
        fmt::format("scenario: found \"{}\", expected one of {}", scenario, scenario_names()));
  }
  if (!layout_named(layout)) {
    found.push_back(
        fmt::format("layout: found \"{}\", expected kitti-odometry, kitti-raw or pcd", layout));
  }
  if (day < 0) found.push_back(fmt::format("day: found {}, expected >= 0", day));
  if (parked_share && !(*parked_share >= 0.0 && *parked_share <= 1.0)) {
    found.push_back(fmt::format("parked_share: found {}, expected in [0, 1]", *parked_share));
  }
  for (std::size_t i = 0; i < mount.size(); ++i) {
    const double most = i < 3 ? 5.0 : 180.0;
    if (!(std::abs(mount[i]) <= most))
      found.push_back(fmt::format("mount: found {}, expected within {} of 0", mount[i], most));
  }
  if (mount != std::array<double, 6>{} && layout != "pcd")
    found.push_back("mount: found with layout " + layout + ", expected layout pcd");
  if (!(phase_s >= 0.0 && phase_s <= 0.2)) {
    found.push_back(fmt::format("phase_s: found {}, expected in [0, 0.2]", phase_s));
  }
  if (!carrier_named(carrier)) {
    found.push_back(
        fmt::format("carrier: found \"{}\", expected one of {}", carrier, carrier_names()));
  }
  if (imu && layout != "pcd") {
    found.push_back(fmt::format("layout: found {} beside an IMU, expected pcd", layout));
  }
  if (standing && carrier != "vehicle") {
    found.push_back(
        fmt::format("carrier: found {} beside a standing sensor, expected vehicle", carrier));
  }
  const std::size_t most = scenario == "city" ? kMaxCityScans : kMaxScans;
  if (scans < 1 || scans > most) {
    found.push_back(fmt::format("scans: found {}, expected 1 to {}{}", scans, most,
                                most < kMaxCityScans ? " (scenario city: 100000)" : ""));
  } else if (of > most) {
    found.push_back(fmt::format("of: found {}, expected at most {}{}", of, most,
                                most < kMaxCityScans ? " (scenario city: 100000)" : ""));
  } else if (const std::size_t end = of > 0 ? of : most; scans > end || first > end - scans) {
    found.push_back(fmt::format("first: found {} with {} scans, expected a part of {} scans", first,
                                scans, end));
  }
  if (every < 1) found.push_back("every: found 0, expected >= 1");
  if ((first > 0 || every > 1) && (layout == "kitti-raw" || imu)) {
    found.push_back(
        fmt::format("{}: found with layout kitti-raw or an IMU, whose errors go on from scan to "
                    "scan, expected layout kitti-odometry or pcd without one",
                    first > 0 ? "first" : "every"));
  }
  if (scenario == "city" && (standing || carrier != "vehicle")) {
    found.push_back(
        fmt::format("carrier: found {}{} in scenario city, expected a vehicle that drives, or "
                    "another scenario",
                    carrier, standing ? ", standing," : ""));
  }
  if (threads < 0 || threads > kMaxThreads) {
    found.push_back(fmt::format("threads: found {}, expected 0 to {}", threads, kMaxThreads));
  }
  return found;
}

SimulationResult simulate_drive(const std::filesystem::path& target,
                                const SimulationOptions& options,
                                const mapping::ProgressCallback& progress,
                                const mapping::CancelFlag& cancel) {
  if (const std::vector<std::string> violations = options.violations(); !violations.empty()) {
    throw std::invalid_argument(fmt::format("{}", fmt::join(violations, "; ")));
  }
  const auto start = std::chrono::steady_clock::now();
  const std::unique_ptr<Sensor> sensor = make_sensor(options.sensor);
  const SensorProperties& properties = sensor->properties();
  // Refused before the work begins if there is no place for it.
  std::optional<EgoMotion> ego;
  Eigen::Isometry3d T_world_start = Eigen::Isometry3d::Identity();
  DriveWriter writer(
      target,
      {.layout = *layout_named(options.layout),
       .truth = options.truth,
       .period_s = properties.period_s,
       .key = key_for(options, Stream::kGnss),
       .lidar_height_m = properties.height_m,
       .imu = options.imu,
       .T_world_map =
           [&] {
             return Eigen::Isometry3d(T_world_start *
                                      Eigen::Translation3d(0.0, 0.0, properties.height_m));
           }},
      [&ego](double time_s) { return ego->T_world_lidar(time_s); });
  if (progress) progress("world", 0, 1);
  const double duration_s = properties.period_s * static_cast<double>(drive_scans(options));
  const Carrier carrier = *carrier_named(options.carrier);
  World world = world_of(options, properties.max_range_m, duration_s, cancel);
  T_world_start = world.T_world_start;
  ego.emplace(world, properties.height_m, carrier, T_usual_lidar_of(options.mount));
  make_room(world, *ego, duration_s);
  if (world.actors.size() > kMaxTracks) {
    throw std::invalid_argument(fmt::format(
        "scans: found a drive of {} scans with {} objects, of which labels can name {}; "
        "expected a shorter drive",
        drive_scans(options), world.actors.size(), kMaxTracks));
  }
  const std::uint64_t unit = unit_of(options.mount);
  Scanner scanner(world, *ego, *sensor,
                  {.key = key_of_unit(key_for(options, Stream::kRays), unit),
                   .behind = options.truth,
                   .unit = unit,
                   .phase_s = options.phase_s});
  SimulationResult result;
  result.world_seconds = seconds_since(start);
  if (progress) progress("world", 1, 1);
  Tracks tracks;
  tbb::task_arena arena(options.threads == 0 ? tbb::task_arena::automatic : options.threads);
  arena.execute([&] {
    // One scan is written while the next is taken.
    tbb::task_group writing;
    SimulatedScan written;
    const Joined joined(writing);
    for (std::size_t i = 0; i < options.scans; i += options.every) {
      if (cancel.load()) break;
      SimulatedScan scan = scanner.take(options.first + i);
      writing.wait();
      written = std::move(scan);
      writing.run([&] { writer.add(written); });
      tracks.add(world, written.boxes);
      result.points += written.points.size();
      ++result.scans;
      if (progress) progress("simulate", std::min(i + options.every, options.scans), options.scans);
    }
    writing.wait();
  });
  if (cancel.load()) throw mapping::Cancelled();
  writer.publish(world.ground);
  result.rays = scanner.rays();
  result.parked = tracks.parked.size();
  result.moving = tracks.moving.size();
  const double first_s = properties.period_s * static_cast<double>(options.first);
  const double last_s = first_s + properties.period_s * static_cast<double>(options.scans - 1);
  result.distance_m = world.own_motion.station(pace_of(carrier) * last_s) -
                      world.own_motion.station(pace_of(carrier) * first_s);
  result.seconds = seconds_since(start);
  result.peak_rss_mib = maps::peak_rss_mib();
  return result;
}

}  // namespace stillmap::simulation
