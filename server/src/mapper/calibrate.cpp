#include <stillmap/mapping/lidar_calibration.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_address.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/lidar_set.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "command_line/text_file.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

namespace fs = std::filesystem;
using mapping::kMountParameters;
using mapping::LidarCalibration;
using mapping::LidarMount;

constexpr double kDegPerRad = 57.29577951308232;

struct CalibrateArguments {
  fs::path reference;
  std::vector<fs::path> lidars;
  fs::path output;
  command_line::JsonOutput json;
  int threads = 0;
};

nlohmann::ordered_json json_of_mount(const LidarMount& mount) {
  const Eigen::Vector3d p = mount.T_reference_lidar.translation();
  const Eigen::Quaterniond q(mount.T_reference_lidar.linear());
  const Eigen::Matrix<double, 6, 1> values = mount.values(), sigma = mount.sigma();
  nlohmann::ordered_json json = {{"position", {p.x(), p.y(), p.z()}},
                                 {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
  for (std::size_t i = 0; i < kMountParameters.size(); ++i) {
    const bool is_place = i < 3;
    const double unit = is_place ? 1.0 : kDegPerRad;
    const auto k = static_cast<Eigen::Index>(i);
    json["parameters"][std::string(kMountParameters[i]) + (is_place ? "_m" : "_deg")] = {
        {"value", unit * values[k]}, {"sigma", unit * sigma[k]}};
  }
  json["used"] = mount.used;
  return json;
}

nlohmann::ordered_json json_of_calibration(const fs::path& lidar, const LidarCalibration& found) {
  nlohmann::ordered_json json = {{"drive", lidar.string()},
                                 {"mount", json_of_mount(found.mount())}};
  json["from_motion"] = json_of_mount(found.from_motion);
  json["from_maps"] = nullptr;
  if (found.from_maps) json["from_maps"] = json_of_mount(*found.from_maps);
  json["overlap"] = found.overlap;
  json["time_offset_s"] = nullptr;
  if (found.clock)
    json["time_offset_s"] = {{"value", found.clock->offset_s},
                             {"sigma", found.clock->sigma_s},
                             {"used", found.clock->is_used}};
  json["unobserved"] = found.unobserved();
  return json;
}

void print_calibration(const fs::path& lidar, const LidarCalibration& found) {
  command_line::Table table;
  table.add("lidar", lidar.string());
  const LidarMount& mount = found.mount();
  const Eigen::Matrix<double, 6, 1> values = mount.values(), sigma = mount.sigma();
  for (std::size_t i = 0; i < kMountParameters.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    table.add(kMountParameters[i],
              i < 3 ? fmt::format("{:8.4f} m    sigma {:.4f} m", values[k], sigma[k])
                    : fmt::format("{:8.3f} deg  sigma {:.3f} deg", kDegPerRad * values[k],
                                  kDegPerRad * sigma[k]));
  }
  table.add("clock", found.clock ? fmt::format("{:+.4f} s, sigma {:.4f} s: {}",
                                               found.clock->offset_s, found.clock->sigma_s,
                                               found.clock->is_used ? "added to its stamps"
                                                                    : "taken as the same")
                                 : "offset not found");
  table.add("from",
            found.from_maps
                ? fmt::format("{} scans of either in the other's map, {:.0f} % of the points "
                              "on it",
                              mount.used, 100.0 * found.overlap)
                : fmt::format("{} motions", mount.used));
  table.print();
  if (!found.from_maps)
    fmt::print("note: the lidars' maps overlap too little to align scans with them\n");
  if (const auto open = found.unobserved(); !open.empty())
    fmt::print("note: these drives do not tell {}: measure by hand, or drive {}\n",
               fmt::join(open, ", "), "over slopes and in turns to both sides, near walls");
}

/// Without `.`, `..` and a slash at its end; a link at its end is not followed.
fs::path absolute_place(const fs::path& place) {
  const fs::path normal = fs::absolute(place).lexically_normal();
  return normal.has_filename() ? normal : normal.parent_path();
}

/// The drives as `lidars.json` names them. @throws InputError for one in another folder.
std::vector<maps::MountedLidar> named_beside(const CalibrateArguments& arguments) {
  const fs::path folder = fs::weakly_canonical(absolute_place(arguments.output).parent_path());
  std::vector<maps::MountedLidar> named;
  std::vector<fs::path> drives = {arguments.reference};
  drives.insert(drives.end(), arguments.lidars.begin(), arguments.lidars.end());
  for (const fs::path& drive : drives) {
    const auto [given, words] = maps::split_address(drive);
    const fs::path place = absolute_place(given);
    if (fs::weakly_canonical(place.parent_path()) != folder)
      throw maps::InputError(
          drive.string(), "a drive in " + place.parent_path().string(),
          "one beside " + arguments.output.string() +
              ": put the drives, or links to them, and the file into one folder");
    named.push_back({place.filename().string() + (words.empty() ? "" : "?" + words)});
  }
  return named;
}

void calibrate(const CalibrateArguments& arguments) {
  std::vector<maps::MountedLidar> named;
  if (!arguments.output.empty()) named = named_beside(arguments);
  const maps::Drive reference = maps::Drive::open(arguments.reference);
  // All at first: a calibration takes minutes.
  std::vector<maps::Drive> lidars;
  for (const fs::path& lidar : arguments.lidars) lidars.push_back(maps::Drive::open(lidar));
  nlohmann::ordered_json json = {{"reference", arguments.reference.string()},
                                 {"lidars", nlohmann::ordered_json::array()},
                                 {"version", STILLMAP_VERSION}};
  std::vector<std::string> untold;
  for (std::size_t i = 0; i < arguments.lidars.size(); ++i) {
    LidarCalibration found;
    {
      command_line::ProgressBar bar;
      found =
          mapping::calibrate_lidars({reference, lidars[i], arguments.threads,
                                     [&bar](std::string_view stage, std::size_t done,
                                            std::size_t total) { bar.update(stage, done, total); }},
                                    command_line::cancel_flag());
    }
    json["lidars"].push_back(json_of_calibration(arguments.lidars[i], found));
    if (!arguments.json.replaces_text()) print_calibration(arguments.lidars[i], found);
    if (named.empty()) continue;
    if (const auto open = found.unobserved(); !open.empty())
      untold.push_back(
          fmt::format("{} of {}", fmt::join(open, ", "), arguments.lidars[i].string()));
    named[i + 1].T_reference_lidar = found.mount().T_reference_lidar;
    if (found.clock && found.clock->is_used) named[i + 1].time_offset_s = found.clock->offset_s;
  }
  arguments.json.write(json.dump(2));
  if (!untold.empty())
    throw maps::InputError(
        arguments.output.string(),
        fmt::format("nothing written, as the drives do not tell {}", fmt::join(untold, "; ")),
        "drives that tell all: record a minute with slopes and turns to both sides, near walls");
  if (!named.empty()) command_line::write_text_file(arguments.output, maps::lidar_set_text(named));
  if (!named.empty() && !arguments.json.replaces_text())
    fmt::print("next     stillmap build {} -o MAP\n",
               fs::weakly_canonical(arguments.output).parent_path().string());
}

}  // namespace

void add_calibrate(CLI::App& app) {
  auto arguments = std::make_shared<CalibrateArguments>();
  CLI::App* command =
      app.add_subcommand("calibrate", "Find how the lidars of a vehicle stand to each other");
  command->footer(
      "The drives are of one time and one vehicle, 60 s or more with turns. With -o the file says\n"
      "where the lidars stand; the folder that holds it is a drive of all of them.");
  command
      ->add_option("REFERENCE", arguments->reference, "Drive of the lidar that the others stand to")
      ->required()
      ->check(command_line::existing_drive());
  // With the reference no more than lidars.json may name.
  command->add_option("LIDAR", arguments->lidars, "Drives of the other lidars")
      ->required()
      ->expected(1, int{maps::kMostLidars} - 1)
      ->check(command_line::existing_drive());
  command
      ->add_option("-o,--output", arguments->output,
                   "File lidars.json to write, in the folder that holds the drives")
      ->type_name("FILE")
      ->check([](const std::string& file) {
        return fs::path(file).filename() == maps::kLidarSetFile
                   ? std::string()
                   : fmt::format("found {}, expected a file called {}", file, maps::kLidarSetFile);
      });
  command
      ->add_option("--threads", arguments->threads,
                   "Threads; 0 = all cores. The result is the same with any number")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  arguments->json.add_to(*command);
  command->callback([arguments] { calibrate(*arguments); });
}

}  // namespace stillmap::mapper
