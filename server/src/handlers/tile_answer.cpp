#include "handlers/tile_answer.hpp"

#include "handlers/context.hpp"

#include <fmt/format.h>

#include <stillmap/maps/glb.hpp>
#include <stillmap/maps/map_levels.hpp>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

namespace stillmap::server {
namespace {

/// Text in front of points.
class PointsSource final : public BodySource {
 public:
  PointsSource(std::string head, std::vector<maps::MapPoint> points)
      : head_(std::move(head)), points_(std::move(points)) {}
  [[nodiscard]] std::uint64_t size() const override { return head_.size() + bytes().size(); }
  void read(std::uint64_t offset, std::span<char> to) override {
    if (offset < head_.size()) {
      const std::size_t count = std::min<std::uint64_t>(head_.size() - offset, to.size());
      std::memcpy(to.data(), head_.data() + offset, count);
      to = to.subspan(count);
      offset += count;
    }
    if (to.empty()) return;
    std::memcpy(to.data(), bytes().subspan(offset - head_.size(), to.size()).data(), to.size());
  }

 private:
  [[nodiscard]] std::span<const std::byte> bytes() const {
    return std::as_bytes(std::span(points_));
  }

  std::string head_;
  std::vector<maps::MapPoint> points_;
};

}  // namespace

HttpResponse immutable_answer(const HttpRequest& request, const std::string& etag,
                              const std::function<void(HttpResponse&)>& fill) {
  HttpResponse response{.content_type = {}, .body = {}, .headers = {}};
  response.headers = {{"ETag", etag}, {"Cache-Control", kKeptForEver}};
  if (is_known_to_client(request.header("if-none-match"), etag)) {
    response.status = 304;
  } else {
    fill(response);
  }
  return response;
}

std::string tile_etag(const ServedVersion& version, std::string_view form, maps::TileId id) {
  return fmt::format("\"{}{}-{}-{}-{}\"", version.package->digest().substr(0, 16), form, id.level,
                     id.x, id.y);
}

bool lies_above_points(const maps::MapPackage& package, maps::TileId id) {
  if (id.level == 0 || id.level > maps::MapLevels::kHighest) return false;
  const auto is_below = [&](const maps::TileEntry& tile) {
    return tile.id.x >> id.level == id.x && tile.id.y >> id.level == id.y;
  };
  const auto meets = [&](std::int32_t region, std::int32_t tile) {
    const std::int32_t first = maps::kRegionTiles * region;
    return first >> id.level <= tile && tile <= (first + maps::kRegionTiles - 1) >> id.level;
  };
  const auto regions = package.regions();
  return std::any_of(regions.begin(), regions.end(), [&](maps::RegionId region) {
    if (!meets(region.x, id.x) || !meets(region.y, id.y)) return false;
    const auto tiles = package.tiles(region);
    return std::any_of(tiles.begin(), tiles.end(), is_below);
  });
}

void fill_with_glb(HttpResponse& response, const maps::TileEntry& tile,
                   std::vector<maps::MapPoint> points) {
  response.content_type = maps::kGlbMediaType;
  response.source = std::make_shared<PointsSource>(maps::glb_head(tile), std::move(points));
}

}  // namespace stillmap::server
