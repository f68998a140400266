#include <fmt/core.h>

#include <memory>
#include <string>

#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "json/inspection_json.hpp"
#include "operation/inspection.hpp"

namespace stillmap::cli {
namespace {

using command_line::grouped;
using command_line::Table;

std::string text_of(const Eigen::AlignedBox3d& box) {
  if (box.isEmpty()) return "none";
  const Eigen::Vector3d& a = box.min();
  const Eigen::Vector3d& b = box.max();
  return fmt::format("x {:.1f} .. {:.1f}, y {:.1f} .. {:.1f}, z {:.1f} .. {:.1f} m", a.x(), b.x(),
                     a.y(), b.y(), a.z(), b.z());
}

std::string text_of(const std::optional<maps::GeodeticOrigin>& origin) {
  if (!origin) return "unknown";
  return fmt::format("{:.7f}, {:.7f} deg, {:.2f} m", origin->latitude_deg, origin->longitude_deg,
                     origin->altitude_m);
}

void print_for_people(const server::MapSummary& map) {
  Table table;
  table.add("map package", map.digest);
  table.add("schema", fmt::format("{}, written by stillmap {}", map.manifest.schema,
                                  map.manifest.software_version));
  table.add("frame", map.manifest.frame_id);
  table.add("origin", fmt::format("{:.3f}, {:.3f}, {:.3f} m", map.manifest.origin.x(),
                                  map.manifest.origin.y(), map.manifest.origin.z()));
  table.add("geodetic origin", text_of(map.manifest.geodetic_origin));
  if (const auto& registration = map.manifest.registration)
    table.add("registered",
              fmt::format("to {:.12}, {} scans within {:.3f} m", registration->previous_digest,
                          registration->scans_used, registration->residual_m));
  table.add("points", fmt::format("{} in {} tiles, voxels of {} m", grouped(map.points),
                                  map.manifest.tiles.size(), map.manifest.voxel_size_m));
  table.add("bounds", text_of(map.bounds_map));
  table.add("trajectory", fmt::format("{} poses, {:.1f} m, {} clock", map.poses, map.path_length_m,
                                      map.manifest.relative_clock ? "relative" : "Unix"));
  table.add("removed objects", grouped(map.objects));
  for (const auto& [name, count] : map.manifest.counts) table.add("  " + name, grouped(count));
  table.print();
}

void print_for_people(const server::DriveSummary& drive) {
  Table table;
  table.add("drive", std::string(maps::name_of(drive.layout)));
  table.add("scans",
            fmt::format("{} over {:.2f} s, {:.2f} Hz, {} clock", drive.scans, drive.duration_s,
                        drive.rate_hz, drive.relative_clock ? "relative" : "Unix"));
  table.add("poses", drive.has_poses ? fmt::format("for every scan, {:.1f} m", drive.path_length_m)
                                     : "none");
  table.add("geodetic origin", text_of(drive.origin));
  table.add("times of points", drive.has_point_times ? "from the sensor's turn" : "unknown");
  table.add("labels", drive.has_labels ? "for every point" : "none");
  table.add(
      "first scan",
      fmt::format("{} points, {} not finite, {} without return", grouped(drive.first_scan_points),
                  drive.first_scan_dropped.non_finite, drive.first_scan_dropped.zero_range));
  table.add("  bounds", text_of(drive.first_scan_bounds));
  for (const std::string& note : drive.notes) table.add("note", note);
  table.print();
}

template <typename Summary>
void print(const Summary& summary, bool json) {
  if (json) {
    fmt::print("{}\n", server::inspection_json(summary));
  } else {
    print_for_people(summary);
  }
}

}  // namespace

void add_inspect(CLI::App& app) {
  struct Arguments {
    std::filesystem::path folder;
    bool json = false;
  };
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("inspect", "Say what a map package or a drive holds");
  command->add_option("FOLDER", arguments->folder, "Map package or drive")
      ->required()
      ->check(command_line::existing_folder());
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments] {
    if (server::is_map_package(arguments->folder)) {
      print(server::summarize(*maps::MapPackage::open(arguments->folder)), arguments->json);
    } else {
      print(server::summarize(maps::Drive::open(arguments->folder)), arguments->json);
    }
  });
}

}  // namespace stillmap::cli
