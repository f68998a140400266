#include "scenery/plants.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "scenery/branches.hpp"
#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kRoots_m = -0.3;

/// Measures of a kind of plant, in metres unless said.
struct Form {
  Range height;
  /// Up to here no leaves.
  Range clear;
  /// Half the crown's width, against the height.
  Range spread;
  Range stem_radius;
  /// See Branches::Habit.
  double rise;
  int clumps;
  Range clump_radius;
  Range leaf;
  int leaves;
};

// Leaves stand for clusters of some leaves each; those of large trees are larger than real ones, so
// that a few thousand are as dense. Clumps and leaves are for a plant of middle height and grow
// with it, so that rays get through all of a kind alike.
constexpr Form kStreet{{5.0, 8.0}, {2.05, 2.7}, {0.25, 0.32}, {0.08, 0.14}, 0.5,
                       60,         {0.3, 0.55}, {0.07, 0.13}, 3800};
constexpr Form kLarge{{10.0, 18.0}, {2.4, 4.2}, {0.24, 0.31}, {0.18, 0.35}, 0.45,
                      75,           {0.6, 1.3}, {0.16, 0.3},  4400};
constexpr Form kSlim{{6.0, 12.0}, {0.5, 1.6},  {0.09, 0.14}, {0.08, 0.15}, 1.6,
                     70,          {0.25, 0.5}, {0.08, 0.13}, 3800};
constexpr Form kYoung{{3.0, 4.5}, {1.5, 1.9},   {0.17, 0.22}, {0.025, 0.04}, 0.9,
                      30,         {0.18, 0.32}, {0.05, 0.08}, 2100};
constexpr Form kBush{{0.6, 2.0},   {0.02, 0.1},  {0.4, 0.55}, {0.015, 0.03}, 0.9, 16,
                     {0.12, 0.25}, {0.07, 0.13}, 530};

struct Clump {
  Eigen::Vector3d middle;
  double radius_m;
};

/// One plant's measures, drawn from its kind's.
struct Plant {
  double height_m, clear_m, spread_m;
  /// Against a plant of its kind of middle height.
  double scale = 1.0;
};

std::vector<Eigen::Vector3d> draw_stem(const Plant& plant, Random& random) {
  constexpr double kStep_m = 0.5;
  const double top_m = plant.clear_m + 0.75 * (plant.height_m - plant.clear_m);
  // Trunks lean by some 2 degrees and wander a little.
  Eigen::Vector2d lean;
  for (double& slope : lean) slope = 0.035 * random.normal();
  std::vector<Eigen::Vector3d> stem{{0.0, 0.0, kRoots_m}, {0.0, 0.0, 0.0}};
  const int steps = std::max(2, static_cast<int>(std::lround(top_m / kStep_m)));
  Eigen::Vector2d drift = Eigen::Vector2d::Zero();
  for (int i = 1; i <= steps; ++i) {
    const double z = top_m * i / steps;
    for (double& offset : drift) offset += 0.015 * random.normal();
    const Eigen::Vector2d xy = z * lean + drift;
    stem.emplace_back(xy.x(), xy.y(), z);
  }
  return stem;
}

/// Half width of the crown at a share `t` of its height: widest at 40 %, like an egg.
double outline(double t) {
  const double away = t < 0.4 ? (0.4 - t) / 0.4 : (t - 0.4) / 0.6;
  return std::sqrt(std::max(0.0, 1.0 - away * away));
}

/// Clumps sit in the outer part of the crown, which is hollow inside.
std::vector<Clump> draw_clumps(const Form& form, const Plant& plant, Random& random) {
  std::vector<Clump> clumps;
  const double phase_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  for (int i = 0; i < form.clumps; ++i) {
    const double radius_m = plant.scale * draw(form.clump_radius, random);
    const double t = random.uniform(0.0, 1.0);
    const double angle_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double lobe = 0.85 + 0.15 * std::sin(2.0 * angle_rad + phase_rad);
    const double out_m = lobe * std::sqrt(random.uniform(0.2, 1.0)) *
                         std::max(0.0, outline(t) * plant.spread_m - 0.5 * radius_m);
    const double low_m = plant.clear_m + 0.5 * radius_m;
    const double z = low_m + t * (plant.height_m - 0.7 * radius_m - low_m);
    clumps.push_back({{out_m * std::cos(angle_rad), out_m * std::sin(angle_rad), z}, radius_m});
  }
  // Branches grow to near tips first.
  std::stable_sort(clumps.begin(), clumps.end(), [](const Clump& a, const Clump& b) {
    return a.middle.squaredNorm() < b.middle.squaredNorm();
  });
  return clumps;
}

/// Share of the leaves that are there.
int kept_of(int leaves, double foliage) { return static_cast<int>(std::lround(foliage * leaves)); }

void add_leaf(Mesh& mesh, const Eigen::Vector3d& middle, double size_m, Random& random) {
  const Eigen::Vector3d u = size_m * draw_direction(random);
  const Eigen::Vector3d v = size_m * u.cross(draw_direction(random)).normalized();
  const Material material(Surface::kLeaf, random.uniform(0.7, 1.3));
  mesh.add_triangle(middle - 0.5 * u - 0.4 * v, middle + 0.5 * u - 0.4 * v, middle + 0.4 * v,
                    material);
}

/// The leaves are drawn from all clumps in turn, so that those missing at the end thin out the
/// whole crown.
void add_leaves(Mesh& mesh, const std::vector<Clump>& clumps, const Plant& plant, const Form& form,
                int count, Random& random) {
  for (int i = 0; i < count; ++i) {
    const Clump& clump = clumps[random.index(clumps.size())];
    const double size_m = plant.scale * draw(form.leaf, random);
    const double out_m = clump.radius_m * std::cbrt(random.uniform(0.1, 1.0));
    const Eigen::Vector3d aside = out_m * draw_direction(random);
    // Clumps are flat.
    Eigen::Vector3d middle = clump.middle + Eigen::Vector3d(aside.x(), aside.y(), 0.7 * aside.z());
    // A corner lies at most 0.65 sizes from the middle.
    middle.z() =
        std::clamp(middle.z(), plant.clear_m + 0.65 * size_m, plant.height_m - 0.65 * size_m);
    add_leaf(mesh, middle, size_m, random);
  }
}

/// Wood first, then the leaves.
Mesh make_broadleaf(const Form& form, double foliage, Random& random) {
  Plant plant{};
  plant.height_m = draw(form.height, random);
  plant.clear_m = draw(form.clear, random);
  plant.spread_m = plant.height_m * draw(form.spread, random);
  const double middle_m = 0.5 * (form.height.low + form.height.high);
  plant.scale = plant.height_m / middle_m;
  const double stem_radius_m = plant.scale * draw(form.stem_radius, random);
  Branches branches(draw_stem(plant, random), {0.9 * plant.clear_m, form.rise});
  const std::vector<Clump> clumps = draw_clumps(form, plant, random);
  for (const Clump& clump : clumps) branches.grow_to(clump.middle, random);

  Mesh mesh;
  branches.add_to(mesh, stem_radius_m, {Surface::kTrunk, random.uniform(0.7, 1.3)});
  add_leaves(mesh, clumps, plant, form, kept_of(form.leaves, foliage), random);
  return mesh;
}

/// Bough of a conifer: hangs outwards from the trunk.
struct Bough {
  Eigen::Vector3d foot, reach;
};

std::vector<Bough> draw_boughs(const Plant& plant, Random& random) {
  std::vector<Bough> boughs;
  const double crown_m = plant.height_m - plant.clear_m;
  for (double z = plant.clear_m + 0.3; z < plant.height_m - 0.5; z += random.uniform(0.35, 0.6)) {
    const std::size_t count = 5 + random.index(3);
    const double turn_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double room = 1.0 - (z - plant.clear_m) / crown_m;
    for (std::size_t i = 0; i < count; ++i) {
      const double angle_rad =
          turn_rad + (2.0 * std::numbers::pi * static_cast<double>(i) + random.uniform(-1.0, 1.0)) /
                         static_cast<double>(count);
      const double length_m = std::max(0.2, plant.spread_m * room * random.uniform(0.7, 1.15));
      // Low boughs hang, those near the top stand up.
      const double slope = random.uniform(-0.15, 0.1) + 0.6 * (0.4 - room);
      boughs.push_back(
          {{0.0, 0.0, std::max(z, plant.clear_m + 0.75 * length_m * -slope + 0.35)},
           length_m * Eigen::Vector3d(std::cos(angle_rad), std::sin(angle_rad), 0.7 * slope)});
    }
  }
  return boughs;
}

/// Sprays of needles to both sides of a bough and hanging a little, longer than they are wide.
void add_needles(Mesh& mesh, const Bough& bough, const Range& size, Random& random) {
  const double length_m = bough.reach.norm();
  const double t = std::sqrt(random.uniform(0.03, 1.0));
  const Eigen::Vector3d along = bough.reach / length_m;
  const Eigen::Vector3d across = along.cross(Eigen::Vector3d::UnitZ()).normalized();
  const double half_m = 0.08 + 0.3 * length_m * (1.0 - t);
  const double aside_m = random.uniform(-half_m, half_m);
  const double hang_m = random.uniform(-0.15, 0.03);
  const Eigen::Vector3d foot =
      bough.foot + t * bough.reach + aside_m * across + hang_m * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d way =
      (along + (aside_m > 0.0 ? across : -across) + 0.6 * draw_direction(random)).normalized();
  const Eigen::Vector3d side = way.cross(draw_direction(random)).normalized();
  const double size_m = draw(size, random);
  const Material material(Surface::kLeaf, random.uniform(0.6, 1.0));
  mesh.add_triangle(foot - 0.4 * size_m * side, foot + 0.4 * size_m * side, foot + size_m * way,
                    material);
}

Mesh make_conifer(double foliage, Random& random) {
  constexpr int kNeedles = 4400;
  Plant plant{};
  // The tip of the trunk is the top of the tree.
  plant.height_m = random.uniform(6.1, 13.9);
  plant.clear_m = random.uniform(0.3, 1.2);
  plant.spread_m = plant.height_m * random.uniform(0.16, 0.23);
  const std::vector<Bough> boughs = draw_boughs(plant, random);
  double longest_m = 0.0;
  for (const Bough& bough : boughs) longest_m = std::max(longest_m, bough.reach.norm());

  Mesh mesh;
  const Material wood(Surface::kTrunk, random.uniform(0.6, 1.1));
  const double radius_m = 0.014 * plant.height_m;
  add_tube(mesh,
           {{{0.0, 0.0, kRoots_m}, 1.4 * radius_m, 0.1},
            {{0.0, 0.0, 0.3}, radius_m, 0.08},
            {{0.0, 0.0, plant.height_m}, 0.01}},
           wood, 8);
  for (const Bough& bough : boughs)
    add_bar(mesh, bough.foot, bough.foot + 0.9 * bough.reach, 0.012, wood);
  const int kept = kept_of(kNeedles, foliage);
  for (int i = 0; i < kept;) {
    // Long boughs carry more.
    const Bough& bough = boughs[random.index(boughs.size())];
    if (!random.chance(bough.reach.norm() / longest_m)) continue;
    add_needles(mesh, bough, {0.018 * plant.height_m, 0.026 * plant.height_m}, random);
    ++i;
  }
  return mesh;
}

void add_stake(Mesh& mesh, Random& random) {
  const double away_m = random.uniform(0.2, 0.35);
  const double high_m = random.uniform(1.3, 1.6);
  const Material wood(Surface::kTrunk, 1.3);
  mesh.add_column({away_m, 0.0, kRoots_m}, {0.0, 0.0, high_m - kRoots_m}, {0.035, 0.03}, wood, 6);
  add_bar(mesh, {0.0, 0.0, high_m - 0.1}, {away_m, 0.0, high_m - 0.1}, 0.015, wood);
}

}  // namespace

Mesh make_tree(TreeKind kind, double foliage, Random random) {
  switch (kind) {
    case TreeKind::kLarge:
      return make_broadleaf(kLarge, foliage, random);
    case TreeKind::kSlim:
      return make_broadleaf(kSlim, foliage, random);
    case TreeKind::kConifer:
      return make_conifer(foliage, random);
    case TreeKind::kYoung: {
      Mesh mesh;
      add_stake(mesh, random);
      mesh.add(make_broadleaf(kYoung, foliage, random), Eigen::Isometry3d::Identity());
      return mesh;
    }
    case TreeKind::kStreet:
      break;
  }
  return make_broadleaf(kStreet, foliage, random);
}

Mesh make_bush(double foliage, Random random) { return make_broadleaf(kBush, foliage, random); }

Mesh make_tuft(double foliage, Random random) {
  const double height_m = random.uniform(0.22, 0.5);
  const double radius_m = height_m * random.uniform(0.3, 0.5);
  const int blades = 300 + static_cast<int>(random.index(200));
  Mesh mesh;
  const int kept = kept_of(blades, foliage);
  for (int i = 0; i < kept; ++i) {
    const double angle_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double out = std::sqrt(random.uniform());
    const Eigen::Vector3d outwards(std::cos(angle_rad), std::sin(angle_rad), 0.0);
    const Eigen::Vector3d foot = 0.6 * radius_m * out * outwards;
    const double high_m = height_m * std::sqrt(random.uniform(0.15, 1.0));
    // Blades at the rim hang outwards.
    const Eigen::Vector3d tip = foot + 0.9 * radius_m * out * random.uniform() * outwards +
                                high_m * Eigen::Vector3d::UnitZ();
    const double turn_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double half_m = random.uniform(0.006, 0.014);
    const Eigen::Vector3d flat(half_m * std::cos(turn_rad), half_m * std::sin(turn_rad), 0.0);
    mesh.add_triangle(foot - flat, foot + flat, tip, {Surface::kLeaf, random.uniform(0.7, 1.3)});
  }
  return mesh;
}

}  // namespace stillmap::simulation
