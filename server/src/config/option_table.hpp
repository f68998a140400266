#pragma once

#include <stillmap/server/server_options.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace stillmap::server {

/// Where a value stands in `ServerOptions`.
using OptionField = std::variant<bool*, int*, std::int64_t*, std::size_t*, double*, std::string*>;
/// A value on its way there, from wherever it came.
using OptionValue = std::variant<bool, std::int64_t, double, std::string>;

enum class OptionKind { kFlag, kInteger, kReal, kText, kChoice };

/// One option of `stillmap serve`. Flag, environment variable, key of the configuration file,
/// schema and reference page all come from here.
struct Option {
  /// The path of the field in `ServerOptions`.
  std::string_view key;
  std::function<OptionField(ServerOptions&)> field;
  /// What a number must stay within, both included.
  double least = 0.0;
  double most = 0.0;
  std::string_view unit = {};
  /// One sentence for users.
  std::string_view text;
  /// Whether SIGHUP changes it in the running server.
  bool reloadable = false;
  /// The words that are allowed; empty when any text is.
  std::vector<std::string_view> choices = {};

  [[nodiscard]] OptionKind kind() const;
  /// `--sessions-idle-expiry-s`.
  [[nodiscard]] std::string flag() const;
  /// `STILLMAP_SERVE_SESSIONS_IDLE_EXPIRY_S`.
  [[nodiscard]] std::string variable() const;
  /// What it takes, for an error: "an integer in [1, 86400]".
  [[nodiscard]] std::string expected() const;
  [[nodiscard]] OptionValue get(const ServerOptions& options) const;
  /// @return false, with `options` as they were, when the value is of another kind or out of
  /// bounds.
  [[nodiscard]] bool set(ServerOptions& options, const OptionValue& value) const;
};

/// Of one text: what a path may be on Linux.
inline constexpr std::size_t kMostTextBytes = 4096;

/// `STILLMAP_SERVICE_HOST` and `STILLMAP_PORT=tcp://...` are what Kubernetes sets in every
/// container beside a service called stillmap, so a shorter prefix would be spoilt there.
inline constexpr std::string_view kVariablePrefix = "STILLMAP_SERVE_";

[[nodiscard]] std::span<const Option> all_options();
/// nullptr when there is none of that key.
[[nodiscard]] const Option* find_option(std::string_view key);

/// A flag's or variable's text as a value of the option's kind; nothing when it is none.
[[nodiscard]] std::optional<OptionValue> read_value(const Option& option, std::string_view text);

/// One option that cannot be used as it stands.
struct BrokenOption {
  std::string key;
  /// The option that it does not go together with; empty when it is wrong by itself.
  std::string other;
  std::string found;
  std::string expected;
};
/// Bounds of each option, and of options between each other.
[[nodiscard]] std::vector<BrokenOption> broken_options(const ServerOptions& options);

}  // namespace stillmap::server
