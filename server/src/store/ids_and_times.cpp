#include "ids_and_times.hpp"

#include <openssl/crypto.h>
#include <openssl/rand.h>

#include <charconv>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

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

std::string random_hex(std::size_t digits) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::vector<unsigned char> bytes((digits + 1) / 2);
  if (RAND_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1)
    throw std::runtime_error("there is no randomness: look at the machine's /dev/urandom");
  std::string text;
  for (const unsigned char byte : bytes) text += {kDigits[byte >> 4U], kDigits[byte & 15U]};
  OPENSSL_cleanse(bytes.data(), bytes.size());
  text.resize(digits);
  return text;
}

}  // namespace stillmap::server
