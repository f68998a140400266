#include "drives/address.hpp"

#include <algorithm>
#include <string_view>

namespace stillmap::maps {

Address address_of(const std::filesystem::path& root) {
  constexpr std::string_view kSensor = "sensor=", kPoints = "points=";
  const std::string text = root.string();
  const std::size_t mark = text.rfind('?');
  if (mark == std::string::npos || std::filesystem::exists(root)) return {root, {}, {}, {}};
  Address address{text.substr(0, mark), {}, {}, {}};
  std::string_view rest = std::string_view(text).substr(mark + 1);
  while (!rest.empty()) {
    const std::string_view word = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(word.size() + 1, rest.size()));
    if (word.starts_with(kSensor) && address.sensor.empty()) {
      address.sensor = word.substr(kSensor.size());
    } else if (word.starts_with(kPoints) && address.points.empty()) {
      address.points = word.substr(kPoints.size());
    } else {
      address.words += (address.words.empty() ? "" : "&") + std::string(word);
    }
  }
  return address;
}

}  // namespace stillmap::maps
