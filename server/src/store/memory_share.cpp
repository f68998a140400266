#include "store/memory_share.hpp"

#include <stillmap/maps/usable_memory.hpp>

namespace stillmap::server {

std::uint64_t share_of_memory(std::uint64_t parts) {
  static const std::uint64_t bytes = maps::usable_memory_bytes();
  return bytes / parts;
}

}  // namespace stillmap::server
