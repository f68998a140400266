#include <stillmap/maps/layer_file.hpp>

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>

#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <span>
#include <stdexcept>
#include <vector>

namespace stillmap::maps {
namespace {

static_assert(std::endian::native == std::endian::little, "a layer is little endian as it lies");

constexpr std::array<char, 8> kLayerMagic = {'s', 't', 'i', 'l', 'l', 'l', 'y', 'r'};
/// Counts up whenever a reader, or the same map's values, would differ.
constexpr std::uint32_t kLayerFormat = 1;
constexpr std::uint32_t kMostBands = 16;
constexpr std::uint32_t kMostPerSide = 64;
constexpr std::uint64_t kMostTiles = std::uint64_t{1} << 26U;

struct LayerHeader {
  std::array<char, 8> magic = kLayerMagic;
  std::uint32_t format = kLayerFormat;
  std::uint32_t cells_per_side = 0;
  std::uint64_t tiles = 0;
  std::uint32_t bands = 0;
  /// CRC-32C of header, this field taken as 0, and all that follows.
  std::uint32_t crc = 0;
  /// Content digest of the map, hex.
  std::array<char, 64> map_digest{};
};
static_assert(sizeof(LayerHeader) == 96);

struct BandName {
  std::array<char, 24> name{}, unit{};
};
struct TilePlace {
  std::int32_t x = 0, y = 0;
};

template <typename T>
std::span<const std::byte> bytes_of(const T& value) {
  return std::as_bytes(std::span(&value, 1));
}

template <std::size_t N>
std::array<char, N> padded(const std::string& text) {
  std::array<char, N> array{};
  if (text.size() >= N) throw std::invalid_argument("layer: the name '" + text + "' is too long");
  std::memcpy(array.data(), text.data(), text.size());
  return array;
}

template <std::size_t N>
std::string text_of(const std::array<char, N>& array) {
  return {array.data(), ::strnlen(array.data(), N)};
}

LayerHeader header_of(const std::string& digest, const TileLayer& layer) {
  LayerHeader header;
  header.cells_per_side = static_cast<std::uint32_t>(layer.cells_per_side);
  header.tiles = layer.tiles.size();
  header.bands = static_cast<std::uint32_t>(layer.bands.size());
  if (digest.size() != header.map_digest.size())
    throw std::invalid_argument("layer: a digest of 64 hex digits expected");
  std::memcpy(header.map_digest.data(), digest.data(), digest.size());
  return header;
}

/// All that follows the header.
std::vector<std::byte> body_of(const TileLayer& layer) {
  std::vector<std::byte> body;
  const auto add = [&](std::span<const std::byte> bytes) {
    body.insert(body.end(), bytes.begin(), bytes.end());
  };
  for (const TileLayer::Band& band : layer.bands) {
    if (band.values.size() != layer.tiles.size() * layer.cells_per_tile())
      throw std::invalid_argument("layer: band '" + band.name + "' has another number of values");
    add(bytes_of(BandName{.name = padded<24>(band.name), .unit = padded<24>(band.unit)}));
  }
  for (const TileId& tile : layer.tiles) add(bytes_of(TilePlace{.x = tile.x, .y = tile.y}));
  for (const TileLayer::Band& band : layer.bands) add(std::as_bytes(std::span(band.values)));
  return body;
}

std::vector<std::byte> content_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) throw StorageError(file.string(), std::strerror(errno));
  const std::streamoff size = in.tellg();
  constexpr std::streamoff kMost = std::streamoff{1} << 31U;
  if (size < static_cast<std::streamoff>(sizeof(LayerHeader)) || size > kMost)
    throw InputError(file.string(), std::to_string(size) + " bytes", "a layer of a map");
  std::vector<std::byte> content(static_cast<std::size_t>(size));
  in.seekg(0);
  if (!in.read(reinterpret_cast<char*>(content.data()), size))
    throw StorageError(file.string(), "cannot be read");
  return content;
}

/// @throws InputError for what is not this map's layer, whole and of this format.
LayerHeader checked_header(std::span<const std::byte> content, const std::string& digest,
                           const std::string& name) {
  LayerHeader header;
  std::memcpy(&header, content.data(), sizeof(header));
  if (header.magic != kLayerMagic) throw InputError(name, "other bytes", "a layer of a map");
  if (header.format != kLayerFormat)
    throw InputError(name, "format " + std::to_string(header.format), std::to_string(kLayerFormat));
  LayerHeader without_crc = header;
  without_crc.crc = 0;
  if (crc32c(content.subspan(sizeof(header)), crc32c(bytes_of(without_crc))) != header.crc)
    throw InputError(name, "other bytes", "those of its checksum");
  if (std::string(header.map_digest.data(), header.map_digest.size()) != digest)
    throw InputError(name, "a layer of another map", digest);
  const bool fits = header.bands <= kMostBands && header.tiles <= kMostTiles &&
                    header.cells_per_side >= 1 && header.cells_per_side <= kMostPerSide;
  const std::uint64_t cells = std::uint64_t{header.cells_per_side} * header.cells_per_side;
  if (!fits || content.size() != sizeof(LayerHeader) + header.bands * sizeof(BandName) +
                                     header.tiles * sizeof(TilePlace) +
                                     header.bands * header.tiles * cells * sizeof(float))
    throw InputError(name, std::to_string(content.size()) + " bytes", "as many as it says");
  return header;
}

}  // namespace

void write_layer(const std::filesystem::path& file, const std::string& digest,
                 const TileLayer& layer) {
  LayerHeader header = header_of(digest, layer);
  const std::vector<std::byte> body = body_of(layer);
  header.crc = crc32c(body, crc32c(bytes_of(header)));
  DerivedFile derived(file);
  derived.append(bytes_of(header));
  derived.append(body);
  derived.publish();
}

TileLayer read_layer(const std::filesystem::path& file, const std::string& digest) {
  const std::vector<std::byte> content = content_of(file);
  const LayerHeader header = checked_header(content, digest, file.string());
  TileLayer layer{.cells_per_side = header.cells_per_side, .tiles = {}, .bands = {}};
  std::size_t at = sizeof(LayerHeader);
  const auto take = [&](void* to, std::size_t size) {
    std::memcpy(to, content.data() + at, size);
    at += size;
  };
  for (std::uint32_t i = 0; i < header.bands; ++i) {
    BandName name;
    take(&name, sizeof(name));
    layer.bands.push_back({.name = text_of(name.name), .unit = text_of(name.unit), .values = {}});
  }
  for (std::uint64_t i = 0; i < header.tiles; ++i) {
    TilePlace place;
    take(&place, sizeof(place));
    layer.tiles.push_back({.level = 0, .x = place.x, .y = place.y});
  }
  for (TileLayer::Band& band : layer.bands) {
    band.values.resize(layer.tiles.size() * layer.cells_per_tile());
    if (!band.values.empty()) take(band.values.data(), band.values.size() * sizeof(float));
  }
  return layer;
}

}  // namespace stillmap::maps
