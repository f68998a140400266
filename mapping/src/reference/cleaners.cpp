#include "reference/cleaners.hpp"

#include "reference/dufomap.hpp"
#include "reference/erasor.hpp"
#include "reference/octomap_cleaner.hpp"
#include "reference/removert.hpp"

#include <array>

namespace stillmap::mapping {
namespace {

class NoCleaner : public Cleaner {
 public:
  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points, const ScanSource&,
                                                const ProgressCallback&,
                                                const CancelFlag&) const override {
    return std::vector<std::uint8_t>(points.positions.size(), 0);
  }
};

template <typename Method>
std::unique_ptr<Cleaner> make() {
  return std::make_unique<Method>();
}

struct Reference {
  const char* name;
  std::unique_ptr<Cleaner> (*make)();
};

constexpr std::array kReferences{
    Reference{"none", make<NoCleaner>},         Reference{"removert", make<Removert>},
    Reference{"erasor", make<Erasor>},          Reference{"octomap", make<OctomapCleaner>},
    Reference{"dufomap", make<DufomapCleaner>},
};

}  // namespace

std::vector<std::string> reference_cleaner_names() {
  std::vector<std::string> names;
  for (const Reference& reference : kReferences) names.emplace_back(reference.name);
  return names;
}

std::unique_ptr<Cleaner> make_reference_cleaner(const std::string& name) {
  for (const Reference& reference : kReferences) {
    if (name == reference.name) return reference.make();
  }
  return nullptr;
}

}  // namespace stillmap::mapping
