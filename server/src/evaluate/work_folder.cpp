#include "evaluate/work_folder.hpp"

#include <stillmap/maps/error.hpp>

#include <cstdlib>
#include <string>
#include <system_error>

namespace stillmap::evaluate {

WorkFolder::WorkFolder(const std::optional<std::filesystem::path>& given) {
  if (given) {
    path_ = *given;
    return;
  }
  std::string name = (std::filesystem::temp_directory_path() / "stillmap-work-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw maps::StorageError(name, "cannot be made");
  path_ = name;
  temporary_ = true;
}

WorkFolder::~WorkFolder() {
  std::error_code ignored;
  if (temporary_) std::filesystem::remove_all(path_, ignored);
}

}  // namespace stillmap::evaluate
