#include <fmt/format.h>

#include <memory>
#include <numbers>
#include <stdexcept>
#include <stillmap/maps/content_digest.hpp>
#include <stillmap/maps/drive_address.hpp>
#include <string>
#include <utility>
#include <vector>

#include "bodies/inspection_json.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
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

std::string viewpoint_text(const std::optional<Eigen::Isometry3d>& viewpoint) {
  if (!viewpoint) return "none";
  if (viewpoint->matrix().isIdentity(0.0)) return "identity";
  const Eigen::Vector3d& t = viewpoint->translation();
  const Eigen::Quaterniond q(viewpoint->linear());
  return fmt::format("{:.3f} {:.3f} {:.3f} m, qw qx qy qz {:.6f} {:.6f} {:.6f} {:.6f}; not applied",
                     t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z());
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
                                  map.manifest.extent.tiles, map.manifest.voxel_size_m));
  table.add("bounds", text_of(map.bounds_map));
  table.add("trajectory", fmt::format("{} poses, {:.1f} m, {} clock", map.poses, map.path_length_m,
                                      map.manifest.relative_clock ? "relative" : "Unix"));
  if (map.bent)
    table.add("bent or torn",
              fmt::format("at {} poses; pose {} disagrees most with the scans' motion over 10 m: "
                          "{:.3f} m",
                          map.bent->poses, map.bent->worst, map.bent->worst_m));
  table.add("removed objects", grouped(map.objects));
  for (const auto& [name, count] : map.manifest.counts) table.add("  " + name, grouped(count));
  table.print();
}

void print_findings(const std::vector<maps::DriveFinding>& findings) {
  for (const maps::DriveFinding& finding : findings)
    fmt::print("wrong? {}\n       {}\n", finding.what, finding.remedy);
}

/// What was measured in some of the scans.
void add_check(const maps::DriveCheck& check, Table& table) {
  if (const auto& periods = check.periods)
    table.add("time between scans",
              fmt::format("{:.3f} s, longest {:.3f} s, {} gaps", periods->median_s,
                          periods->longest_s, periods->gaps));
  if (const auto& intensities = check.intensities)
    table.add("intensities", fmt::format("{} .. {}", (*intensities)[0], (*intensities)[1]));
  if (const auto& mounting = check.mounting)
    table.add("sensor",
              fmt::format("{:.2f} m above the ground, tilted by {:.1f} deg", mounting->height_m,
                          mounting->tilt_rad * 180.0 / std::numbers::pi));
  if (const auto& overlap = check.overlap)
    table.add(
        "overlap of scans",
        fmt::format("{:.0f} % with the poses, {:.0f} % without, {:.0f} % at best otherwise",
                    100.0 * overlap->given, 100.0 * overlap->without, 100.0 * overlap->other));
}

void print_for_people(const server::DriveSummary& drive) {
  Table table;
  table.add("drive", std::string(maps::name_of(drive.layout)));
  table.add("scans",
            fmt::format("{} over {:.2f} s, {:.2f} Hz, {} clock", drive.scans, drive.duration_s,
                        drive.rate_hz, drive.relative_clock ? "relative" : "Unix"));
  if (!drive.topic.empty())
    table.add("scans of", drive.frame_id.empty()
                              ? drive.topic
                              : fmt::format("{} in '{}'", drive.topic, drive.frame_id));
  if (!drive.fields.empty()) table.add("columns", fmt::format("{}", fmt::join(drive.fields, ", ")));
  table.add("poses", drive.has_poses ? fmt::format("for every scan, {:.1f} m", drive.path_length_m)
                                     : "none");
  table.add("geodetic origin", text_of(drive.origin));
  table.add("times of points", drive.has_point_times ? "for every point" : "unknown");
  if (const auto& imu = drive.imu)
    table.add("IMU", fmt::format(
                         "{}, {:.0f} Hz, longest gap {:.3f} s; its first reading is {:+.3f} s "
                         "from the first scan, its last {:+.3f} s from the last",
                         imu->source, imu->rate_hz, imu->longest_gap_s, imu->first_s, imu->last_s));
  table.add("labels", drive.has_labels ? "for every point" : "none");
  table.add(
      "first scan",
      fmt::format("{} points, {} not finite, {} without return", grouped(drive.first_scan_points),
                  drive.first_scan_dropped.non_finite, drive.first_scan_dropped.zero_range) +
          (drive.first_scan_dropped.unsure > 0
               ? fmt::format(", {} marked as unsure", drive.first_scan_dropped.unsure)
               : ""));
  table.add("  bounds", text_of(drive.first_scan_bounds));
  if (!drive.sensors.empty())
    table.add("looks like",
              fmt::format("{} (give it as 'DRIVE?sensor=NAME')", fmt::join(drive.sensors, " or ")));
  add_check(drive.check, table);
  for (const std::string& note : drive.notes) table.add("note", note);
  table.print();
  print_findings(drive.check.findings);
}

void print_for_people(const server::CloudFileSummary& file) {
  Table table;
  table.add("point cloud", fmt::format("{}, {} bytes", file.format, grouped(file.bytes)));
  std::string fields;
  for (const std::string& field : file.cloud.fields) fields += (fields.empty() ? "" : " ") + field;
  table.add("fields", fields);
  table.add("points",
            fmt::format("{}, {} not finite, {} withheld", grouped(file.cloud.points_in_file),
                        file.cloud.non_finite, file.cloud.withheld));
  table.add("bounds", text_of(file.bounds));
  table.add("precision",
            file.cloud.single_precision ? "32-bit floats" : "doubles or whole numbers");
  table.add("intensities", fmt::format("{} .. {}", file.intensities[0], file.intensities[1]));
  if (!file.cloud.coordinates.empty()) table.add("coordinates", file.cloud.coordinates);
  if (file.format == "pcd") table.add("viewpoint", viewpoint_text(file.cloud.viewpoint));
  table.print();
  print_findings(file.findings);
}

void print_for_people(const server::TrajectorySummary& file) {
  Table table;
  table.add("trajectory", file.format);
  table.add("poses", fmt::format("{} over {:.2f} s, {:.1f} m", file.poses, file.duration_s,
                                 file.path_length_m));
  table.add("bounds", text_of(file.bounds));
  table.print();
}

using command_line::JsonOutput;

template <typename Summary>
void print(const Summary& summary, const JsonOutput& json) {
  json.write(server::inspection_json(summary));
  if (!json.replaces_text()) print_for_people(summary);
}

void print_content_digest(const std::filesystem::path& path, const JsonOutput& json) {
  if (!server::is_map_package(path))
    throw std::invalid_argument(fmt::format(
        "--content is for map packages, and {} is none; leave --content out", path.string()));
  const auto package = maps::MapPackage::open(path);
  const std::string digest = maps::content_digest(*package);
  server::MapSummary summary = server::summarize(*package);
  summary.content_digest = digest;
  json.write(server::inspection_json(summary));
  if (!json.replaces_text()) fmt::print("{}\n", digest);
}

void print_for_people(const maps::ChoiceError& error, const std::filesystem::path& path) {
  const std::string place = maps::split_address(path).place.string();
  Table table;
  table.add("recording", place + ", which needs a choice");
  for (const maps::RecordingTopic& topic : error.topics()) {
    std::string value = fmt::format("'{}?{}={}'", place, topic.word, topic.name);
    if (topic.messages > 0) value += fmt::format(", {} messages", grouped(topic.messages));
    if (!topic.type.empty()) value += " of " + topic.type;
    if (!topic.frame_id.empty()) value += fmt::format(" in '{}'", topic.frame_id);
    table.add(topic.word, std::move(value));
  }
  table.print();
}

server::DriveSummary summary_of(const std::filesystem::path& path, bool by_motion) {
  server::DriveSummary summary = server::summarize(maps::Drive::open(path));
  if (!by_motion) return summary;
  if (!summary.has_poses)
    throw std::invalid_argument(path.string() +
                                ": it has no poses to compare with motion; leave out --motion, or "
                                "put a poses file beside the scans");
  for (maps::DriveFinding& finding : findings_by_motion(path))
    summary.check.findings.push_back(std::move(finding));
  return summary;
}

/// Maps and drives are recognised by their files, a single file by its extension.
void inspect(const std::filesystem::path& path, const JsonOutput& json, bool by_motion) {
  if (by_motion && (server::is_map_package(path) || !maps::Drive::is_at(path)))
    throw std::invalid_argument(
        fmt::format("--motion is for drives, and {} is none; leave --motion out", path.string()));
  if (server::is_map_package(path))
    return print(server::summarize(*maps::MapPackage::open(path)), json);
  if (maps::Drive::is_at(path)) {
    try {
      return print(summary_of(path, by_motion), json);
    } catch (const maps::ChoiceError& error) {
      json.write(server::inspection_json(error));
      if (!json.replaces_text()) print_for_people(error, path);
      throw;
    }
  }
  const std::string extension = path.extension().string();
  if (extension == ".txt" || extension == ".tum" || extension == ".csv" || extension == ".g2o")
    return print(server::summarize_trajectory(path), json);
  // What is none of these is refused there by name.
  print(server::summarize_cloud(path), json);
}

}  // namespace

void add_inspect(CLI::App& app) {
  struct Arguments {
    std::filesystem::path path;
    JsonOutput json;
    bool content = false;
    bool motion = false;
  };
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "inspect", "Show what a map, a drive or a file holds, and what looks wrong with it");
  command
      ->add_option("PATH", arguments->path,
                   "Map package, drive (its folder, or the file of a bag or a rawlog), point cloud "
                   "(.pcd, .ply, .las, .bin) or poses (.tum, .txt, .csv, .g2o)")
      ->required()
      ->check(command_line::existing_path());
  arguments->json.add_to(*command);
  command->add_flag("--motion", arguments->motion,
                    "For a drive with poses: compare them with the motion that odometry finds in "
                    "the scans, as `build` does; takes as long as odometry");
  command->add_flag("--content", arguments->content,
                    "For a map: print only the SHA-256 of its points, objects and poses. It does "
                    "not depend on tiles, options, sources, program and time of the build");
  command->callback([arguments] {
    if (arguments->content) return print_content_digest(arguments->path, arguments->json);
    inspect(arguments->path, arguments->json, arguments->motion);
  });
}

}  // namespace stillmap::cli
