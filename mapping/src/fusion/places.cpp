#include "fusion/places.hpp"

#include <stillmap/maps/cell_table.hpp>

#include "fusion/box_estimate.hpp"
#include "fusion/box_frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace stillmap::mapping {
namespace {

/// What two boxes of one standing object share at least, of their joint area or of the smaller one.
constexpr double kJoinOfJoint = 0.2;
constexpr double kJoinOfSmaller = 0.5;

/// Tracks overlap as one object does with itself, found from two sides.
bool at_one_place(const maps::Box& a, const maps::Box& b) {
  if (!may_be_one(a.object_class, b.object_class)) return false;
  if (!(std::abs(a.centre.z() - b.centre.z()) < 0.5 * (a.size_m.z() + b.size_m.z()))) return false;
  const BoxOverlap overlap = overlap_of(a, b);
  return overlap.of_joint > kJoinOfJoint || overlap.of_smaller > kJoinOfSmaller;
}

/// Groups of tracks by place; a track meets only the groups of the cells around it.
class Places {
 public:
  /// Adds a track to the group it overlaps most, or to a new one.
  void add(std::size_t track, const maps::Box& box) {
    const auto [x, y] = cell_of(box);
    std::size_t best = groups_.size();
    double most = 0.0;
    for (std::int64_t cx = x - 1; cx <= x + 1; ++cx) {
      for (std::int64_t cy = y - 1; cy <= y + 1; ++cy) {
        const std::vector<std::size_t>* groups = cells_.find(maps::plane_cell_key(cx, cy));
        if (groups == nullptr) continue;
        for (const std::size_t group : *groups) {
          if (!at_one_place(groups_[group].box, box)) continue;
          const double shared_m2 = shared_area_m2(groups_[group].box, box);
          if (shared_m2 > most) best = group;
          most = std::max(most, shared_m2);
        }
      }
    }
    if (best == groups_.size()) {
      groups_.push_back({box, {}});
      cells_[maps::plane_cell_key(x, y)].push_back(best);
    }
    groups_[best].tracks.push_back(track);
  }

  struct Group {
    maps::Box box;
    std::vector<std::size_t> tracks;
  };
  [[nodiscard]] const std::vector<Group>& groups() const { return groups_; }

 private:
  /// Centres of boxes of 12 m that overlap are never two cells apart.
  static constexpr double kCellM = 12.0;
  static std::pair<std::int64_t, std::int64_t> cell_of(const maps::Box& box) {
    return {static_cast<std::int64_t>(std::floor(box.centre.x() / kCellM)),
            static_cast<std::int64_t>(std::floor(box.centre.y() / kCellM))};
  }
  std::vector<Group> groups_;
  maps::CellMap<std::vector<std::size_t>> cells_;
};

bool earlier(const Hit& a, const Hit& b) { return a.scan < b.scan; }

}  // namespace

std::vector<Track> joined_by_place(std::vector<Track> tracks) {
  std::vector<std::size_t> order(tracks.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  // The best seen first: their boxes are what the others are held against.
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return tracks[a].hits.size() > tracks[b].hits.size();
  });
  Places places;
  for (const std::size_t track : order) places.add(track, standing_box(tracks[track].hits));
  std::vector<Track> joined;
  for (const Places::Group& group : places.groups()) {
    std::vector<std::size_t> members = group.tracks;
    std::sort(members.begin(), members.end());
    Track track{tracks[members.front()].drive, false, {}};
    for (const std::size_t member : members) {
      std::vector<Hit>& hits = tracks[member].hits;
      track.hits.insert(track.hits.end(), hits.begin(), hits.end());
    }
    std::stable_sort(track.hits.begin(), track.hits.end(), earlier);
    joined.push_back(std::move(track));
  }
  std::stable_sort(joined.begin(), joined.end(), [](const Track& a, const Track& b) {
    return earlier(a.hits.front(), b.hits.front());
  });
  return joined;
}

}  // namespace stillmap::mapping
