#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace stillmap::mapping {

/// JSON text whose objects name no key twice and that nests at most 8 deep: a reader that keeps the
/// last of two equal keys would show its user another network than the one a careful eye reads.
/// @param name what the text is, for messages. @throws maps::InputError naming it and the mistake.
[[nodiscard]] nlohmann::json parse_strict_json(std::string_view text, const std::string& name);

/// A text of a file in quotes, at most 60 characters, without control characters: messages stay one
/// line whatever the file holds.
[[nodiscard]] std::string in_quotes(std::string_view text);
/// A scalar as it stands in the file (shortened as by `in_quotes`), or what an array or object is.
[[nodiscard]] std::string described(const nlohmann::json& value);

}  // namespace stillmap::mapping
