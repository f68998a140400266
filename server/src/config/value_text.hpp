#pragma once

#include "option_table.hpp"

#include <string>
#include <string_view>

namespace stillmap::server {

/// As JSON, on one line and in ASCII; text that is no UTF-8 with replacement characters.
[[nodiscard]] std::string value_text(const OptionValue& value);
/// A stranger's text for an error: as JSON, on one line, in ASCII, its end left out when it is
/// long.
[[nodiscard]] std::string shown_text(std::string_view text);

}  // namespace stillmap::server
