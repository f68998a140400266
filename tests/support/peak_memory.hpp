#pragma once

#include <fstream>
#include <string>

namespace stillmap::test {

/// Most memory of this process that lay in RAM [MiB] since `forget_peak_memory`, files that are
/// mapped included; 0 where the system does not tell.
[[nodiscard]] inline double peak_memory_mib() {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024.0;
  return 0.0;
}

/// Where the system lets it be forgotten (proc(5), clear_refs).
inline void forget_peak_memory() { std::ofstream("/proc/self/clear_refs") << "5" << std::flush; }

}  // namespace stillmap::test
