// What the detector learns from: scans of simulated drives, straight from the simulator, with the
// ground that the mapping stages see under them.
//
//   stillmap-training-scans OUT --scenario town --seed 1 --sensor hdl64 --scans 50 --stride 8
//
// OUT is a file of records, one a scan, little endian (read by scans.py):
//   char[4] "STSC", uint32 version (1), uint32 points, uint32 boxes, float32 sensor height [m]
//   points x int16[3]: x, y in the lidar frame, height over the ground surface, in steps of 2.5 mm
//   points x uint8: ring;  points x uint16: number of the box it belongs to + 1, or 0
//   boxes x float32[7]: centre x, y, height of the centre over the ground surface under it,
//   length, width, height [m], yaw [rad]; boxes x uint8[2]: class (maps::ObjectClass), moving
#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan.hpp>

#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "geometry/random.hpp"
#include "scenarios/world.hpp"
#include "sensing/ego_motion.hpp"
#include "sensing/scanner.hpp"
#include "sensing/sensor.hpp"

namespace {

using namespace stillmap;

constexpr float kStepM = 0.0025F;
/// Farther points are of no use to any range trained for [m].
constexpr float kReachM = 75.0F;
/// Of what stands on the ground; some more than any network takes, for augmentation [m].
constexpr float kLowestM = 0.0F, kHighestM = 5.5F;
/// Scans that the ground segmentation learns the sensor's height from, as in a build.
constexpr std::size_t kLearnScans = 5;

struct Arguments {
  std::string out, scenario = "town", sensor = "hdl64";
  std::uint64_t seed = 1;
  int day = 1;
  std::optional<double> parked;
  bool busy = false;
  std::size_t scans = 50, stride = 8;
};

template <typename T>
void put(std::ofstream& out, const T* values, std::size_t count) {
  out.write(reinterpret_cast<const char*>(values), static_cast<std::streamsize>(count * sizeof(T)));
}

/// Height over the ground; where none is known near enough, over the plane under the sensor.
float height_of(const mapping::GroundResult& ground, double sensor_ground_z,
                const Eigen::Vector3d& p) {
  const auto sample = ground.surface->at(p.x(), p.y());
  return static_cast<float>(p.z() - (sample ? sample->z : sensor_ground_z));
}

struct Record {
  std::vector<std::int16_t> positions;
  std::vector<std::uint8_t> rings;
  std::vector<std::uint16_t> owners;
  std::vector<float> boxes;
  std::vector<std::uint8_t> kinds;
};

void add_boxes(Record& record, const simulation::World& world, const std::vector<maps::Box>& boxes,
               const mapping::GroundResult& ground, double ground_z) {
  for (const maps::Box& box : boxes) {
    const float height_m = height_of(ground, ground_z, box.centre);
    for (const double value : {box.centre.x(), box.centre.y(), static_cast<double>(height_m),
                               box.size_m.x(), box.size_m.y(), box.size_m.z(), box.yaw_rad})
      record.boxes.push_back(static_cast<float>(value));
    const bool moves = world.actors[static_cast<std::size_t>(box.track - 1)].moves();
    record.kinds.push_back(static_cast<std::uint8_t>(box.object_class));
    record.kinds.push_back(moves ? 1 : 0);
  }
}

Record record_of(const simulation::World& world, const simulation::SimulatedScan& scan,
                 const mapping::GroundResult& ground, double ground_z) {
  Record record;
  std::unordered_map<std::uint32_t, std::uint16_t> number_of_track;
  for (std::size_t i = 0; i < scan.boxes.size(); ++i)
    number_of_track[static_cast<std::uint32_t>(scan.boxes[i].track)] =
        static_cast<std::uint16_t>(i + 1);
  const simulation::LabelledPoints& points = scan.points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points.positions[i];
    if (!(std::hypot(p.x(), p.y()) < kReachM)) continue;
    const float height_m = height_of(ground, ground_z, p.cast<double>());
    if (!(height_m > kLowestM && height_m < kHighestM)) continue;
    for (const float value : {p.x(), p.y(), height_m})
      record.positions.push_back(static_cast<std::int16_t>(std::lround(value / kStepM)));
    record.rings.push_back(static_cast<std::uint8_t>(points.rings[i]));
    const auto owner = number_of_track.find(points.labels[i] >> simulation::kInstanceShift);
    record.owners.push_back(owner == number_of_track.end() ? std::uint16_t{0} : owner->second);
  }
  add_boxes(record, world, scan.boxes, ground, ground_z);
  return record;
}

void write(std::ofstream& out, const Record& record, float sensor_height_m) {
  const std::uint32_t header[] = {1, static_cast<std::uint32_t>(record.rings.size()),
                                  static_cast<std::uint32_t>(record.kinds.size() / 2)};
  put(out, "STSC", 4);
  put(out, header, 3);
  put(out, &sensor_height_m, 1);
  put(out, record.positions.data(), record.positions.size());
  put(out, record.rings.data(), record.rings.size());
  put(out, record.owners.data(), record.owners.size());
  put(out, record.boxes.data(), record.boxes.size());
  put(out, record.kinds.data(), record.kinds.size());
}

maps::PointCloud cloud_of(const simulation::SimulatedScan& scan) {
  maps::PointCloud cloud;
  cloud.positions = scan.points.positions;
  cloud.intensities = scan.points.intensities;
  return cloud;
}

void run(const Arguments& arguments) {
  using simulation::key_of;
  const auto sensor = simulation::make_sensor(arguments.sensor);
  const auto& properties = sensor->properties();
  const std::size_t span = arguments.scans * arguments.stride;
  const simulation::World world =
      simulation::make_world({.scenario = arguments.scenario,
                              .seed = arguments.seed,
                              .day = arguments.day,
                              .parked_share = arguments.parked,
                              .busy = arguments.busy,
                              .duration_s = properties.period_s * static_cast<double>(span),
                              .reach_m = std::min(properties.max_range_m, 100.0)});
  const simulation::EgoMotion ego(world, properties.height_m);
  simulation::Scanner scanner(
      world, ego, *sensor,
      {.key = key_of({arguments.seed, static_cast<std::uint64_t>(arguments.day), 0x7261U})});
  const auto segmenter = mapping::make_ground_segmenter();
  for (std::size_t i = 0; i < kLearnScans; ++i)
    segmenter->learn(cloud_of(scanner.take(i * span / kLearnScans)));
  const std::string unfinished = arguments.out + ".part";
  std::ofstream out(unfinished, std::ios::binary);
  for (std::size_t i = 0; i < arguments.scans; ++i) {
    const simulation::SimulatedScan scan = scanner.take(i * arguments.stride);
    const mapping::GroundResult ground = segmenter->segment(cloud_of(scan));
    const auto below = ground.surface->at(0.0, 0.0);
    const double ground_z = below ? below->z : -properties.height_m;
    write(out, record_of(world, scan, ground, ground_z), static_cast<float>(-ground_z));
  }
  out.close();
  if (!out || std::rename(unfinished.c_str(), arguments.out.c_str()) != 0)
    throw maps::StorageError(arguments.out, "could not be written");
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app{"Scans of a simulated drive, as the detector learns from them"};
  app.add_option("OUT", arguments.out, "File to write")->required();
  app.add_option("--scenario", arguments.scenario, "town, highway or depot");
  app.add_option("--sensor", arguments.sensor, "Name or file of a sensor");
  app.add_option("--seed", arguments.seed, "World");
  app.add_option("--day", arguments.day, "Parked vehicles and traffic");
  app.add_option("--parked", arguments.parked, "Share of the parking places taken");
  app.add_flag("--busy", arguments.busy, "Many two-wheelers and people, and what looks like them");
  app.add_option("--scans", arguments.scans, "Scans to take")->check(CLI::Range(1, 10'000));
  app.add_option("--stride", arguments.stride, "Of the drive's scans, each STRIDE-th")
      ->check(CLI::Range(1, 1000));
  CLI11_PARSE(app, argc, argv);
  try {
    run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "stillmap-training-scans: %s\n", error.what());
    return 1;
  }
}
