#include <stillmap/maps/layer_file.hpp>

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/section_file.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::maps {
namespace {

/// Its header counts the bands.
constexpr SectionFormat kLayer = {
    {'s', 't', 'i', 'l', 'l', 'l', 'y', 'r'}, 2, alignof(float), "a layer of a map"};
constexpr std::uint32_t kMostBands = 16;
constexpr std::uint32_t kMostPerSide = 64;
constexpr std::uint64_t kMostTiles = std::uint64_t{1} << 26U;
constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 31U;

/// What a section holds.
enum LayerSection : std::uint32_t {
  kNames = 1,   ///< BandName, of each band
  kPlaces = 2,  ///< TilePlace, of each tile
  kValues = 3,  ///< float; the part is the number of the band
};

/// In the header.
struct LayerAbout {
  /// Content digest of the map, hex.
  std::array<char, 64> map_digest{};
  std::uint32_t cells_per_side = 0;
};

struct BandName {
  std::array<char, 24> name{}, unit{};
};
struct TilePlace {
  std::int32_t x = 0, y = 0;
};

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

SectionHeader header_of(const std::string& digest, const TileLayer& layer) {
  LayerAbout about{.cells_per_side = static_cast<std::uint32_t>(layer.cells_per_side)};
  if (digest.size() != about.map_digest.size())
    throw std::invalid_argument("layer: a digest of 64 hex digits expected");
  std::copy(digest.begin(), digest.end(), about.map_digest.begin());
  SectionHeader header;
  header.count = static_cast<std::uint32_t>(layer.bands.size());
  header.set_about(about);
  return header;
}

/// The sections of a layer in memory.
class LayerReader {
 public:
  LayerReader(std::span<const std::byte> bytes, const std::string& name)
      : bytes_(bytes), table_(bytes, bytes.size(), kLayer, name) {}

  [[nodiscard]] const SectionTable& table() const { return table_; }
  template <typename Item>
  [[nodiscard]] std::vector<Item> items(LayerSection kind, std::uint32_t part,
                                        std::uint64_t count) const {
    const Section* section = table_.find(kind, part);
    if (section == nullptr || section->item_bytes != sizeof(Item) ||
        section->bytes != count * sizeof(Item))
      table_.refuse("a section of another size", "as many values as it says");
    const auto bytes = bytes_.subspan(section->offset, section->bytes);
    if (crc32c(bytes) != section->crc) table_.refuse("other bytes", "those of its checksum");
    std::vector<Item> items(count);
    std::copy(bytes.begin(), bytes.end(), std::as_writable_bytes(std::span(items)).begin());
    return items;
  }

 private:
  std::span<const std::byte> bytes_;
  SectionTable table_;
};

}  // namespace

void write_layer(const std::filesystem::path& file, const std::string& digest,
                 const TileLayer& layer) {
  std::vector<BandName> names;
  for (const TileLayer::Band& band : layer.bands) {
    if (band.values.size() != layer.tiles.size() * layer.cells_per_tile())
      throw std::invalid_argument("layer: band '" + band.name + "' has another number of values");
    names.push_back({.name = padded<24>(band.name), .unit = padded<24>(band.unit)});
  }
  std::vector<TilePlace> places;
  for (const TileId& tile : layer.tiles) places.push_back({.x = tile.x, .y = tile.y});
  std::vector<SectionPart> parts{
      section_part(kNames, 0, std::as_bytes(std::span(names)), sizeof(BandName)),
      section_part(kPlaces, 0, std::as_bytes(std::span(places)), sizeof(TilePlace))};
  for (std::uint32_t band = 0; band < layer.bands.size(); ++band)
    parts.push_back(section_part(kValues, band, std::as_bytes(std::span(layer.bands[band].values)),
                                 sizeof(float)));
  const SectionFile content(kLayer, header_of(digest, layer), std::move(parts));
  DerivedFile derived(file);
  content.write([&](std::span<const std::byte> bytes) { derived.append(bytes); });
  derived.publish();
}

TileLayer read_layer(const std::filesystem::path& file, const std::string& digest) {
  const std::string content = read_text(file, kMostBytes);
  const LayerReader reader(std::as_bytes(std::span(content)), file.string());
  const SectionTable& table = reader.table();
  const auto about = table.header().read_about<LayerAbout>();
  if (std::string(about.map_digest.data(), about.map_digest.size()) != digest)
    table.refuse("a layer of another map", digest);
  const std::uint32_t bands = table.header().count;
  const Section* places_of = table.find(kPlaces, 0);
  const std::uint64_t tiles = places_of == nullptr ? 0 : places_of->bytes / sizeof(TilePlace);
  if (bands > kMostBands || tiles > kMostTiles || about.cells_per_side < 1 ||
      about.cells_per_side > kMostPerSide)
    table.refuse("more than any layer has", "a layer of a map");
  TileLayer layer{.cells_per_side = about.cells_per_side, .tiles = {}, .bands = {}};
  for (const TilePlace& place : reader.items<TilePlace>(kPlaces, 0, tiles))
    layer.tiles.push_back({.level = 0, .x = place.x, .y = place.y});
  for (const BandName& name : reader.items<BandName>(kNames, 0, bands))
    layer.bands.push_back({.name = text_of(name.name), .unit = text_of(name.unit), .values = {}});
  for (std::uint32_t band = 0; band < bands; ++band)
    layer.bands[band].values =
        reader.items<float>(kValues, band, layer.tiles.size() * layer.cells_per_tile());
  return layer;
}

}  // namespace stillmap::maps
