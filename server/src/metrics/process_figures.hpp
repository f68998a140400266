#pragma once

namespace stillmap::server {

/// What the kernel says of this process. @note Linux only: read from /proc.
struct ProcessFigures {
  double cpu_s = 0.0;
  double resident_bytes = 0.0;
  double open_files = 0.0;
  double max_files = 0.0;
  double threads = 0.0;
  /// Since 1970, UTC.
  double start_unix_s = 0.0;
};

/// A figure that cannot be read is 0: watching must not fail what is watched.
[[nodiscard]] ProcessFigures process_figures();

}  // namespace stillmap::server
