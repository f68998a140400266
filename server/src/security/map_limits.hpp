#pragma once

#include "http/http_message.hpp"
#include "http/router.hpp"

#include "store/package_store.hpp"

#include <string_view>

namespace stillmap::server {

/// Whether the caller's key may be used for a map of this name.
[[nodiscard]] bool may_use_map(const Caller& caller, std::string_view map);
/// @throws ApiError kForbidden if not, whether or not there is such a map.
void require_map(const Caller& caller, std::string_view map);
/// Looks at what the path names: a map, or a job, of whose map the caller's key must be. Sessions
/// are found only by the key that opened them. Refuses every other route to a limited key unless
/// it looks itself (`Route::limits_maps`) or is open.
/// @throws ApiError kForbidden; kUnknownJob for a job of another map.
void require_maps_of_path(const HttpRequest& request, const Router::Match& match,
                          PackageStore& store);

}  // namespace stillmap::server
