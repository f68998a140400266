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

struct MapperCommand {
  std::string_view name;
  std::string_view description;
};
constexpr std::array<MapperCommand, 6> kMapperCommands = {{
    {"build", "Make a map package from a drive"},
    {"rebuild", "Make a new version of a map and judge it against the one before"},
    {"import", "Make a map package from a point cloud map (PCD, PLY, LAS)"},
    {"export", "Write a map for other programs"},
    {"simulate", "Make a drive in a simulated world, with the truth beside it"},
    {"evaluate", "Measure localization, a map, odometry or a detector against a drive's truth"},
}};

}  // namespace

void add_mapper_commands(CLI::App& app) {
  for (const MapperCommand& command : kMapperCommands) {
    app.add_subcommand(std::string(command.name), std::string(command.description));
  }
}

bool is_mapper_command(const std::string& name) {
  for (const MapperCommand& command : kMapperCommands) {
    if (command.name == name) return true;
  }
  return false;
}

fs::path find_beside(const fs::path& name, const fs::path& installed) {
  const fs::path folder = fs::canonical("/proc/self/exe").parent_path();
  for (const fs::path& candidate : {folder / name, folder.parent_path() / installed}) {
    if (fs::exists(candidate)) return candidate;
  }
  return {};
}

void exec_mapper(char** argv) {
  const fs::path mapper = find_beside("stillmap-mapper", "libexec/stillmap/stillmap-mapper");
  if (mapper.empty()) {
    throw std::runtime_error(
        "stillmap-mapper: found none, expected it beside stillmap or in ../libexec/stillmap");
  }
  ::execv(mapper.c_str(), argv);
  throw std::runtime_error(
      fmt::format("{}: {}", mapper.string(), std::generic_category().message(errno)));
}

}  // namespace stillmap::cli
