#pragma once

#include "derived/derived_worker.hpp"

#include <filesystem>
#include <string>

namespace stillmap::server {

/// @param what   is made, as "the tileset". @param store  the folder that messages do not name.
/// @throws ApiError kBusy when too much waits, kDerivedUnavailable when it has just failed; both
/// with Retry-After.
void require_under_way(const DerivedWorker::Answer& answer, const std::string& what,
                       const std::filesystem::path& store);
/// The same, else @throws ApiError kBeingMade, with Retry-After.
[[noreturn]] void refuse_until_made(const DerivedWorker::Answer& answer, const std::string& what,
                                    const std::filesystem::path& store);

}  // namespace stillmap::server
