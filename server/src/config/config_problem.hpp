#pragma once

#include <string>

namespace stillmap::server {

/// One thing in the configuration that cannot be used.
struct ConfigProblem {
  /// The file's name, "environment" or "command line".
  std::string source;
  /// Key path, variable or flag; empty when the whole source cannot be read.
  std::string name;
  std::string found;
  std::string expected;

  /// On one line, in the words of every other error.
  [[nodiscard]] std::string text() const;
};

}  // namespace stillmap::server
