#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/movable.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <string>
#include <vector>

#include "bodies/answers_json.hpp"
#include "command_line/option_value.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "errors/api_error.hpp"
#include "json/localization_options_json.hpp"
#include "localize.hpp"
#include "pose/pose_checks.hpp"

namespace stillmap::cli {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

std::vector<double> read_numbers(const std::string& text) {
  std::vector<double> numbers;
  const char* at = text.data();
  const char* const end = at + text.size();
  for (;;) {
    double number = 0.0;
    const auto [next, error] = std::from_chars(at, end, number);
    if (error != std::errc{}) return {};
    numbers.push_back(number);
    if (next == end) return numbers;
    if (*next != ',') return {};
    at = next + 1;
  }
}

Eigen::Isometry3d read_prior(const std::string& text) {
  const std::vector<double> n = read_numbers(text);
  std::array<double, 4> quaternion{0.0, 0.0, 0.0, 1.0};
  if (n.size() == 4) {
    quaternion[2] = std::sin(0.5 * n[3] * kDegree);
    quaternion[3] = std::cos(0.5 * n[3] * kDegree);
  } else if (n.size() == 7) {
    quaternion = {n[3], n[4], n[5], n[6]};
  } else {
    throw std::invalid_argument("--prior: '" + text +
                                "' is no pose; give X,Y,Z,YAW_DEG or X,Y,Z,QX,QY,QZ,QW");
  }
  try {
    return server::checked_pose({n[0], n[1], n[2]}, quaternion,
                                {server::ErrorCode::kInvalidPrior, "--prior", "--prior"});
  } catch (const server::ApiError& error) {
    throw std::invalid_argument(error.what());
  }
}

void print_for_people(const server::PoseAnswer& answer) {
  const localization::AlignmentResult& result = answer.result;
  command_line::Table table;
  table.add("status", std::string(localization::name_of(result.status)));
  if (!result.reasons.empty())
    table.add("reasons",
              fmt::format("{}", fmt::join(localization::names_of(result.reasons), ", ")));
  if (result.status != localization::PoseStatus::kLost) {
    const Eigen::Vector3d t = result.T_map_lidar.translation();
    const Eigen::Matrix3d R = result.T_map_lidar.linear();
    const Eigen::Matrix<double, 6, 1> sigma = result.covariance.diagonal().cwiseSqrt();
    table.add("position", fmt::format("{:.3f}, {:.3f}, {:.3f} m", t.x(), t.y(), t.z()));
    table.add("yaw", fmt::format("{:.3f} deg", std::atan2(R(1, 0), R(0, 0)) / kDegree));
    table.add("sigma", fmt::format("{:.3f}, {:.3f}, {:.3f} m; yaw {:.3f} deg", sigma(0), sigma(1),
                                   sigma(2), sigma(5) / kDegree));
    if (answer.parameters.prior) {
      const Eigen::Isometry3d moved =
          answer.parameters.prior->T_map_lidar.inverse() * result.T_map_lidar;
      table.add("from the prior", fmt::format("{:.3f} m, {:.3f} deg", moved.translation().norm(),
                                              Eigen::AngleAxisd(moved.linear()).angle() / kDegree));
    }
  }
  table.add("inlier ratio", fmt::format("{:.3f}", result.inlier_ratio));
  table.add("rmse", fmt::format("{:.3f} m", result.rmse_m));
  if (answer.movable_points > 0) {
    table.add("points in boxes", command_line::grouped(answer.movable_points));
  }
  table.add("iterations", std::to_string(result.iterations));
  table.add("time", fmt::format("{:.1f} ms", answer.timing.align_ms));
  table.print();
}

double milliseconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
      .count();
}

/// Boxes of a single scan, which is scan 0 of the file.
std::vector<maps::Box> read_boxes_of_scan(const std::filesystem::path& file) {
  maps::BoxSequence boxes = maps::read_boxes(file, 1);
  if (boxes.by_scan.empty()) {
    throw maps::InputError(file.string(), "no boxes of scan 0",
                           "boxes of scan 0, which is the scan given");
  }
  return std::move(boxes.by_scan.at(0));
}

localization::LocalizationOptions read_options(const std::string& file_or_preset) {
  if (file_or_preset.empty()) return {};
  const auto presets = localization::preset_names();
  if (std::find(presets.begin(), presets.end(), file_or_preset) != presets.end())
    return localization::preset(file_or_preset);
  if (!std::filesystem::exists(file_or_preset)) {
    throw std::invalid_argument(
        fmt::format("--options: '{}' is neither a file nor one of the presets {}", file_or_preset,
                    fmt::join(presets, ", ")));
  }
  return server::read_localization_options(file_or_preset);
}

void localize_scan(const LocalizeArguments& arguments,
                   const std::optional<Eigen::Isometry3d>& T_map_prior) {
  if (arguments.output || !arguments.select.empty()) {
    throw std::invalid_argument(fmt::format(
        "{} is one scan; -o and --select are for drives, leave them out", arguments.what.string()));
  }
  server::PoseAnswer answer{.map_name = {}, .map_version = {}, .map_digest = {}, .request_id = {}};
  if (T_map_prior) answer.parameters.prior = localization::Prior{*T_map_prior, std::nullopt};
  const auto begin = std::chrono::steady_clock::now();
  maps::PointCloud scan = maps::read_scan_file(arguments.what).cloud;
  if (arguments.boxes) {
    const std::size_t points = scan.size();
    scan = localization::without_points_in(scan, read_boxes_of_scan(*arguments.boxes));
    answer.movable_points = points - scan.size();
  }
  answer.timing.decode_ms = milliseconds_since(begin);
  const OpenMap map = open_map(arguments);
  answer.map_name = map.name;
  answer.map_digest = map.digest;
  const auto align_begin = std::chrono::steady_clock::now();
  answer.result = map.aligner->align(scan, answer.parameters.prior);
  answer.timing.align_ms = milliseconds_since(align_begin);
  answer.timing.total_ms = answer.timing.decode_ms + answer.timing.align_ms;
  arguments.json.write(server::pose_answer_json(answer));
  if (!arguments.json.replaces_text()) print_for_people(answer);
  if (answer.result.status == localization::PoseStatus::kLost) {
    throw command_line::ExitCode{exit_code::kFailed};
  }
}

void localize(const LocalizeArguments& arguments) {
  std::optional<Eigen::Isometry3d> T_map_prior;
  if (!arguments.prior.empty()) T_map_prior = read_prior(arguments.prior);
  if (maps::Drive::is_at(arguments.what)) {
    localize_drive(arguments, T_map_prior);
  } else {
    localize_scan(arguments, T_map_prior);
  }
}

}  // namespace

OpenMap open_map(const LocalizeArguments& arguments) {
  const auto options = read_options(arguments.options);
  const auto map = maps::MapPackage::open(arguments.map);
  return {arguments.map.filename().string(), map->digest(),
          localization::make_aligner(arguments.method, *map, options), options};
}

void add_localize(CLI::App& app) {
  auto arguments = std::make_shared<LocalizeArguments>();
  CLI::App* command = app.add_subcommand(
      "localize",
      "Find where a scan was taken, or follow a drive; exit code 1 when no pose is found");
  command->add_option("MAP", arguments->map, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  command
      ->add_option(
          "SCAN", arguments->what,
          "Scan (.bin with float32 x y z intensity, .pcd or .ply), or drive (its folder or bag)")
      ->required()
      ->check(command_line::existing_scan_or_drive());
  command->add_option(
      "--prior", arguments->prior,
      "Pose where the search for the first scan starts: X,Y,Z,YAW_DEG or X,Y,Z,QX,QY,QZ,QW in the "
      "map frame [m] (default: the whole map is searched)");
  command->add_option("--method", arguments->method, "Alignment method")
      ->capture_default_str()
      ->check(command_line::one_of(localization::aligner_names()));
  command->add_option("--options", arguments->options,
                      "Options of the method default: a preset (vehicle, indoor, handheld), or a "
                      "JSON FILE as localization/options.md describes it (default: vehicle)");
  command
      ->add_option("--boxes", arguments->boxes,
                   "Boxes of movable objects; points inside them are left out. JSON (format "
                   "stillmap-boxes) or KITTI tracking labels; a single SCAN is scan 0")
      ->check(command_line::existing_file());
  command->add_option("--select", arguments->select,
                      "Scans of a drive to localize, begin:end:step as in Python");
  command
      ->add_option("-o,--output", arguments->output,
                   "Write the poses of a drive to FILE (TUM, T_map_lidar; lost scans are left out) "
                   "instead of printing one line for each scan")
      ->check(command_line::in_existing_folder());
  arguments->json.add_to(*command);
  command->callback([arguments] { localize(*arguments); });
}

}  // namespace stillmap::cli
