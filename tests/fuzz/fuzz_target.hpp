#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// What the targets share. Each defines libFuzzer's entry, gives the bytes to a parser as the
/// program does, and requires of what the parser takes the bounds that its documentation states.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace stillmap::fuzz {

/// Ends the program: a parser has taken what it says to refuse.
inline void require(bool holds, const char* rule) {
  if (holds) return;
  std::fprintf(stderr, "broken rule: %s\n", rule);
  std::abort();
}

/// @return nothing when the input was refused with one of the documented exceptions; any other one
/// gets through, and ends the program.
template <typename... Refusals, typename Read>
auto taken(Read&& read) -> std::optional<decltype(read())> {
  try {
    return read();
  } catch (const std::exception& error) {
    if ((... || (dynamic_cast<const Refusals*>(&error) != nullptr))) return std::nullopt;
    throw;
  }
}

[[nodiscard]] inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}
[[nodiscard]] inline std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

/// Takes what stands before `separator` off the front of `text`; all of it where there is none.
[[nodiscard]] inline std::string_view take_until(std::string_view& text, char separator) {
  const std::size_t end = text.find(separator);
  const std::string_view front = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  return front;
}

}  // namespace stillmap::fuzz
