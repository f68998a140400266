#pragma once

#include <stillmap/mapping/map_build.hpp>

#include <CLI/CLI.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapper {

/// Options of `build` and `rebuild` as they are typed.
struct BuildArguments {
  std::vector<std::filesystem::path> drives;
  std::string select = "::";
  std::string movable;
  std::string ground_height;
  std::string preset = "default";
  std::string fusion = "on";
  std::string fill = "on";
  std::string loops = "on";
  /// Empty: as the preset has it.
  std::string given_poses;
  std::optional<std::string> pose_sigma;
  /// `auto` or seconds; empty: none.
  std::string pose_time_offset;
  std::string geo_origin;
  mapping::MapBuildOptions options;
};

/// Adds the drives and every option of a map.
void add_build_options(CLI::App& command, BuildArguments& arguments);

/// Fills `arguments.options` from the typed options. The preset comes first, so that an option
/// given beside it wins. @throws std::invalid_argument naming the option.
void resolve_options(BuildArguments& arguments, const CLI::App& command);

/// @param option  that names a folder, needed unless `--estimate` is asked for.
/// @throws std::invalid_argument when it is not given.
void require_unless_estimate(const CLI::App& command, const char* option);

}  // namespace stillmap::mapper
