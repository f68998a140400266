#include "pipeline/boxes_files.hpp"

#include <sstream>
#include <string_view>

namespace stillmap::mapping {

std::vector<std::filesystem::path> boxes_files(const std::string& detector) {
  constexpr std::string_view kBoxes = "boxes:";
  if (!detector.starts_with(kBoxes)) return {};
  std::vector<std::filesystem::path> files;
  std::istringstream list(detector.substr(kBoxes.size()));
  for (std::string file; std::getline(list, file, ',');) files.emplace_back(file);
  return files;
}

}  // namespace stillmap::mapping
