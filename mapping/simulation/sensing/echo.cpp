#include "sensing/echo.hpp"

#include <algorithm>
#include <cmath>

#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {
namespace {

// Glass, then the other side's glass, seats, a fence behind ...
constexpr int kMaxLayers = 6;
constexpr double kStep = 1e-3;
// What acts like a mirror shows only its dust, unless it is met head on.
constexpr double kHeadOn = 0.985;
constexpr double kMirrorLeft = 0.12;
// Spread of a range over a long spot on the ground, in lengths of the spot.
constexpr double kSpotShare = 0.03;
// Intensities below are reported as 0, and so is all light below this share of what a white sheet
// sends back at 1 m (half of the time).
constexpr double kDarkest = 0.04;
constexpr double kWeakest = 1.2e-4;
constexpr double kIntensityNoise = 0.11;
// Shots that do not come back for no reason to be seen.
constexpr double kLostAnyhow = 0.004;

bool movable_first(const Hits& hits) {
  return hits.movable && (!hits.fixed || hits.movable->range_m < hits.fixed->range_m);
}

/// Glass mirrors more at a low angle (Schlick, "An inexpensive BRDF model", 1994).
double passes(const SurfaceProperties& surface, double cosine) {
  const double slant = 1.0 - cosine;
  return surface.transmission * (1.0 - slant * slant * slant * slant * slant);
}

/// A chance that falls the same for nearly all rays on one panel: a pane is clean, coated or dusty
/// as a whole, and so leaves a gap as a whole.
bool panel_chance(double probability, const Hit& hit, Random& random) {
  constexpr double kAlike = 0.985;
  const std::uint64_t key =
      key_of({static_cast<std::uint64_t>(hit.material.surface), hit.panel, hit.actor.value_or(0)});
  const bool of_panel = Random(key).chance(probability);
  return random.chance(kAlike) ? of_panel : random.chance(probability);
}

double reflectivity_of(const World& world, const Hit& hit) {
  const SurfaceProperties& surface = properties_of(hit.material.surface);
  double brightness = hit.material.brightness / 128.0;
  if (hit.actor && hit.material.surface == Surface::kPaint) {
    brightness *= world.actors[*hit.actor].paint;
  }
  return std::min(surface.reflectivity * brightness, 1.0);
}

std::uint32_t label_of(const World& world, const Hit& hit) {
  if (!hit.actor) return properties_of(hit.material.surface).label;
  const auto instance = static_cast<std::uint32_t>(*hit.actor + 1);
  return world.actors[*hit.actor].label | (instance << kInstanceShift);
}

/// Share of the light that leaves towards the sensor. Between Lambert's cosine and none at all:
/// rough surfaces send more back at a low angle (Oren, Nayar, SIGGRAPH 1994).
double shading(double cosine) { return 0.25 + 0.75 * cosine; }

/// Intensity as the sensor reports it: corrected for range and nearly for angle as long as there is
/// light enough, and 0 where there is not.
double reported(double reflectivity, const Hit& hit, double noise, Random& random) {
  const double light = reflectivity * shading(hit.cos_incidence) / (hit.range_m * hit.range_m);
  const double squared = (light / kWeakest) * (light / kWeakest);
  const bool too_weak = random.chance(1.0 / (1.0 + squared * squared));
  const double seen =
      reflectivity * (0.9 + 0.1 * hit.cos_incidence) * (1.0 + kIntensityNoise * noise);
  return too_weak || seen < kDarkest ? 0.0 : seen;
}

std::optional<Echo> echo_of(const World& world, const SensorProperties& sensor, const Hit& hit,
                            Random& random) {
  const SurfaceProperties& surface = properties_of(hit.material.surface);
  double reflectivity = reflectivity_of(world, hit);
  if (hit.cos_incidence < kHeadOn && panel_chance(surface.mirror, hit, random)) {
    reflectivity *= kMirrorLeft;
  }
  // A leaf or twig fills part of the beam only.
  const double filled =
      hit.material.surface == Surface::kLeaf || hit.material.surface == Surface::kHedge
          ? random.uniform(0.25, 1.25)
          : 1.0;
  const double gain = surface.retro ? 10.0 : shading(hit.cos_incidence);
  const double reach = sensor.half_range_m / hit.range_m;
  const double margin = filled * reflectivity * gain * reach * reach;
  // Half of the shots come back where the light just suffices; receivers are a little unsteady.
  const double cubed = margin * margin * margin;
  const double chance = cubed / (1.0 + cubed);
  if (!random.chance(chance * (1.0 - kLostAnyhow))) return std::nullopt;
  Echo echo;
  const double spot = sensor.divergence_rad * hit.range_m;
  const double tangent =
      std::sqrt(1.0 - hit.cos_incidence * hit.cos_incidence) / std::max(hit.cos_incidence, 0.05);
  const double stretched = std::min(kSpotShare * spot * tangent, 0.15);
  const double weak = 1.0 + 0.5 / std::max(margin, 0.25);
  const double sigma = std::hypot(sensor.range_noise_m * std::sqrt(weak), stretched);
  const double in_front =
      surface.fuzz_m > 0.0 ? -surface.fuzz_m * std::log(1.0 - random.uniform()) : 0.0;
  const auto [range_noise, intensity_noise] = random.normal_pair();
  echo.range_m = hit.range_m + sigma * range_noise -
                 std::min(in_front, 0.3) / std::max(hit.cos_incidence, 0.15);
  echo.power = filled * reflectivity * gain / (hit.range_m * hit.range_m);
  echo.intensity = surface.retro ? 0.97 + 0.05 * intensity_noise
                                 : reported(filled * reflectivity, hit, intensity_noise, random);
  echo.label = label_of(world, hit);
  return echo;
}

}  // namespace

RayOutcome follow_ray(const World& world, const RayScene& scene, const SensorProperties& sensor,
                      const Ray& ray, const Hits& first, bool objects, Random random) {
  RayOutcome outcome;
  Hits hits = first;
  Ray rest = ray;
  for (int layer = 0; layer < kMaxLayers; ++layer) {
    if (!objects) hits.movable.reset();
    const bool movable = movable_first(hits);
    const std::optional<Hit>& hit = movable ? hits.movable : hits.fixed;
    if (!hit) return outcome;
    outcome.met_object = outcome.met_object || movable;
    const SurfaceProperties& surface = properties_of(hit->material.surface);
    const double through = passes(surface, hit->cos_incidence);
    const bool is_net = surface.mirror == 0.0;
    if (through <= 0.0 ||
        !(is_net ? random.chance(through) : panel_chance(through, *hit, random))) {
      outcome.echo = echo_of(world, sensor, *hit, random);
      return outcome;
    }
    rest.min_range_m = static_cast<float>(hit->range_m + kStep);
    hits = scene.cast(rest);
  }
  return outcome;
}

void mix_edges(std::vector<std::optional<Echo>>& echoes, const std::vector<Beam>& beams,
               const SensorProperties& sensor, std::uint64_t key) {
  constexpr double kEdge = 0.1;
  // Two echoes of like strength: now and then the sensor reports neither.
  constexpr double kNeither = 0.5;
  const std::vector<std::optional<Echo>> alone = echoes;
  for (std::size_t i = 0; i + 1 < beams.size(); ++i) {
    if (!alone[i] || !alone[i + 1] || beams[i].ring != beams[i + 1].ring) continue;
    if (std::abs(alone[i]->range_m - alone[i + 1]->range_m) < kEdge) continue;
    const double apart = static_cast<double>((beams[i].direction - beams[i + 1].direction).norm());
    if (apart > 0.02) continue;
    Random random(key_of({key, 1, i}));
    if (!random.chance(std::min(1.0, sensor.divergence_rad / apart))) continue;
    // The edge lies in the spot of one of the two beams.
    const bool first = random.chance(0.5);
    const Echo& own = first ? *alone[i] : *alone[i + 1];
    const Echo& other = first ? *alone[i + 1] : *alone[i];
    if (!echoes[first ? i : i + 1]) continue;
    Echo& mixed = first ? *echoes[i] : *echoes[i + 1];
    const double share = random.uniform(0.0, 0.5);
    const double from_own = (1.0 - share) * own.power;
    const double from_other = share * other.power;
    if (std::abs(own.range_m - other.range_m) < sensor.echo_separation_m) {
      mixed = from_other > from_own ? other : own;
      mixed.range_m =
          (from_own * own.range_m + from_other * other.range_m) / (from_own + from_other);
    } else if (random.chance(kNeither)) {
      (first ? echoes[i] : echoes[i + 1]).reset();
    } else if (from_other > from_own) {
      mixed = other;
    } else {
      mixed.intensity *= 1.0 - share;
    }
  }
}

}  // namespace stillmap::simulation
