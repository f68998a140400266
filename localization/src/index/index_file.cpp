#include "index/index_file.hpp"

#include "index/index_format.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>

#include <fmt/format.h>

namespace stillmap::localization {

namespace fs = std::filesystem;

namespace {

fs::path index_file_of(const fs::path& package, const MapIndexOptions& options,
                       const std::string& part) {
  const std::string text =
      fmt::format("{:a} {} {}", options.finest_voxel_m, options.levels, options.min_points);
  return package / "index" /
         fmt::format("{}-{:08x}-{}.idx", index_format::kFormat,
                     maps::crc32c(std::as_bytes(std::span(text.data(), text.size()))), part);
}

}  // namespace

fs::path root_file_of(const fs::path& package, const MapIndexOptions& options) {
  return index_file_of(package, options, "root");
}

fs::path region_file_of(const fs::path& package, const MapIndexOptions& options,
                        maps::RegionId region) {
  return index_file_of(package, options, fmt::format("{}_{}", region.x, region.y));
}

void publish_file(const fs::path& file, const maps::SectionFile& sections) {
  maps::DerivedFile derived(file);
  sections.write([&](std::span<const std::byte> bytes) { derived.append(bytes); });
  derived.publish();
}

}  // namespace stillmap::localization
