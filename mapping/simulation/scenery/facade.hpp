#pragma once

#include "geometry/random.hpp"
#include "scenery/wall_plane.hpp"

/// What the walls of a building are put together from.
namespace stillmap::simulation {

/// How deep the walls reach into the ground, which may fall along the building [m].
constexpr double kFoundationZ = -1.5;

/// What is alike all over one building.
struct FacadeStyle {
  Material wall, trim, plinth, frame, metal, door, roof;
  double window_width_m, window_height_m, window_depth_m, door_depth_m;
  bool has_transom;
  /// Shares of the windows with a curtain, and with a roller shutter let down some way.
  double curtains, shutters;
};
[[nodiscard]] FacadeStyle draw_style(Surface wall, Random& random);

/// Window in the piece of wall: reveals, glass, and what is behind it. `fine` adds bars and a sill,
/// which only count where a vehicle passes close by.
void add_window(const WallPlane& plane, const WallRect& piece, const WallRect& edge,
                const FacadeStyle& style, bool fine, Random& random);
/// Place of a usual window in a piece of wall whose floor is at `floor_z`.
[[nodiscard]] WallRect window_edge(const WallRect& piece, double floor_z, const FacadeStyle& style);

/// Entrance with its steps down to the ground.
/// @return where the door is.
WallRect add_entrance(const WallPlane& plane, const WallRect& piece, double floor_z,
                      const FacadeStyle& style, Random& random);
/// Wide door of a garage or hall.
void add_gate(const WallPlane& plane, const WallRect& piece, const WallRect& edge,
              const FacadeStyle& style, Random& random);
/// Large pane down to the knee, goods behind it, a board above, and perhaps an awning.
void add_shop_window(const WallPlane& plane, const WallRect& piece, const FacadeStyle& style,
                     bool has_awning, Random& random);

/// Slab and railing in front of a floor.
void add_balcony(const WallPlane& plane, const WallRect& place, double out_m, bool solid,
                 const FacadeStyle& style);
/// Part of a room that stands out of the piece of wall, windows on three sides.
void add_bay(const WallPlane& plane, const WallRect& piece, double floor_z, double out_m,
             const FacadeStyle& style, Random& random);
/// Roof over an entrance.
void add_canopy(const WallPlane& plane, double middle_x, double z, const FacadeStyle& style,
                Random& random);
void add_rain_pipe(const WallPlane& plane, double x, double top_z, const FacadeStyle& style);

}  // namespace stillmap::simulation
