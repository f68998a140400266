#pragma once

#include <filesystem>
#include <optional>

namespace stillmap::evaluate {

/// A folder to work in: the one that was given, or a temporary one that is removed at the end.
class WorkFolder {
 public:
  /// @throws maps::StorageError when none can be made.
  explicit WorkFolder(const std::optional<std::filesystem::path>& given = std::nullopt);
  ~WorkFolder();
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] bool keep() const { return !temporary_; }
  /// What a cancelled command says of it.
  void say_when_cancelled() const;

 private:
  std::filesystem::path path_;
  bool temporary_ = false;
};

}  // namespace stillmap::evaluate
