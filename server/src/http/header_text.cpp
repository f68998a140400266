#include "http/header_text.hpp"

#include <algorithm>
#include <charconv>
#include <system_error>

namespace stillmap::server {

std::string lower(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  return result;
}

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

std::string media_type(std::string_view header) {
  return lower(trimmed(header.substr(0, header.find(';'))));
}

std::string parameter_of(std::string_view header, std::string_view name) {
  std::size_t at = header.find(';');
  while (at != std::string_view::npos) {
    const std::string_view rest = header.substr(at + 1);
    const std::size_t equals = rest.find('=');
    if (equals == std::string_view::npos) return {};
    const std::string key = lower(trimmed(rest.substr(0, equals)));
    std::string_view value = rest.substr(equals + 1);
    std::size_t used = at + 1 + equals + 1;
    if (value.starts_with('"')) {
      const std::size_t closing = value.find('"', 1);
      if (closing == std::string_view::npos) return {};
      value = value.substr(1, closing - 1);
      used += closing + 1;
    } else {
      value = value.substr(0, value.find(';'));
      used += value.size();
      value = trimmed(value);
    }
    if (key == name) return std::string(value);
    at = header.find(';', used);
  }
  return {};
}

double weight_of(std::string_view item) {
  const std::string text = parameter_of(item, "q");
  if (text.empty()) return 1.0;
  double weight = 0.0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), weight);
  // Also what is no number.
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || !(weight >= 0.0))
    return 0.0;
  return std::min(weight, 1.0);
}

bool takes_gzip(std::string_view accept_encoding) {
  for (std::size_t begin = 0; begin < accept_encoding.size();) {
    const std::size_t end = std::min(accept_encoding.find(',', begin), accept_encoding.size());
    const std::string_view item = accept_encoding.substr(begin, end - begin);
    if (media_type(item) == "gzip") return weight_of(item) > 0.0;
    begin = end + 1;
  }
  return false;
}

}  // namespace stillmap::server
