#pragma once

#include <functional>
#include <vector>

#include "option_table.hpp"

namespace stillmap::server {

/// Finds an option's value among all of them.
using OptionPlace = std::function<OptionField(ServerOptions&)>;

template <typename Value>
[[nodiscard]] OptionPlace at(Value ServerOptions::*member) {
  return [member](ServerOptions& options) -> OptionField { return &(options.*member); };
}

template <typename Group, typename Value>
[[nodiscard]] OptionPlace at(Group ServerOptions::*group, Value Group::*member) {
  return
      [group, member](ServerOptions& options) -> OptionField { return &(options.*group.*member); };
}

inline constexpr double kKiB = 1024.0;
inline constexpr double kMiB = 1024.0 * kKiB;
inline constexpr double kGiB = 1024.0 * kMiB;
/// Beyond it a double, which JSON numbers are for many readers, no longer holds every integer.
inline constexpr double kMostBytes = 9007199254740992.0;
inline constexpr double kDay = 86400.0;

/// Rows of the table, in its order: where the server listens, what it takes at one time, what the
/// store may hold, how rebuilds run and are judged, log and end.
[[nodiscard]] std::vector<Option> listening_options();
[[nodiscard]] std::vector<Option> admission_options();
[[nodiscard]] std::vector<Option> store_options();
[[nodiscard]] std::vector<Option> job_options();
[[nodiscard]] std::vector<Option> running_options();

}  // namespace stillmap::server
