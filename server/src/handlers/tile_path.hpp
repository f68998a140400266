#pragma once

#include "errors/api_error.hpp"
#include "http/router.hpp"

#include <stillmap/maps/map_package.hpp>

#include <charconv>
#include <string>

namespace stillmap::server {

/// A part of a path that is a number. @throws ApiError kUnknownTile for anything else.
template <typename Integer>
[[nodiscard]] Integer read_coordinate(const PathParameters& path, const char* name) {
  const std::string& text = path.at(name);
  Integer value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  // "007" and "7" would be two addresses of one tile.
  if (error != std::errc{} || end != text.data() + text.size() || std::to_string(value) != text) {
    throw ApiError(ErrorCode::kUnknownTile,
                   std::string(name) + ": found '" + text + "', expected an integer");
  }
  return value;
}

[[nodiscard]] inline maps::TileId read_tile_id(const PathParameters& path) {
  return {.level = read_coordinate<std::uint32_t>(path, "level"),
          .x = read_coordinate<std::int32_t>(path, "x"),
          .y = read_coordinate<std::int32_t>(path, "y")};
}

}  // namespace stillmap::server
