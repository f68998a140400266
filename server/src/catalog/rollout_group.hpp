#pragma once

#include "store/rollout_table.hpp"

#include <string_view>

namespace stillmap::server {

/// Whether a vehicle gets the version of a roll-out: when a pattern names it, or when the SHA-256
/// of its label, the map and the version, as a fraction, is below the share. So the same vehicles
/// are in it on all servers and after restarts, and those that are in it stay when the share grows.
/// @param label  empty: in no group.
[[nodiscard]] bool is_in_group(const Rollout& rollout, std::string_view label);

}  // namespace stillmap::server
