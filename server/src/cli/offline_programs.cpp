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

#include "command_line/command_text.hpp"
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
/// Not for people: has no description and no place in the help.
constexpr std::string_view kCheckPoses = "check-poses";
constexpr std::array<OfflineCommand, 7> kOfflineCommands = {{
    {"build", "Make a map package from a drive", kMapper},
    {"rebuild", "Make a new version of a map and judge it against the one before", kMapper},
    {"import", "Make a map package from a point cloud map (PCD, PLY, LAS)", kMapper},
    {"export", "Write a map for other programs", kMapper},
    {"simulate", "Make a drive in a simulated world, with the truth beside it", kMapper},
    {kCheckPoses, "", kMapper},
    {"evaluate", "Measure localization, a map, odometry or a detector against a drive's truth",
     "stillmap-evaluate"},
}};

fs::path offline_path(const char* program) {
  fs::path found = find_beside(program, fs::path("libexec/stillmap") / program);
  if (found.empty())
    throw std::runtime_error(
        fmt::format("{}: found none, expected it beside stillmap or in ../libexec/stillmap. "
                    "`./dev build` makes it, the Debian package brings it",
                    program));
  return found;
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
  const std::string command =
      fmt::format("{} {} {}", command_line::shell_word(offline_path(kMapper).string()), kCheckPoses,
                  command_line::shell_word(drive.string()));
  std::unique_ptr<FILE, int (*)(FILE*)> output(::popen(command.c_str(), "r"), ::pclose);
  if (!output)
    throw std::runtime_error(fmt::format("{}: {}; free memory or processes, or leave out --motion",
                                         kMapper, std::generic_category().message(errno)));
  std::string text;
  std::array<char, 4096> piece{};
  while (const std::size_t read = std::fread(piece.data(), 1, piece.size(), output.get()))
    text.append(piece.data(), read);
  const bool failed = ::pclose(output.release()) != 0;
  const nlohmann::json found = nlohmann::json::parse(text, nullptr, false);
  // What went wrong stands on stderr already.
  if (failed || !found.is_array() || found.empty())
    throw std::runtime_error(fmt::format(
        "--motion: {} {} failed, see the lines above; without --motion the other checks "
        "still run",
        kMapper, kCheckPoses));
  std::vector<maps::DriveFinding> findings;
  for (const auto& finding : found.at(0))
    findings.push_back({finding.at("code"), finding.at("what"), finding.at("remedy")});
  return findings;
}

void exec_offline(const char* program, char** argv) {
  const fs::path found = offline_path(program);
  ::execv(found.c_str(), argv);
  throw std::runtime_error(
      fmt::format("{}: {}", found.string(), std::generic_category().message(errno)));
}

}  // namespace stillmap::cli
