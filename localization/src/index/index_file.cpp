#include "index/index_file.hpp"

#include "index/index_format.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>

#include <fmt/format.h>

#include <string>

namespace stillmap::localization {

namespace fs = std::filesystem;

fs::path index_file_of(const fs::path& package, const MapIndexOptions& options) {
  const std::string text =
      fmt::format("{:a} {} {}", options.finest_voxel_m, options.levels, options.min_points);
  return package / "index" /
         fmt::format("{}-{:08x}.idx", index_format::kFormat,
                     maps::crc32c(std::as_bytes(std::span(text.data(), text.size()))));
}

void publish_file(const fs::path& file, std::span<const std::byte> bytes) {
  maps::DerivedFile derived(file);
  derived.append(bytes);
  derived.publish();
}

}  // namespace stillmap::localization
