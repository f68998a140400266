#pragma once

#include "views/box_rays.hpp"
#include "views/view_grid.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What one scan says about a small cell.
enum class Sight : std::uint8_t {
  /// No ray headed for it: between rings, own vehicle, no return.
  kUnknown,
  /// All rays that headed for it ended before it.
  kHidden,
  /// A ray ended at it.
  kHit,
  /// Rays passed it, but something stands so near to their way that it may reach into the cell.
  kMixed,
  /// Rays passed through it, and nothing is near their way.
  kFree,
};

struct Look {
  Sight sight = Sight::kUnknown;
  /// Directions with a return around the cell, guard included; only for `kFree`.
  int rays = 0;
};

/// Where one scan looked and how far: for each direction (`ViewGrid`) the nearest and the farthest
/// return.
///
/// A direction without a return says nothing: neither sky, nor a black car, nor the own vehicle is
/// told from free space. Ground is kept apart from the rest, since a return from the ground before
/// or under a cell does not speak for something in the cell.
/// A scan of several lidars has directions and ranges of each, from where it stands; what all of
/// them say together counts as one look. Immutable; safe from several threads.
class RangeView {
 public:
  /// @param positions  N points in the lidar frame [m], deskewed to one instant, finite.
  /// @param is_ground  N flags, 1 = ground; or empty when unknown.
  RangeView(std::span<const Eigen::Vector3f> positions, std::span<const std::uint8_t> is_ground);
  /// As seen by each of the lidars that took the points.
  RangeView(const maps::PointCloud& cloud, std::span<const std::uint8_t> is_ground);

  /// @param p          lidar frame [m].
  /// @param radius_m   of the cell around it, > 0.
  /// @return see `Sight`. `kFree` needs a ray through the cell that ends well beyond it, and no
  /// return from anything but the ground before that in all directions within the cell's radius
  /// and a guard around it (pose, beam, bins).
  /// @param doubt_m  how far off the view's pose may put the cell; widens the guard.
  [[nodiscard]] Look look(const Eigen::Vector3f& p, float radius_m, float doubt_m = 0.0F) const;

  /// What the rays towards a box met, counted in directions that have a return. Those that pass or
  /// end before it are counted where they head for its middle, since a car leaves the corners of
  /// its box free, and not where they pass below `kRayFloorM`. A return from the ground
  /// inside of the box, of a ray that came in higher, counts as passing: it met nothing in the box.
  /// @param box  in the scan's lidar frame. NaN anywhere: no rays.
  [[nodiscard]] BoxRays count(const maps::Box& box) const;

  /// For a scratch file of the same program run: 2 to 5 bytes a direction with returns.
  [[nodiscard]] std::string to_bytes() const;
  /// @return the view that gave the bytes.
  /// @throws std::invalid_argument saying what is wrong with the bytes.
  [[nodiscard]] static RangeView from_bytes(std::string_view bytes);

  friend bool operator==(const RangeView&, const RangeView&) = default;

 private:
  /// Ranges in `kQuantumM`, rounded down: a surface is never farther than it says.
  struct Bin {
    /// Of the nearest return that is not ground; kNone without one.
    std::uint16_t nearest = kNone;
    /// Of the farthest return; 0 without one.
    std::uint16_t farthest = 0;
    friend bool operator==(const Bin&, const Bin&) = default;
  };
  static constexpr std::uint16_t kNone = 0xFFFF;
  static constexpr float kQuantumM = 0.01F;
  struct Aim;

  RangeView() = default;
  /// As the public ones, of this lidar alone.
  [[nodiscard]] Look own_look(const Eigen::Vector3f& p, float radius_m, float doubt_m) const;
  [[nodiscard]] BoxRays own_count(const maps::Box& box) const;
  void add_bytes(std::string& bytes) const;
  /// @param at  where the bytes of one lidar begin; where they end, afterwards.
  [[nodiscard]] static RangeView one_from_bytes(std::string_view bytes, std::size_t& at);
  [[nodiscard]] bool any_near(const Aim& aim, float range_m, float radius_m, float doubt_m) const;
  [[nodiscard]] const Bin& bin(int row, int column) const {
    return bins_[static_cast<std::size_t>((row - first_row_) * ViewGrid::kColumns +
                                          ViewGrid::wrapped(column))];
  }
  [[nodiscard]] int end_row() const {
    return first_row_ + static_cast<int>(bins_.size() / ViewGrid::kColumns);
  }

  /// Rows from the lowest to the highest with a return, all columns each.
  std::vector<Bin> bins_;
  int first_row_ = 0;
  /// Of the lidar in the frame of the points [m].
  Eigen::Vector3f origin_ = Eigen::Vector3f::Zero();
  /// The views of the other lidars, each with none of its own.
  std::vector<RangeView> others_;
};

}  // namespace stillmap::mapping
