#include <stillmap/maps/tileset.hpp>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr const char* kAsset = R"("asset":{"version":"1.1","generator":"stillmap"})";
/// Boxes are told to the millimetre, rounded outwards; half a voxel around them keeps them from
/// being flat.
constexpr double kBoxStepM = 0.001;

double down(double value) { return std::floor(value / kBoxStepM) * kBoxStepM; }
double up(double value) { return std::ceil(value / kBoxStepM) * kBoxStepM; }
/// As few digits as say it.
double tidy(double value) { return std::round(value * 1e4) / 1e4; }

std::string uri_of(const std::string& base, TileId id, const char* ending) {
  return fmt::format("{}{}/{}/{}.{}", base, id.level, id.x, id.y, ending);
}

std::vector<TileEntry> tiles_of(const MapPackage& map, const MapLevels& levels) {
  std::vector<TileEntry> tiles = levels.tiles();
  for (const TileEntry& tile : map.tiles())
    if (tile.id.level == 0) tiles.push_back(tile);
  return tiles;
}

}  // namespace

Tileset::Tileset(const MapPackage& map, const MapLevels& levels)
    : Tileset(map, tiles_of(map, levels)) {}

Tileset::Tileset(const MapPackage& map, std::vector<TileEntry> tiles)
    : voxel_m_(MapLevels::voxel_m(map.manifest(), 0)),
      origin_(map.manifest().origin),
      digest_(map.digest()) {
  // By level first, so the children are there before their parent.
  std::sort(tiles.begin(), tiles.end(),
            [](const TileEntry& a, const TileEntry& b) { return a.id < b.id; });
  const std::uint32_t top = tiles.empty() ? 0 : tiles.back().id.level;
  points_of_level_.resize(top + 1);
  for (const TileEntry& tile : tiles) {
    points_of_level_[tile.id.level] += tile.points;
    Node& node = nodes_[tile.id];
    if (tile.id.level == 0) {
      node.box = tile.from_origin();
    } else if (!adopt_children(tile.id, node)) {
      throw InputError(map.folder().string(), "levels of another map", "its own");
    }
    if (tile.id.level == top) roots_.push_back(tile.id);
  }
  for (const auto& [id, node] : nodes_) {
    if (nodes_.size() > kMostTiles && id.level > 0 && id.level % kCutEvery == 0)
      cuts_.push_back(id);
  }
}

bool Tileset::adopt_children(TileId id, Node& node) {
  for (const auto& [dx, dy] : {std::pair{0, 0}, {0, 1}, {1, 0}, {1, 1}}) {
    const TileId child{id.level - 1, 2 * id.x + dx, 2 * id.y + dy};
    const auto found = nodes_.find(child);
    if (found == nodes_.end()) continue;
    node.box.extend(found->second.box);
    node.children.push_back(child);
  }
  return !node.children.empty();
}

double Tileset::error_m(std::uint32_t level) const {
  return level == 0 ? 0.0 : std::ldexp(voxel_m_, static_cast<int>(level));
}

bool Tileset::is_cut(TileId id) const { return std::binary_search(cuts_.begin(), cuts_.end(), id); }

std::string Tileset::box_text(const Eigen::AlignedBox3d& box) const {
  Eigen::Vector3d centre, half;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const double low = down(box.min()[axis]);
    const double high = up(box.max()[axis]);
    centre[axis] = tidy(0.5 * (low + high));
    half[axis] = tidy(0.5 * (high - low) + 0.5 * voxel_m_);
  }
  return fmt::format(R"("boundingVolume":{{"box":[{},{},{},{},0,0,0,{},0,0,0,{}]}})", centre[0],
                     centre[1], centre[2], half[0], half[1], half[2]);
}

void Tileset::append_children(std::string& text, TileId id, const std::string& base) const {
  text += R"("children":[)";
  bool first = true;
  for (const TileId child : nodes_.at(id).children) {
    if (!std::exchange(first, false)) text += ',';
    append(text, child, base);
  }
  text += ']';
}

void Tileset::append(std::string& text, TileId id, const std::string& base) const {
  const Node& node = nodes_.at(id);
  text += fmt::format(R"({{{},"geometricError":{},"content":{{"uri":"{}"}})", box_text(node.box),
                      error_m(id.level), uri_of(base, id, "glb"));
  if (is_cut(id)) {
    text += fmt::format(R"(,"children":[{{{},"geometricError":{},"content":{{"uri":"{}"}}}}])",
                        box_text(node.box), error_m(id.level), uri_of(base, id, "json"));
  } else if (!node.children.empty()) {
    text += ',';
    append_children(text, id, base);
  }
  text += '}';
}

std::string Tileset::extras() const {
  return fmt::format(
      R"("extras":{{"voxel_size_m":{},"levels":{},"points":[{}],"origin":[{},{},{}],"digest":"{}"}})",
      voxel_m_, points_of_level_.size() - 1, fmt::join(points_of_level_, ","), origin_.x(),
      origin_.y(), origin_.z(), digest_);
}

std::string Tileset::text(const std::optional<Eigen::Matrix4d>& T_world_origin) const {
  Eigen::AlignedBox3d box;
  for (const TileId root : roots_) box.extend(nodes_.at(root).box);
  if (roots_.empty()) box.extend(Eigen::Vector3d::Zero().eval());
  const Eigen::Vector3d size = box.sizes();
  const double diagonal2 = size.x() * size.x() + size.y() * size.y() + size.z() * size.z();
  // Of the root, which has no points of its own: never small enough to stop there.
  const double error = std::max(up(std::sqrt(diagonal2)),
                                error_m(static_cast<std::uint32_t>(points_of_level_.size())));
  std::string text = fmt::format(R"({{{},"geometricError":{},{},"root":{{{},"geometricError":{},)",
                                 kAsset, tidy(error), extras(), box_text(box), tidy(error));
  text += R"("refine":"REPLACE")";
  if (T_world_origin) {
    const Eigen::Map<const Eigen::Array<double, 1, 16>> column_major(T_world_origin->data());
    text += fmt::format(R"(,"transform":[{}])",
                        fmt::join(column_major.begin(), column_major.end(), ","));
  }
  bool first = true;
  if (!roots_.empty()) text += R"(,"children":[)";
  for (const TileId root : roots_) {
    if (!std::exchange(first, false)) text += ',';
    append(text, root, "");
  }
  return text + (roots_.empty() ? "}}\n" : "]}}\n");
}

std::string Tileset::cut_text(TileId id) const {
  if (!is_cut(id)) throw std::invalid_argument("a tile without a tileset of its own");
  const std::string box = box_text(nodes_.at(id).box);
  std::string text = fmt::format(R"({{{0},"geometricError":{1},"root":{{{2},"geometricError":{1},)",
                                 kAsset, error_m(id.level), box);
  text += R"("refine":"REPLACE",)";
  append_children(text, id, "../../");
  return text + "}}\n";
}

}  // namespace stillmap::maps
