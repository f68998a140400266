#pragma once

#include <stillmap/mapping/progress.hpp>

#include <filesystem>
#include <optional>
#include <string>

namespace stillmap::mapper {

/// What a job wrote to a file; empty where there is none.
[[nodiscard]] std::string file_text(const std::filesystem::path& file);
[[nodiscard]] std::optional<int> number_in(const std::filesystem::path& file);
/// The last line that is not empty, of a file that may be long.
[[nodiscard]] std::string last_line_in(const std::filesystem::path& file);

/// The folder of a build's jobs, in the hands of the one process that follows them.
class HeldFolder {
 public:
  /// Waits for a process that follows them, perhaps of a server that was given up.
  /// @throws mapping::Cancelled, maps::StorageError.
  HeldFolder(std::filesystem::path folder, const mapping::CancelFlag& cancel);
  ~HeldFolder();
  HeldFolder(const HeldFolder&) = delete;
  HeldFolder& operator=(const HeldFolder&) = delete;

  /// The file `plan` of the process that was waited for.
  [[nodiscard]] const std::string& plan_of_other() const { return plan_of_other_; }
  /// The folder is removed when this goes.
  void set_done() { is_done_ = true; }

 private:
  [[nodiscard]] bool try_lock();

  std::filesystem::path folder_;
  int descriptor_ = -1;
  std::string plan_of_other_;
  bool is_done_ = false;
};

}  // namespace stillmap::mapper
