#pragma once

#include "errors/error_codes.hpp"

#include "store/store_refusal.hpp"

#include <filesystem>

namespace stillmap::server {

/// What the store does not allow, in the words of the interface.
[[nodiscard]] ErrorCode code_of(StoreRefusal::Reason reason);
/// Whether it is that a disk has no room left, or this user may take no more of it.
[[nodiscard]] bool is_disk_full(const std::filesystem::filesystem_error& error);

}  // namespace stillmap::server
