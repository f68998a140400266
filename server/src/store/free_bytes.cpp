#include "store/free_bytes.hpp"

#include <system_error>

namespace stillmap::server {

std::uint64_t free_bytes(const std::filesystem::path& folder) {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  return error ? 0 : space.available;
}

}  // namespace stillmap::server
