#include <fmt/core.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "command_line/command_text.hpp"
#include "command_line/command_tree.hpp"
#include "commands.hpp"

namespace stillmap::cli {
namespace {

namespace fs = std::filesystem;

struct OfflineCommand {
  std::string_view name;
  std::string_view description;
  const char* program;
};
constexpr const char* kMapper = "stillmap-mapper";
constexpr const char* kEvaluate = "stillmap-evaluate";
/// For this program alone: has no description and no place in the help.
constexpr std::string_view kCheckPoses = "check-poses";
constexpr std::array<OfflineCommand, 8> kOfflineCommands = {{
    {"build", "Build a map package from drives", kMapper},
    {"rebuild", "Build a new version of a map and judge it against the active one", kMapper},
    {"import", command_line::kImportDescription, kMapper},
    {"export", "Write a map in a format of other programs", kMapper},
    {"calibrate", "Find how the lidars of a vehicle stand to each other", kMapper},
    {"simulate", "Simulate a drive, with the ground truth beside it", kMapper},
    {kCheckPoses, "", kMapper},
    {"evaluate", "Measure localization, a map, odometry or a detector against ground truth",
     kEvaluate},
}};

fs::path offline_path(const char* program) {
  fs::path found = find_beside(program, fs::path("libexec/stillmap") / program);
  if (found.empty())
    throw std::runtime_error(fmt::format(
        "{0} is neither beside stillmap nor in ../libexec/stillmap; build it with `./dev "
        "build`, or install the Debian package",
        program));
  return found;
}

struct Output {
  std::string text;
  bool failed = false;
};

/// What a command of the shell prints.
Output run(const std::string& command) {
  std::unique_ptr<FILE, int (*)(FILE*)> output(::popen(command.c_str(), "r"), ::pclose);
  if (!output)
    throw std::runtime_error(fmt::format("{} cannot be started: {}; free memory or processes",
                                         command, std::generic_category().message(errno)));
  Output out;
  std::array<char, 4096> piece{};
  while (const std::size_t read = std::fread(piece.data(), 1, piece.size(), output.get()))
    out.text.append(piece.data(), read);
  out.failed = ::pclose(output.release()) != 0;
  return out;
}

}  // namespace

void add_offline_commands(CLI::App& app) {
  for (const OfflineCommand& command : kOfflineCommands) {
    CLI::App* added =
        app.add_subcommand(std::string(command.name), std::string(command.description));
    if (command.description.empty()) added->group("");
  }
}

const char* offline_program(std::string_view command) {
  for (const OfflineCommand& known : kOfflineCommands) {
    if (known.name == command) return known.program;
  }
  return nullptr;
}

fs::path find_beside(const fs::path& name, const fs::path& installed) {
  const fs::path folder = fs::canonical("/proc/self/exe").parent_path();
  for (const fs::path& candidate : {folder / name, folder.parent_path() / installed}) {
    if (fs::exists(candidate)) return candidate;
  }
  return {};
}

std::vector<maps::DriveFinding> findings_by_motion(const fs::path& drive) {
  const Output output =
      run(fmt::format("{} {} {}", command_line::shell_word(offline_path(kMapper).string()),
                      kCheckPoses, command_line::shell_word(drive.string())));
  const nlohmann::json found = nlohmann::json::parse(output.text, nullptr, false);
  // What went wrong stands on stderr already.
  if (output.failed || !found.is_array() || found.empty())
    throw std::runtime_error(fmt::format(
        "--motion: {} {} failed, see the lines above; leave out --motion to run the other checks",
        kMapper, kCheckPoses));
  std::vector<maps::DriveFinding> findings;
  for (const auto& finding : found.at(0))
    findings.push_back({finding.at("code"), finding.at("what"), finding.at("remedy")});
  return findings;
}

std::vector<command_line::CommandEntry> offline_commands() {
  std::vector<command_line::CommandEntry> all;
  for (const char* program : {kMapper, kEvaluate}) {
    const Output output =
        run(fmt::format("{} {}", command_line::shell_word(offline_path(program).string()),
                        command_line::kPrintsCommandTree));
    if (output.failed) throw std::runtime_error(std::string(program) + " failed, see above");
    for (command_line::CommandEntry& entry : command_line::command_tree_from(output.text))
      all.push_back(std::move(entry));
  }
  return all;
}

void exec_offline(const char* program, char** argv) {
  const fs::path found = offline_path(program);
  ::execv(found.c_str(), argv);
  throw std::runtime_error(fmt::format("{} cannot be started: {}; install or build it again",
                                       found.string(), std::generic_category().message(errno)));
}

}  // namespace stillmap::cli
