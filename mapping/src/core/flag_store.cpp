#include "core/flag_store.hpp"

#include <string>

namespace stillmap::mapping {

void FlagStore::append(const std::vector<bool>& flags) {
  std::string bytes((flags.size() + 7) / 8, '\0');
  for (std::size_t i = 0; i < flags.size(); ++i)
    if (flags[i]) bytes[i / 8] = static_cast<char>(bytes[i / 8] | 1 << i % 8);
  places_.push_back({file_.append(bytes.data(), bytes.size()), flags.size()});
}

std::vector<bool> FlagStore::read(std::size_t scan) const {
  const Place& place = places_.at(scan);
  std::string bytes((place.flags + 7) / 8, '\0');
  file_.read(place.offset, bytes.data(), bytes.size());
  std::vector<bool> flags(place.flags);
  for (std::size_t i = 0; i < flags.size(); ++i) flags[i] = (bytes[i / 8] >> i % 8 & 1) != 0;
  return flags;
}

}  // namespace stillmap::mapping
