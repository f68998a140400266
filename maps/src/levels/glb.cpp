#include <stillmap/maps/glb.hpp>

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>

namespace stillmap::maps {
namespace {

static_assert(std::endian::native == std::endian::little, "a GLB is little endian");
static_assert(offsetof(MapPoint, intensity) == 12 && offsetof(MapPoint, observations) == 16 &&
                  offsetof(MapPoint, object) == 19,
              "as the accessors say");

constexpr std::uint32_t kGltfMagic = 0x46546C67;    // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;    // "JSON"
constexpr std::uint32_t kBinaryChunk = 0x004E4942;  // "BIN"

void put(std::string& bytes, std::uint32_t value) {
  const auto raw = std::bit_cast<std::array<char, sizeof(value)>>(value);
  bytes.append(raw.data(), raw.size());
}

/// As the floats of the points, with all their digits, so that a reader of doubles has the same.
std::string bound(const Eigen::Vector3d& xyz) {
  const Eigen::Vector3d floats = xyz.cast<float>().cast<double>();
  return fmt::format("{},{},{}", floats.x(), floats.y(), floats.z());
}

std::string json_of(const TileEntry& tile, std::uint64_t bytes) {
  const Eigen::Vector3d corner = corner_of(tile.id);
  const Eigen::AlignedBox3d box = tile.from_origin().translated(-corner);
  return fmt::format(
      R"({{"asset":{{"version":"2.0","generator":"stillmap"}},"scene":0,"scenes":[{{"nodes":[0]}}],)"
      R"("nodes":[{{"mesh":0,"matrix":[1,0,0,0,0,0,-1,0,0,1,0,0,{4},{5},{6},1]}}],)"
      R"("meshes":[{{"primitives":[{{"mode":0,"attributes":{{"POSITION":0,"_INTENSITY":1,"_POINT":2}}}}]}}],)"
      R"("buffers":[{{"byteLength":{0}}}],)"
      R"("bufferViews":[{{"buffer":0,"byteLength":{0},"byteStride":20,"target":34962}}],)"
      R"("accessors":[{{"bufferView":0,"componentType":5126,"count":{1},"type":"VEC3","min":[{2}],"max":[{3}]}},)"
      R"({{"bufferView":0,"byteOffset":12,"componentType":5126,"count":{1},"type":"SCALAR"}},)"
      R"({{"bufferView":0,"byteOffset":16,"componentType":5121,"count":{1},"type":"VEC4"}}]}})",
      bytes, tile.points, bound(box.min()), bound(box.max()), corner.x(), corner.z(),
      0.0 - corner.y());
}

}  // namespace

std::string glb_head(const TileEntry& tile) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max() - 4096;
  if (tile.points == 0 || tile.points > kMost / sizeof(MapPoint))
    throw std::invalid_argument(fmt::format("a GLB of {} points", tile.points));
  const std::uint64_t bytes = tile.points * sizeof(MapPoint);
  std::string json = json_of(tile, bytes);
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const std::size_t length = 12 + 8 + json.size() + 8 + bytes;
  std::string head;
  put(head, kGltfMagic);
  put(head, 2);
  put(head, static_cast<std::uint32_t>(length));
  put(head, static_cast<std::uint32_t>(json.size()));
  put(head, kJsonChunk);
  head += json;
  put(head, static_cast<std::uint32_t>(bytes));
  put(head, kBinaryChunk);
  return head;
}

std::string glb_of(const TileEntry& tile, std::span<const MapPoint> points) {
  if (points.size() != tile.points)
    throw std::invalid_argument(fmt::format("{} points, {} expected", points.size(), tile.points));
  std::string glb = glb_head(tile);
  const std::span<const std::byte> bytes = std::as_bytes(points);
  glb.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return glb;
}

}  // namespace stillmap::maps
