#pragma once

#include <stillmap/maps/store/job_table.hpp>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// What a rebuild makes. As the store keeps it, equal requests have equal texts.
struct RebuildRequest {
  std::vector<std::int64_t> drives;
  std::optional<std::int64_t> held_back;
  /// Options of the mapper by their flags without dashes, each one of those that it may be given;
  /// none names a file.
  std::map<std::string, std::string> options;
  /// A user's corrections (mapping/README.md), as JSON; empty = none.
  std::string edits;
  /// Empty = named by its day and job.
  std::string version;
  /// When it passes its gate.
  bool activate = false;
  /// It is not brought into the frame of the active version.
  bool new_frame = false;
};

/// A PCD or PLY map that becomes a version.
struct ConvertRequest {
  std::string version;
  /// Of the file.
  std::string sha256;
  /// "pcd", "ply" or "las".
  std::string format;
};

/// Most bytes of a rebuild's JSON: edits are some 200 bytes for each object.
inline constexpr std::size_t kMostRebuildJson = std::size_t{1} << 20U;

/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] RebuildRequest read_rebuild_request(std::string_view json);
[[nodiscard]] std::string to_json(const RebuildRequest& request);
[[nodiscard]] ConvertRequest read_convert_request(std::string_view json);
[[nodiscard]] std::string to_json(const ConvertRequest& request);

/// The version that a job makes: as it asks for, else of the day that it was asked on.
[[nodiscard]] std::string version_of(const maps::StoredJob& job);

}  // namespace stillmap::server
