#include <fmt/core.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <system_error>

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
constexpr std::array<OfflineCommand, 6> kOfflineCommands = {{
    {"build", "Make a map package from a drive", kMapper},
    {"rebuild", "Make a new version of a map and judge it against the one before", kMapper},
    {"import", "Make a map package from a point cloud map (PCD, PLY, LAS)", kMapper},
    {"export", "Write a map for other programs", kMapper},
    {"simulate", "Make a drive in a simulated world, with the truth beside it", kMapper},
    {"evaluate", "Measure localization, a map, odometry or a detector against a drive's truth",
     "stillmap-evaluate"},
}};

}  // namespace

void add_offline_commands(CLI::App& app) {
  for (const OfflineCommand& command : kOfflineCommands) {
    app.add_subcommand(std::string(command.name), std::string(command.description));
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

void exec_offline(const char* program, char** argv) {
  const fs::path found = find_beside(program, fs::path("libexec/stillmap") / program);
  if (found.empty()) {
    throw std::runtime_error(
        fmt::format("{}: found none, expected it beside stillmap or in ../libexec/stillmap. "
                    "`./dev build` makes it, the Debian package brings it",
                    program));
  }
  ::execv(found.c_str(), argv);
  throw std::runtime_error(
      fmt::format("{}: {}", found.string(), std::generic_category().message(errno)));
}

}  // namespace stillmap::cli
