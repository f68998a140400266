#include "catalog/rollout_group.hpp"

#include <stillmap/maps/map_package.hpp>

#include "store/key_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

namespace stillmap::server {
namespace {

/// In [0, 1), even.
double fraction_of(const std::string& text) {
  // So many bits as a double holds.
  constexpr std::size_t kDigits = 13;
  const std::uint64_t bits = std::stoull(maps::sha256_of(text).substr(0, kDigits), nullptr, 16);
  return std::ldexp(static_cast<double>(bits), -4 * static_cast<int>(kDigits));
}

}  // namespace

bool is_in_group(const Rollout& rollout, std::string_view label) {
  if (label.empty()) return false;
  const bool is_named =
      std::any_of(rollout.vehicles.begin(), rollout.vehicles.end(),
                  [&](const std::string& pattern) { return matches_pattern(label, pattern); });
  return is_named || fraction_of(std::string(label) + "\n" + rollout.map + "\n" + rollout.version) <
                         rollout.share;
}

}  // namespace stillmap::server
