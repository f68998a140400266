#pragma once

#include "catalog/map_catalog.hpp"
#include "http/http_message.hpp"

#include <stillmap/maps/map_package.hpp>

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Of what never changes: for who asked, and for no cache that several share, which would give it
/// to who has no key (RFC 9111, section 3.5).
inline constexpr const char* kKeptForEver = "private, max-age=31536000, immutable";

/// What never changes, under its tag: 304 to who has it, else what `fill` adds to the answer.
[[nodiscard]] HttpResponse immutable_answer(const HttpRequest& request, const std::string& etag,
                                            const std::function<void(HttpResponse&)>& fill);

/// Of a tile of a version. @param form  tells apart what a tile is served as.
[[nodiscard]] std::string tile_etag(const ServedVersion& version, std::string_view form,
                                    maps::TileId id);
/// Whether a tile from level 1 on has any tile of level 0 below it.
[[nodiscard]] bool lies_above_points(const maps::MapPackage& package, maps::TileId id);

/// The points as a binary glTF, sent without a copy of them. @param tile  of these points, which
/// count from its corner.
void fill_with_glb(HttpResponse& response, const maps::TileEntry& tile,
                   std::vector<maps::MapPoint> points);

}  // namespace stillmap::server
