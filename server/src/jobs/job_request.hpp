#pragma once

#include "store/job_table.hpp"

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
  /// Where its corrections come from.
  enum class EditsFrom : std::uint8_t {
    kNone,
    kRequest,
    kSaved,  ///< those that are kept for the map, as of when it was asked for
  };
  EditsFrom edits_from = EditsFrom::kNone;
  /// Corrections (`maps::parse_edits`); empty = none, or, as long as nobody has looked, those
  /// saved.
  std::string edits;
  /// Empty = named by its day and job.
  std::string version;
  /// When it passes its gate.
  bool activate = false;
  /// It is not brought into the frame of the active version.
  bool new_frame = false;
  /// All of the active version stays but the tiles that the drives saw.
  bool patch = false;
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
/// Of corrections, and so of a rebuild that brings some.
inline constexpr std::size_t kMostEditValues = 300'000;

/// Without `options.edits` they are to come from those saved.
/// @throws ApiError with the path of what is wrong; unknown keys are refused.
[[nodiscard]] RebuildRequest read_rebuild_request(std::string_view json);
/// As it was asked.
[[nodiscard]] std::string to_json(const RebuildRequest& request);
/// Whether those saved for the map can be used: not without fusion, nor in another frame.
[[nodiscard]] bool takes_saved_edits(const RebuildRequest& request);
/// As a job keeps it, with its corrections and where they come from.
[[nodiscard]] std::string to_stored_json(const RebuildRequest& request);
/// What `to_stored_json` wrote.
[[nodiscard]] RebuildRequest read_stored_rebuild(std::string_view json);
/// "none", "request", "saved".
[[nodiscard]] std::string_view name_of(RebuildRequest::EditsFrom from);
[[nodiscard]] ConvertRequest read_convert_request(std::string_view json);
[[nodiscard]] std::string to_json(const ConvertRequest& request);

/// The version that a job makes: as it asks for, else of the day that it was asked on.
[[nodiscard]] std::string version_of(const StoredJob& job);

}  // namespace stillmap::server
