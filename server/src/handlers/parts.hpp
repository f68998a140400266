#pragma once

#include "handlers/context.hpp"

#include <cstdint>

namespace stillmap::server {

/// As clients see it: what went wrong was said with places of this machine.
[[nodiscard]] StoredDrive shown(const Context& context, StoredDrive drive);

/// Of one that takes parts or can be completed. @throws ApiError kOtherServer when its bytes are in
/// the folder of another server.
void require_here(const Context& context, const StoredDrive& drive);

/// Keeps one part of a drive or of an upload. @param most  bytes of all parts.
/// @throws ApiError for a number that is none, kPayloadTooLarge, kInvalidUpload; StoreRefusal.
[[nodiscard]] HttpResponse put_part(const Context& context, const HttpRequest& request,
                                    const PathParameters& path, const StoredDrive& drive,
                                    std::uint64_t most);

}  // namespace stillmap::server
