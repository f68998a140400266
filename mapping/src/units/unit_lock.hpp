#pragma once

#include <filesystem>
#include <string>

namespace stillmap::mapping {

/// The right to do a unit, and a folder for what it does not keep in memory. It ends with the
/// process, however that ends.
class UnitLock {
 public:
  /// @param folder  of the units of a build; made if missing. @param unit  its name.
  /// @throws maps::InputError when another process does the unit; maps::StorageError.
  UnitLock(const std::filesystem::path& folder, const std::string& unit);
  ~UnitLock();
  UnitLock(const UnitLock&) = delete;
  UnitLock& operator=(const UnitLock&) = delete;

  /// Empty at the beginning; removed at the end.
  [[nodiscard]] const std::filesystem::path& scratch() const { return scratch_; }

 private:
  std::filesystem::path scratch_;
  int descriptor_ = -1;
};

}  // namespace stillmap::mapping
