#pragma once

#include <array>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "vehicle_localizer.hpp"

namespace stillmap::vehicle {

/// Keeps the tiles of the active version around a place, and tells the height of the ground. One
/// thread fetches; when the server is away, it tries again at the next place after 5 s.
class MapAround {
 public:
  using OnPoints = std::function<void(const MapPoints&)>;
  using OnGround = std::function<void(std::optional<double> z)>;

  MapAround(const Settings& settings, OnPoints on_points);
  MapAround(const MapAround&) = delete;
  MapAround& operator=(const MapAround&) = delete;
  ~MapAround();

  /// Where the vehicle is; tiles are fetched again after a quarter of the radius.
  void move_to(const Eigen::Vector2d& place);
  /// Asks for the height of the ground in the map frame [m]. @param on_ground  called in the
  /// fetching thread, with nothing where the map has no ground there or cannot be had.
  void find_ground(const Eigen::Vector2d& place, OnGround on_ground);
  /// Why the last tiles could not be fetched; empty if they could.
  [[nodiscard]] std::string error() const;

 private:
  struct Question {
    Eigen::Vector2d place;
    OnGround on_ground;
  };
  struct Tile {
    Eigen::Vector3d corner_map;
    /// From the corner.
    std::vector<client::TilePoint> points;
  };
  using Tiles = std::map<std::string, Tile>;

  void work();
  /// Fetches and drops tiles until they are those around `place`. @return whether any changed.
  bool update(Tiles& tiles, const Eigen::Vector2d& place, double radius_m);
  void show(const Eigen::Vector2d& place);
  [[nodiscard]] std::optional<double> ground_at(const Eigen::Vector2d& place);

  client::Client client_;
  std::string map_;
  double radius_m_;
  OnPoints on_points_;
  Tiles shown_;
  std::optional<Eigen::Vector2d> shown_at_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Eigen::Vector2d> place_;
  std::optional<Question> question_;
  std::string error_;
  bool stopping_ = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::vehicle
