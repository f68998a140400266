#pragma once

#include <fmt/format.h>

#include <set>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Adds a sentence to `broken` for every value that stands in a list again.
template <typename Value>
void require_once(const char* name, const std::vector<Value>& values,
                  std::vector<std::string>& broken) {
  std::set<Value> seen;
  for (const Value& value : values) {
    if (!seen.insert(value).second)
      broken.push_back(fmt::format("{}: {} twice, once", name, value));
  }
}

}  // namespace stillmap::mapping
