// A tile of a map package, or a region's node: the first byte says which.
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>

#include <vector>

#include "package/region_node.hpp"
#include "package/tile_bytes.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  if (size == 0) return 0;
  const auto bytes = std::as_bytes(std::span(data + 1, size - 1));
  if (data[0] % 2 == 0) {
    const auto tile =
        fuzz::taken<maps::InputError>([&] { return maps::decode_tile(bytes, "tile"); });
    if (!tile) return 0;
    fuzz::require(tile->history.empty() || tile->history.size() == tile->points.size(),
                  "a history for each point");
    const auto again = maps::decode_tile(maps::encode_tile(*tile), "tile");
    fuzz::require(again.points.size() == tile->points.size(), "as many points as before");
  } else {
    // The region lies in the bytes, which begin at a multiple of 8 in a file.
    const std::vector<std::byte> file(bytes.begin(), bytes.end());
    const auto region =
        fuzz::taken<maps::InputError>([&] { return maps::decode_region(file, "region"); });
    if (!region) return 0;
    const auto again = maps::encode_region(*region);
    fuzz::require(std::equal(again.begin(), again.end(), bytes.begin(), bytes.end()),
                  "equal bytes for an equal region");
  }
  return 0;
}
