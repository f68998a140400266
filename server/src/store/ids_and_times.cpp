#include "ids_and_times.hpp"

#include <charconv>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <string>
#include <system_error>

namespace stillmap::server {

std::optional<std::int64_t> id_in(std::string_view text) {
  std::int64_t id = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  // One spelling for each: no sign, no zeros in front.
  const bool plain = !text.empty() && text.front() >= '1' && text.front() <= '9';
  if (!plain || error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return id;
}

std::optional<std::int64_t> time_in(std::string_view text) {
  if (const auto ns = id_in(text)) return ns;
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  constexpr std::size_t kWholeSeconds = 19;
  const std::string copy(text);
  std::tm parts{};
  const char* const end = ::strptime(copy.c_str(), "%Y-%m-%dT%H:%M:%S", &parts);
  if (end != copy.c_str() + kWholeSeconds || !copy.ends_with('Z')) return std::nullopt;
  // It moves days that no month has.
  const int day = parts.tm_mday;
  const std::time_t seconds = ::timegm(&parts);
  if (parts.tm_mday != day || seconds < 0 || seconds > INT64_MAX / kSecond_ns - 1)
    return std::nullopt;
  std::string_view fraction = std::string_view(copy).substr(kWholeSeconds);
  fraction.remove_suffix(1);
  std::int64_t ns = kSecond_ns * seconds;
  if (fraction.empty()) return ns;
  if (fraction.size() < 2 || fraction.size() > 10 || fraction.front() != '.') return std::nullopt;
  std::int64_t place = kSecond_ns;
  for (const char digit : fraction.substr(1)) {
    if (digit < '0' || digit > '9') return std::nullopt;
    ns += (digit - '0') * (place /= 10);
  }
  return ns;
}

std::int64_t unix_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace stillmap::server
