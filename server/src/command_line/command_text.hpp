#pragma once

#include <stillmap/maps/geodesy.hpp>

#include <CLI/CLI.hpp>

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::command_line {

/// What `stillmap import` does, for its own help and that of all commands.
inline constexpr const char* kImportDescription =
    "Make a map package from a point cloud map (PCD, PLY, LAS, Autoware)";

/// The call of a subcommand of `evaluate` that was given, quoted for a shell, options in the order
/// of the help.
[[nodiscard]] std::string command_of(const CLI::App& command);

/// The words of a call behind the subcommand's name, as above, each with a space before it.
/// @param except  name of an option that is left out.
[[nodiscard]] std::string words_of(const CLI::App& command, std::string_view except = {});

/// The same as arguments of a program, quoted for no shell. @param except  names left out.
[[nodiscard]] std::vector<std::string> arguments_of(const CLI::App& command,
                                                    const std::vector<std::string>& except);

/// A word of a command as a shell reads it: in quotes where it needs them.
[[nodiscard]] std::string shell_word(const std::string& word);

/// `METRES,DEGREES`. @throws std::invalid_argument naming the option and the text.
[[nodiscard]] std::array<double, 2> metres_and_degrees(const std::string& option,
                                                       const std::string& text);

/// `LATITUDE,LONGITUDE,ALTITUDE` of `--geo-origin`. @throws std::invalid_argument naming the text.
[[nodiscard]] maps::GeodeticOrigin parse_geo_origin(const std::string& text);

/// `32N` of `--utm`. @throws std::invalid_argument naming the text.
[[nodiscard]] maps::UtmZone parse_utm_zone(const std::string& text);

}  // namespace stillmap::command_line
