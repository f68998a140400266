#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::mapping {

/// The folder in which a rebuild remembers what it has done, for as long as its key stays the same.
/// One process at a time.
class RebuildWork {
 public:
  /// @param key  the text of everything that decides what the stages come to, lines "NAME: VALUE".
  /// Work of another key is removed.
  /// @throws maps::InputError for a folder that holds other things than a rebuild's, or that
  /// another process works in; maps::StorageError.
  RebuildWork(std::filesystem::path folder, const std::string& key);
  ~RebuildWork();
  RebuildWork(const RebuildWork&) = delete;
  RebuildWork& operator=(const RebuildWork&) = delete;

  /// Why what was found was thrown away; empty when it was not.
  [[nodiscard]] const std::string& discarded() const { return discarded_; }
  [[nodiscard]] std::filesystem::path path(std::string_view name) const { return folder_ / name; }

  /// What a stage came to; nothing when it is not done.
  [[nodiscard]] std::optional<std::string> remembered(const std::string& stage) const;
  /// On the disk when it returns. @throws maps::StorageError.
  void remember(const std::string& stage, const std::string& text);
  /// So that it is done again.
  void forget(const std::string& stage);
  /// Bytes in it now, as the disk counts them.
  [[nodiscard]] std::uint64_t bytes() const;

 private:
  void clear();
  std::filesystem::path folder_;
  int lock_ = -1;
  std::string discarded_;
};

}  // namespace stillmap::mapping
