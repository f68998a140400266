#pragma once

#include <stillmap/maps/map_object.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Content of objects.json.
[[nodiscard]] std::string objects_text(const std::vector<MapObject>& objects);
/// Reads it back, every type and range checked.
/// @throws InputError naming file, key, value and what was expected.
[[nodiscard]] std::vector<MapObject> parse_objects(std::string_view text, const std::string& file);

/// From numbers over all drives to those in a file of its drive, and back. @param first_scan  of
/// the drive.
void count_from_drive(MapObject& object, std::size_t first_scan);
void count_over_all(MapObject& object, std::size_t drive, std::size_t first_scan);

}  // namespace stillmap::maps
