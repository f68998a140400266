#include "map_around.hpp"

#include <algorithm>

namespace stillmap::vehicle {

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
  if (change.add.empty()) return !change.remove.empty();
  const std::array<double, 3> origin = client_.map_origin(map_, change.version);
  for (const client::TileChange::Tile& added : change.add) {
    Tile& tile = tiles[added.id];
    for (const client::TilePoint& point : client_.tile(added.url)) {
      Eigen::Vector3f position;
      for (int axis = 0; axis < 3; ++axis)
        position[axis] = static_cast<float>(origin[static_cast<std::size_t>(axis)] +
                                            point.position[static_cast<std::size_t>(axis)]);
      tile.points.push_back({position.x(), position.y(), position.z(), point.intensity});
      if (point.is_ground()) tile.ground.push_back(position);
    }
  }
  return true;
}

void MapAround::show(const Eigen::Vector2d& place) {
  if (shown_at_ && (place - *shown_at_).norm() < radius_m_ / 4) return;
  const bool changed = update(shown_, place, radius_m_);
  shown_at_ = place;
  if (!changed) return;
  MapPoints points;
  for (const auto& [id, tile] : shown_)
    points.insert(points.end(), tile.points.begin(), tile.points.end());
  on_points_(points);
}

std::optional<double> MapAround::ground_at(const Eigen::Vector2d& place) {
  constexpr double kRadiusM = 3.0;
  constexpr std::size_t kFewest = 5;
  std::vector<float> heights;
  try {
    Tiles tiles;
    update(tiles, place, kRadiusM);
    for (const auto& [id, tile] : tiles) {
      for (const Eigen::Vector3f& point : tile.ground)
        if ((point.head<2>().cast<double>() - place).norm() < kRadiusM)
          heights.push_back(point.z());
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
