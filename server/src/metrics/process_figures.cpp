#include "metrics/process_figures.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace stillmap::server {
namespace {

/// Fields of /proc/self/stat from the third on (the second may hold spaces), see proc(5).
std::vector<std::string> stat_fields() {
  std::ifstream file("/proc/self/stat");
  std::string line;
  std::getline(file, line);
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return {};
  std::istringstream rest(line.substr(name_end + 1));
  return {std::istream_iterator<std::string>(rest), {}};
}

double boot_unix_s() {
  std::ifstream file("/proc/stat");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("btime ")) return std::stod(line.substr(6));
  }
  return 0.0;
}

double count_open_files() {
  std::error_code error;
  const std::filesystem::directory_iterator entries("/proc/self/fd", error);
  if (error) return 0.0;
  // The folder that is being read is one of them.
  return static_cast<double>(std::distance(begin(entries), end(entries))) - 1.0;
}

}  // namespace

ProcessFigures process_figures() {
  // proc(5) numbers fields from 1, `stat_fields` from the third.
  constexpr std::size_t kUser = 14 - 3, kSystem = 15 - 3, kThreads = 20 - 3, kStart = 22 - 3,
                        kPages = 24 - 3;
  ProcessFigures figures;
  const std::vector<std::string> fields = stat_fields();
  const auto ticks = static_cast<double>(::sysconf(_SC_CLK_TCK));
  if (fields.size() > kPages) {
    figures.cpu_s = (std::stod(fields[kUser]) + std::stod(fields[kSystem])) / ticks;
    figures.threads = std::stod(fields[kThreads]);
    figures.start_unix_s = boot_unix_s() + std::stod(fields[kStart]) / ticks;
    figures.resident_bytes =
        std::stod(fields[kPages]) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  }
  figures.open_files = count_open_files();
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) == 0)
    figures.max_files = static_cast<double>(limit.rlim_cur);
  return figures;
}

}  // namespace stillmap::server
