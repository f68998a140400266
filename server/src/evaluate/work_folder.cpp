#include "evaluate/work_folder.hpp"

#include <stillmap/maps/error.hpp>

#include <cstdlib>
#include <string>
#include <system_error>
#include <utility>

#include "command_line/run_program.hpp"

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

void WorkFolder::say_when_cancelled() const {
  command_line::WhenCancelled words;
  if (temporary_)
    words.if_not =
        "nothing is kept and the same command starts anew; --work FOLDER keeps what is finished";
  else
    words = command_line::goes_on_from(path_);
  command_line::say_when_cancelled(std::move(words));
}

}  // namespace stillmap::evaluate
