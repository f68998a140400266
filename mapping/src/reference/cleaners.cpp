#include <stillmap/mapping/reference.hpp>

#include "reference/dufomap.hpp"
#include "reference/erasor.hpp"
#include "reference/octomap_cleaner.hpp"
#include "reference/removert.hpp"

#include <array>

namespace stillmap::mapping {
namespace {

template <typename Method>
std::unique_ptr<Cleaner> make_method() {
  return std::make_unique<Method>();
}

struct CleanerEntry {
  const char* name;
  std::unique_ptr<Cleaner> (*make)();
};

constexpr std::array kCleaners{
    CleanerEntry{"removert", make_method<Removert>},
    CleanerEntry{"erasor", make_method<Erasor>},
    CleanerEntry{"octomap", make_method<OctomapCleaner>},
    CleanerEntry{"dufomap", make_method<DufomapCleaner>},
};

}  // namespace

std::vector<std::string> reference_cleaner_names() {
  std::vector<std::string> names;
  for (const CleanerEntry& reference : kCleaners) names.emplace_back(reference.name);
  return names;
}

std::unique_ptr<Cleaner> make_reference_cleaner(const std::string& name) {
  for (const CleanerEntry& reference : kCleaners) {
    if (name == reference.name) return reference.make();
  }
  return nullptr;
}

}  // namespace stillmap::mapping
