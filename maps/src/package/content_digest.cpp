#include <stillmap/maps/content_digest.hpp>

#include <stillmap/maps/map_graph.hpp>

#include <bit>
#include <concepts>
#include <cstring>
#include <string_view>
#include <vector>

#include <stillmap/maps/sha256.hpp>

namespace stillmap::maps {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers enter in little endian");

/// Values one after the other, as maps/content_digest.md writes them down.
class ContentBytes {
 public:
  void clear() { bytes_.clear(); }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

  template <std::integral Number>
  void add(Number number) {
    add_bytes(number);
  }
  /// Both zeros are one number.
  void add(double number) { add_bytes(number + 0.0); }
  void add(std::string_view text) {
    add(std::uint64_t{text.size()});
    bytes_ += text;
  }
  void add(const Eigen::Vector3d& vector) {
    for (const double number : vector) add(number);
  }
  void add(const Eigen::Isometry3d& pose) {
    for (Eigen::Index row = 0; row < 3; ++row)
      for (Eigen::Index column = 0; column < 4; ++column) add(pose(row, column));
  }
  void add(const Sha256::Digest& digest) {
    for (const unsigned char byte : digest) bytes_ += static_cast<char>(byte);
  }

 private:
  template <typename Number>
  void add_bytes(Number number) {
    std::array<char, sizeof(Number)> bytes{};
    std::memcpy(bytes.data(), &number, sizeof(Number));
    bytes_.append(bytes.data(), bytes.size());
  }
  std::string bytes_;
};

/// Of digests as 256-bit numbers, modulo 2^256: any order gives the same.
class DigestSum {
 public:
  void add(const Sha256::Digest& digest) {
    unsigned carry = 0;
    for (std::size_t i = 0; i < sum_.size(); ++i) {
      carry += static_cast<unsigned>(sum_[i]) + digest[i];
      sum_[i] = static_cast<unsigned char>(carry & 0xFFU);
      carry >>= 8U;
    }
  }
  /// Little endian.
  [[nodiscard]] const Sha256::Digest& bytes() const { return sum_; }

 private:
  Sha256::Digest sum_{};
};

void put_point(const MapPoint& point, const Eigen::Vector3d& position, const PointHistory* history,
               ContentBytes& bytes) {
  bytes.add(position);
  bytes.add(static_cast<double>(point.intensity));
  bytes.add(point.observations);
  bytes.add(static_cast<std::uint8_t>(point.kind));
  bytes.add(point.object);
  if (history == nullptr) return;
  bytes.add(history->first_scan);
  bytes.add(history->last_scan);
  bytes.add(history->object);
  for (const std::int8_t part : history->normal) bytes.add(part);
  bytes.add(history->planarity);
}

void put_points(const MapPackage& map, ContentBytes& content) {
  std::uint64_t count = 0;
  DigestSum sum;
  Sha256 hash;
  ContentBytes point;
  for (const TileEntry& entry : map.tiles()) {
    if (entry.id.level != 0) continue;
    const MapTile tile = map.tile(entry.id);
    const std::vector<PointHistory> histories = map.history(entry.id);
    for (std::size_t i = 0; i < tile.size(); ++i) {
      point.clear();
      put_point(tile[i], tile.position(tile[i]), histories.empty() ? nullptr : &histories[i],
                point);
      hash.restart();
      hash.add(point.bytes().data(), point.bytes().size());
      sum.add(hash.bytes());
    }
    count += tile.size();
  }
  content.add(count);
  content.add(sum.bytes());
}

void put_object(const MapObject& object, ContentBytes& content) {
  content.add(name_of(object.object_class));
  content.add(object.size_m);
  content.add(object.score);
  content.add(name_of(object.motion));
  for (const std::size_t number : {object.drive, object.first_scan, object.last_scan})
    content.add(std::uint64_t{number});
  content.add(object.first_stamp_ns);
  content.add(object.last_stamp_ns);
  content.add(std::uint64_t{object.detections});
  content.add(object.points_removed);
  content.add(std::uint64_t{object.placements.size()});
  for (const MapObject::Placement& placement : object.placements) {
    content.add(std::uint64_t{placement.scan});
    content.add(placement.centre_map);
    content.add(placement.yaw_rad);
  }
}

void put_objects(const std::vector<MapObject>& objects, ContentBytes& content) {
  content.add(std::uint64_t{objects.size()});
  for (const MapObject& object : objects) put_object(object, content);
}

void put_drives(const std::vector<Trajectory>& drives, ContentBytes& content) {
  content.add(std::uint64_t{drives.size()});
  for (const Trajectory& drive : drives) {
    content.add(std::uint64_t{drive.size()});
    for (const StampedPose& pose : drive.poses()) {
      content.add(pose.stamp_ns);
      content.add(pose.T_map_lidar);
    }
  }
}

void put_graph(const MapGraph& graph, ContentBytes& content) {
  content.add(std::uint64_t{graph.key_frames.size()});
  for (const std::size_t pose : graph.key_frames) content.add(std::uint64_t{pose});
  content.add(std::uint64_t{graph.loops.size()});
  for (const MapGraph::Loop& loop : graph.loops) {
    content.add(std::uint64_t{loop.from});
    content.add(std::uint64_t{loop.to});
    content.add(loop.weight);
  }
}

void put_places(const std::vector<Eigen::Isometry3d>& T_map_place, ContentBytes& content) {
  content.add(std::uint64_t{T_map_place.size()});
  for (const Eigen::Isometry3d& place : T_map_place) content.add(place);
}

}  // namespace

std::string content_digest(const MapPackage& map) {
  ContentBytes content;
  content.add(std::string_view("stillmap content 1"));
  put_points(map, content);
  put_objects(map.objects(), content);
  put_drives(map.trajectories(), content);
  put_graph(read_map_graph(map).value_or(MapGraph{}), content);
  put_places(map.places(), content);
  return sha256_of(content.bytes());
}

}  // namespace stillmap::maps
