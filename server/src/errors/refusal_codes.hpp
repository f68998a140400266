#pragma once

#include "errors/error_codes.hpp"

#include <stillmap/maps/store/store_refusal.hpp>

namespace stillmap::server {

/// What the store does not allow, in the words of the interface.
[[nodiscard]] ErrorCode code_of(maps::StoreRefusal::Reason reason);

}  // namespace stillmap::server
