#pragma once

#include "support/temporary_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>
#include <string_view>

namespace stillmap::fuzz {

/// A folder in memory, for parsers that take the name of a file.
inline const test::TemporaryFolder& folder() {
  static const test::TemporaryFolder one(test::memory_folder());
  return one;
}

/// Writes a file of it anew; `name` has no folder that is not there. @return its path.
inline std::filesystem::path put(const std::filesystem::path& name, std::string_view text) {
  std::filesystem::path file = folder().path() / name;
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  const bool written = descriptor >= 0 && ::write(descriptor, text.data(), text.size()) ==
                                              static_cast<ssize_t>(text.size());
  if (descriptor >= 0) ::close(descriptor);
  if (!written) throw std::runtime_error("cannot write " + file.string());
  return file;
}

}  // namespace stillmap::fuzz
