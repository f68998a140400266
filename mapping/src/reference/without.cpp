// What stands where the methods of others are not built (STILLMAP_REFERENCE is off).
#include <stillmap/mapping/reference.hpp>

namespace stillmap::mapping {

std::vector<std::string> reference_cleaner_names() { return {}; }

std::unique_ptr<Cleaner> make_reference_cleaner(const std::string&) { return nullptr; }

std::vector<std::string> map_aligner_names() { return localization::aligner_names(); }

std::unique_ptr<localization::Aligner> make_map_aligner(std::string_view method,
                                                        const maps::MapPackage& map) {
  return localization::make_aligner(method, map);
}

}  // namespace stillmap::mapping
