#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// A whole regular file as text, without the byte order mark that some editors put before it.
/// @throws StorageError; InputError when it is longer than
/// `most_bytes`.
[[nodiscard]] std::string read_text(const std::filesystem::path& file,
                                    std::uintmax_t most_bytes = UINTMAX_MAX);

/// Fields of a line, parted by blanks, tabs and carriage returns; stops after `limit` of them, so
/// that a line of millions costs no memory.
[[nodiscard]] std::vector<std::string_view> split_fields(std::string_view line,
                                                         std::size_t limit = SIZE_MAX);

/// Cuts the first line off `rest` and returns it without its newline; an empty `rest` gives
/// nothing.
[[nodiscard]] std::optional<std::string_view> take_line(std::string_view& rest);

/// The whole text as a number, `nan` and `inf` included; nothing when it is none or has a tail.
[[nodiscard]] std::optional<double> parse_number(std::string_view text);

/// As `parse_number`, for whole numbers >= 0.
[[nodiscard]] std::optional<std::uint64_t> parse_count(std::string_view text);

/// Decimal seconds, exponent allowed, to nanoseconds: exact to the ninth decimal and rounded there.
/// A double would not do: at an epoch of today its step is 238 ns. @return nothing when not a
/// number or out of int64's range.
[[nodiscard]] std::optional<std::int64_t> parse_stamp_ns(std::string_view text);

/// Numbers of one line of a file, for messages that say where.
struct NumberLine {
  /// From 1.
  std::size_t line = 0;
  std::vector<std::string_view> fields;
};

/// Lines of a table, `#` comments and blank lines left out.
[[nodiscard]] std::vector<NumberLine> number_lines(std::string_view text);

/// "FILE line N" as the messages say it.
[[nodiscard]] std::string place(const std::filesystem::path& file, std::size_t line);

/// The fields as finite doubles. @throws InputError naming file, line and value.
void parse_finite(const std::filesystem::path& file, const NumberLine& line,
                  std::span<double> values);

/// A text of a file for a message: control characters as '?', and "..." for what is beyond `most`
/// bytes, so that the message stays one line whatever the file holds.
[[nodiscard]] std::string one_line(std::string_view text, std::size_t most = 60);
/// `one_line` between single quotes.
[[nodiscard]] std::string quoted(std::string_view text);

/// The name that was probably meant by a mistyped word: one that begins with the word, or the
/// nearest by single letters that are wrong, missing, too many or swapped. Nothing when none is
/// near.
[[nodiscard]] std::optional<std::string> nearest_of(const std::string& word,
                                                    const std::vector<std::string>& names);

}  // namespace stillmap::maps
