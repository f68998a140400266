#include "geometry/surface.hpp"

#include <array>
#include <cstddef>

namespace stillmap::simulation {
namespace {

// label, reflectivity, transmission, mirror, retro, fuzz.
constexpr std::array<SurfaceProperties, static_cast<std::size_t>(Surface::kCount)> kProperties{{
    {40, 0.31, 0.00, 0.00, false, 0.003},  // asphalt
    {60, 0.50, 0.00, 0.00, false, 0.002},  // lane marking
    {44, 0.33, 0.00, 0.00, false, 0.002},  // parking
    {48, 0.35, 0.00, 0.00, false, 0.003},  // pavement
    {49, 0.33, 0.00, 0.00, false, 0.006},  // gravel
    {72, 0.40, 0.00, 0.00, false, 0.025},  // grass
    {50, 0.37, 0.00, 0.00, false, 0.000},  // wall
    {50, 0.02, 0.25, 0.90, false, 0.000},  // window
    {50, 0.40, 0.30, 0.00, false, 0.000},  // curtain
    {50, 0.30, 0.00, 0.00, false, 0.000},  // door
    {50, 0.28, 0.00, 0.00, false, 0.000},  // roof
    {50, 0.40, 0.00, 0.05, false, 0.000},  // hall
    {51, 0.35, 0.00, 0.00, false, 0.000},  // garden wall
    {51, 0.33, 0.00, 0.00, false, 0.000},  // fence
    {51, 0.30, 0.75, 0.00, false, 0.000},  // wire mesh
    {51, 0.40, 0.00, 0.20, false, 0.000},  // guard rail
    {70, 0.46, 0.25, 0.00, false, 0.040},  // hedge
    {71, 0.38, 0.00, 0.00, false, 0.000},  // trunk
    {70, 0.46, 0.00, 0.00, false, 0.000},  // leaf
    {80, 0.34, 0.00, 0.00, false, 0.000},  // pole
    {81, 0.90, 0.00, 0.00, true, 0.000},   // sign
    {81, 0.25, 0.00, 0.00, false, 0.000},  // sign from behind
    {99, 0.30, 0.00, 0.00, false, 0.000},  // bins, benches
    {52, 0.32, 0.00, 0.05, false, 0.000},  // container
    {0, 0.24, 0.00, 0.45, false, 0.000},   // paint
    {0, 0.02, 0.45, 0.95, false, 0.000},   // car glass
    {0, 0.08, 0.00, 0.00, false, 0.000},   // tyre
    {0, 0.10, 0.00, 0.00, false, 0.000},   // trim
    {0, 0.40, 0.00, 0.60, false, 0.000},   // chrome, rims
    {0, 0.80, 0.00, 0.00, true, 0.000},    // number plate
    {0, 0.70, 0.00, 0.00, true, 0.000},    // lamps, reflectors
    {0, 0.15, 0.00, 0.00, false, 0.000},   // seats
    {0, 0.45, 0.00, 0.00, false, 0.000},   // tarpaulin
    {0, 0.35, 0.00, 0.00, false, 0.000},   // cloth
    {0, 0.40, 0.00, 0.00, false, 0.000},   // skin
}};

}  // namespace

const SurfaceProperties& properties_of(Surface surface) {
  return kProperties.at(static_cast<std::size_t>(surface));
}

}  // namespace stillmap::simulation
