#include <stillmap/mapping/given_pose_check.hpp>

#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>
#include <string>
#include <vector>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

struct CheckArguments {
  std::filesystem::path drive;
  std::vector<std::filesystem::path> poses;
  bool guided = false;
};

/// Prints a list of findings for the drive's own poses, or for each file of poses.
void check_poses(const CheckArguments& arguments) {
  const maps::Drive own = maps::Drive::open(arguments.drive);
  std::vector<maps::Drive> posed;
  for (const std::filesystem::path& file : arguments.poses)
    posed.push_back(maps::Drive::open(arguments.drive, file));
  if (arguments.poses.empty()) posed.push_back(own);
  command_line::ProgressBar bar;
  const mapping::ProgressCallback progress = [&](std::string_view stage, std::size_t done,
                                                 std::size_t total) {
    bar.update(std::string(stage), done, total);
  };
  const auto found = mapping::check_given_poses(own, posed, arguments.guided, progress,
                                                command_line::cancel_flag());
  nlohmann::json json = nlohmann::json::array();
  for (const auto& findings : found)
    json.push_back(nlohmann::json::parse(mapping::to_json(findings)));
  fmt::print("{}\n", json.dump(2));
}

}  // namespace

void add_check_poses(CLI::App& app) {
  auto arguments = std::make_shared<CheckArguments>();
  CLI::App* command = app.add_subcommand(
      "check-poses", "Compare poses of a drive with the scans' own motion (JSON)");
  command->group("");
  command->add_option("DRIVE", arguments->drive, "Drive, as for `stillmap build`")
      ->required()
      ->check(command_line::existing_drive());
  command
      ->add_option("--poses", arguments->poses, "Files of poses to use instead of the drive's own")
      ->check(command_line::existing_file());
  command->add_flag("--guided", arguments->guided,
                    "Start odometry at the given poses, as a build does");
  command->callback([arguments] { check_poses(*arguments); });
}

}  // namespace stillmap::mapper
