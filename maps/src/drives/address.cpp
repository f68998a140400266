#include "drives/address.hpp"

#include <stillmap/maps/drive_address.hpp>

#include <algorithm>
#include <string_view>

namespace stillmap::maps {

DriveAddress split_address(const std::filesystem::path& address) {
  const std::string text = address.string();
  const std::size_t mark = text.rfind('?');
  if (mark == std::string::npos || std::filesystem::exists(address)) return {address, {}};
  return {text.substr(0, mark), text.substr(mark + 1)};
}

Address address_of(const std::filesystem::path& root) {
  const auto [place, words] = split_address(root);
  Address address{place, {}, {}, {}, {}};
  std::string_view rest = words;
  const auto take = [](std::string_view word, std::string_view key, std::string& into) {
    if (!word.starts_with(key) || !into.empty()) return false;
    into = word.substr(key.size());
    return true;
  };
  while (!rest.empty()) {
    const std::string_view word = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(word.size() + 1, rest.size()));
    if (take(word, "sensor=", address.sensor) || take(word, "columns=", address.columns) ||
        take(word, "points=", address.points))
      continue;
    address.words += (address.words.empty() ? "" : "&") + std::string(word);
  }
  return address;
}

}  // namespace stillmap::maps
