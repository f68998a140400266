#pragma once

#include <cstdint>

namespace stillmap::simulation {

/// What a triangle is made of: decides label, brightness, and what becomes of a ray that meets it.
enum class Surface : std::uint8_t {
  // Ground.
  kAsphalt,
  kLaneMarking,
  kParking,
  kPavement,
  kGravel,
  kGrass,
  // Buildings.
  kWall,
  kWindow,
  kCurtain,
  kDoor,
  kRoof,
  kHall,
  // Borders.
  kGardenWall,
  kFence,
  kMeshFence,
  kGuardRail,
  // Plants.
  kHedge,
  kTrunk,
  kLeaf,
  // Street furniture.
  kPole,
  kSign,
  kSignBack,
  kFurniture,
  kContainer,
  // Parts of objects; their label is the object's.
  kPaint,
  kCarGlass,
  kTyre,
  kTrim,
  kChrome,
  kPlate,
  kReflector,
  kInterior,
  kTarpaulin,
  kCloth,
  kSkin,
  kCount,
};

struct SurfaceProperties {
  /// SemanticKITTI class; 0 for parts of objects.
  std::uint32_t label;
  /// Share of the light at 905 nm that a diffuse sheet of it sends back at normal incidence.
  double reflectivity;
  /// Share of rays that go through (glass, wire mesh), at normal incidence.
  double transmission;
  /// Share of the rest that leaves like from a mirror and is lost unless met nearly head on.
  double mirror;
  /// Comes back to where it came from at any angle (signs, plates), brighter by far.
  bool retro;
  /// How far in front of the sheet rays are met: mean of an exponential [m] (blades, twigs).
  double fuzz_m;
};
[[nodiscard]] const SurfaceProperties& properties_of(Surface surface);

}  // namespace stillmap::simulation
