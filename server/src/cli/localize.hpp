#pragma once

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Geometry>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "command_line/result_output.hpp"

namespace stillmap::cli {

struct LocalizeArguments {
  std::filesystem::path map;
  /// A scan or a drive.
  std::filesystem::path what;
  std::string prior;
  std::string method = localization::aligner_names().front();
  std::string select;
  /// Boxes of movable objects, by scan.
  std::optional<std::filesystem::path> boxes;
  std::optional<std::filesystem::path> output;
  command_line::JsonOutput json;
};

/// What both forms of the command work with.
struct OpenMap {
  std::string name;
  std::string digest;
  std::shared_ptr<const localization::Aligner> aligner;
};
[[nodiscard]] OpenMap open_map(const LocalizeArguments& arguments);

/// Follows a whole drive through the map, as one session.
/// @param T_map_prior  of the first scan; none = it is looked for everywhere.
void localize_drive(const LocalizeArguments& arguments,
                    const std::optional<Eigen::Isometry3d>& T_map_prior);

}  // namespace stillmap::cli
