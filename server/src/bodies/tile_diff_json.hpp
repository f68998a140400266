#pragma once

#include "catalog/tile_diff.hpp"

#include <stillmap/server/server_options.hpp>

#include <string>
#include <string_view>

namespace stillmap::server {

/// Everything in bounds. @throws ApiError kInvalidRequest, kUnknownParameter, kPayloadTooLarge.
[[nodiscard]] TileDiffRequest read_tile_diff_json(std::string_view text,
                                                  const ServerOptions& options);
[[nodiscard]] std::string tile_diff_json(const TileDiff& diff);

}  // namespace stillmap::server
