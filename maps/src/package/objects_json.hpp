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

}  // namespace stillmap::maps
