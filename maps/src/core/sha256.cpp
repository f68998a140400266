#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "core/sha256.hpp"

namespace stillmap::maps {

std::string sha256_of(std::string_view bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.hex();
}

std::string sha256_of_file(const std::filesystem::path& file) {
  struct Closer {
    int descriptor;
    ~Closer() { ::close(descriptor); }
  };
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) throw StorageError(file.string(), std::strerror(errno));
  const Closer closer{descriptor};
  Sha256 hash;
  std::vector<char> buffer(std::size_t{1} << 20U);
  while (true) {
    const ssize_t got = ::read(descriptor, buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw StorageError(file.string(), std::strerror(errno));
    if (got == 0) return hash.hex();
    hash.add(buffer.data(), static_cast<std::size_t>(got));
  }
}

}  // namespace stillmap::maps
