#pragma once

#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>

namespace stillmap::mapping {

/// Pieces of HTML that reports share. Text is not escaped.

/// "98.25 %", or a dash for NaN.
[[nodiscard]] std::string percent_text(double rate, int digits = 2);

/// 1234567 -> "1 234 567", with spaces that do not break.
[[nodiscard]] std::string grouped_text(std::size_t number);

/// The value, or a dash where it is not finite.
[[nodiscard]] std::string number_text(double value, int digits);

/// A name behind its colour, as in a legend.
[[nodiscard]] std::string key_of_style(std::string_view style, std::string_view name);

/// How much longer than its largest value an axis is, so that bars and whiskers do not end on the
/// frame.
inline constexpr double kHeadroom = 1.08;

/// A row of a table; `tag` is `td` or `th`.
[[nodiscard]] std::string row_of(std::initializer_list<std::string> cells,
                                 std::string_view tag = "td");

/// A figure in large letters with its name.
[[nodiscard]] std::string tile_of(const std::string& value, std::string_view name);

/// A PNG file as part of the page.
[[nodiscard]] std::string picture_of(const std::string& png, std::string_view caption);

}  // namespace stillmap::mapping
