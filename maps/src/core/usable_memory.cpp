#include <stillmap/maps/usable_memory.hpp>

#include <unistd.h>

#include <algorithm>
#include <fstream>

namespace stillmap::maps {

std::uint64_t usable_memory_bytes() {
  std::uint64_t bytes = static_cast<std::uint64_t>(std::max(0L, ::sysconf(_SC_PHYS_PAGES))) *
                        static_cast<std::uint64_t>(std::max(0L, ::sysconf(_SC_PAGESIZE)));
  // Version 2, then 1; "max" is no number.
  for (const char* file :
       {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::uint64_t most = 0;
    if (std::ifstream(file) >> most) bytes = std::min(bytes, most);
  }
  return bytes;
}

}  // namespace stillmap::maps
