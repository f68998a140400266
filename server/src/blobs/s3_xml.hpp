#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// What is between `<name>` and `</name>` for the first time, its entities decoded; nothing when it
/// is not there. For answers of S3, whose elements that we read have no attributes.
[[nodiscard]] std::optional<std::string> xml_text(std::string_view xml, std::string_view name);

/// What is between each `<name>` and `</name>`, as it is.
[[nodiscard]] std::vector<std::string_view> xml_elements(std::string_view xml,
                                                         std::string_view name);

/// With entities in place of what is special.
[[nodiscard]] std::string xml_escaped(std::string_view text);

}  // namespace stillmap::server
