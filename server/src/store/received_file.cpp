#include "store/received_file.hpp"

#include <stillmap/maps/error.hpp>

#include <vector>

#include <stillmap/maps/sha256.hpp>
#include "store/durable_files.hpp"

namespace stillmap::server {

std::string receive_file(const ByteSource& source, std::uint64_t bytes,
                         const std::filesystem::path& file, const std::string& name,
                         DiskCalls& calls) {
  DurableFiles::NewFile out = DurableFiles(calls).create(file);
  std::vector<char> buffer(std::size_t{256} << 10U);
  maps::Sha256 hash;
  std::uint64_t received = 0;
  for (std::size_t got = 0; (got = source(buffer)) > 0; received += got) {
    if (got > bytes - received)
      throw maps::InputError(name, "more bytes",
                             std::to_string(bytes) + " as announced: send it again");
    hash.add(buffer.data(), got);
    out.append({buffer.data(), got});
  }
  if (received != bytes)
    throw maps::InputError(name, std::to_string(received) + " bytes",
                           std::to_string(bytes) + " as announced: send it again");
  out.finish();
  return hash.hex();
}

}  // namespace stillmap::server
