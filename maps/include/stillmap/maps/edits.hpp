#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::maps {

enum class EditAction {
  kKeep,    ///< stays in the map, whatever was found there
  kRemove,  ///< goes like an object, whatever was found there
};

/// Scans that an edit is about; all of them unless it says otherwise.
struct EditScope {
  /// Name of a drive's folder.
  std::optional<std::string> drive;
  /// First and last of the drive's own scan numbers; only with a drive.
  std::optional<std::pair<std::size_t, std::size_t>> scans;

  [[nodiscard]] bool holds(const std::string& drive_name, std::size_t scan_index) const;
};

/// An object by what it is and where it stood: numbers of objects change from build to build.
struct EditObject {
  /// Map frame [m].
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  ObjectClass object_class = ObjectClass::kUnknown;
};

/// One correction by a user: of a region or of an object.
struct Edit {
  EditAction action = EditAction::kKeep;
  /// Region; map frame.
  std::optional<Box> box;
  std::optional<EditObject> object;
  EditScope scope;

  /// One line, for reports: "keep car at (3.0, 4.0, 0.5)".
  [[nodiscard]] std::string description() const;
};

using Edits = std::vector<Edit>;

/// Reads corrections that a user made to a map, in the frame of that map:
///
///     {"format": "stillmap-edits", "version": 1, "edits": [
///       {"action": "keep", "object": {"centre": [3, 4, 0.5], "class": "car"}},
///       {"action": "remove", "box": {"centre": [x, y, z], "size": [l, w, h], "yaw": rad},
///        "drive": "2026-11-21_north", "scans": [120, 180], "note": "skip of the builders"}]}
///
/// Each edit has either `box` or `object`; `drive`, `scans` (both ends included, only with `drive`)
/// and `note` (for people) may be left out. A region to keep has at most 10 km a side, one to
/// remove 200 m.
/// @throws InputError naming file, key, found and expected, also for keys that it does not know;
/// StorageError.
[[nodiscard]] Edits read_edits(const std::filesystem::path& file);
/// The same of a text. @param name  what messages call it. @throws InputError.
[[nodiscard]] Edits parse_edits(std::string_view text, const std::string& name);

/// A text without corrections.
inline constexpr std::string_view kNoEdits =
    R"({"edits":[],"format":"stillmap-edits","version":1})";

}  // namespace stillmap::maps
