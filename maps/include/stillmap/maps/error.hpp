#pragma once

#include <stdexcept>
#include <string>

namespace stillmap::maps {

/// Input that cannot be used: the message names the file, the value found and what was expected.
/// Where that does not say what to do, `expected` ends with it: "3 or more: record a longer drive".
class InputError : public std::runtime_error {
 public:
  /// "FILE: found FOUND, expected EXPECTED"
  InputError(const std::string& file, const std::string& found, const std::string& expected)
      : std::runtime_error(file + ": found " + found + ", expected " + expected) {}
};

/// Disk trouble: cannot open, read or write. The message names the file and the system's reason.
class StorageError : public std::runtime_error {
 public:
  StorageError(const std::string& file, const std::string& reason)
      : std::runtime_error(file + ": " + reason) {}
};

}  // namespace stillmap::maps
