#pragma once

#include <sys/resource.h>

namespace stillmap::maps {

/// The most memory that this process has had in RAM so far [MiB].
[[nodiscard]] inline double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace stillmap::maps
