#include "map_around.hpp"

#include <algorithm>

namespace stillmap::vehicle {
namespace {

/// Points are shown from a whole number of these, so that their frame moves rarely.
constexpr double kOriginStepM = 1000.0;

/// In the map frame [m].
Eigen::Vector3d position_of(const Eigen::Vector3d& corner_map, const client::TilePoint& point) {
  return corner_map + Eigen::Map<const Eigen::Vector3f>(point.position.data()).cast<double>();
}

}  // namespace

MapAround::MapAround(const Settings& settings, OnPoints on_points)
    : client_(settings.url, settings.key),
      map_(settings.map),
      radius_m_(settings.tile_radius_m),
      on_points_(std::move(on_points)),
      thread_([this] { work(); }) {}

MapAround::~MapAround() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void MapAround::move_to(const Eigen::Vector2d& place) {
  if (radius_m_ <= 0.0) return;
  {
    const std::lock_guard lock(mutex_);
    place_ = place;
  }
  changed_.notify_all();
}

void MapAround::find_ground(const Eigen::Vector2d& place, OnGround on_ground) {
  {
    const std::lock_guard lock(mutex_);
    question_ = {place, std::move(on_ground)};
  }
  changed_.notify_all();
}

std::string MapAround::error() const {
  const std::lock_guard lock(mutex_);
  return error_;
}

void MapAround::work() {
  constexpr std::chrono::seconds kPause(5);
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    changed_.wait(lock, [this] { return stopping_ || question_ || place_; });
    if (stopping_) break;
    const auto question = std::exchange(question_, std::nullopt);
    const auto place = std::exchange(place_, std::nullopt);
    lock.unlock();
    std::string error;
    try {
      if (place) show(*place);
    } catch (const std::exception& why) {
      error = why.what();
    }
    if (question) question->on_ground(ground_at(question->place));
    lock.lock();
    if (place) error_ = error;
    if (!error.empty()) changed_.wait_for(lock, kPause, [this] { return stopping_ || question_; });
  }
}

bool MapAround::update(Tiles& tiles, const Eigen::Vector2d& place, double radius_m) {
  std::vector<std::string> known;
  for (const auto& [id, tile] : tiles) known.push_back(id);
  const client::TileChange change =
      client_.tiles_around(map_, {place.x(), place.y()}, radius_m, known);
  for (const std::string& id : change.remove) tiles.erase(id);
  for (const client::TileChange::Tile& added : change.add)
    tiles[added.id] = {Eigen::Map<const Eigen::Vector3d>(added.corner.data()),
                       client_.tile(added.url)};
  return !change.add.empty() || !change.remove.empty();
}

void MapAround::show(const Eigen::Vector2d& place) {
  if (shown_at_ && (place - *shown_at_).norm() < radius_m_ / 4) return;
  const bool changed = update(shown_, place, radius_m_);
  shown_at_ = place;
  if (!changed) return;
  MapPoints points;
  points.origin_map.head<2>() = kOriginStepM * (place / kOriginStepM).array().round();
  for (const auto& [id, tile] : shown_) {
    for (const client::TilePoint& point : tile.points) {
      const Eigen::Vector3f p =
          (position_of(tile.corner_map, point) - points.origin_map).cast<float>();
      points.points.push_back({p.x(), p.y(), p.z(), point.intensity});
    }
  }
  on_points_(points);
}

std::optional<double> MapAround::ground_at(const Eigen::Vector2d& place) {
  constexpr double kRadiusM = 3.0;
  constexpr std::size_t kFewest = 5;
  std::vector<double> heights;
  try {
    Tiles tiles;
    update(tiles, place, kRadiusM);
    for (const auto& [id, tile] : tiles) {
      for (const client::TilePoint& point : tile.points) {
        const Eigen::Vector3d p = position_of(tile.corner_map, point);
        if (point.is_ground() && (p.head<2>() - place).norm() < kRadiusM) heights.push_back(p.z());
      }
    }
  } catch (const std::exception&) {
    return std::nullopt;
  }
  if (heights.size() < kFewest) return std::nullopt;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return *middle;
}

}  // namespace stillmap::vehicle
