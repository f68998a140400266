#include "scenery/furniture.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <numbers>
#include <vector>

#include "scenery/parts.hpp"
#include "scenery/sign_plates.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

constexpr double kGround_m = -0.3;

void add_post(Mesh& mesh, double x, double y, double high_m, double radius_m, Material material,
              int sides = 8) {
  mesh.add_column({x, y, kGround_m}, {0.0, 0.0, high_m - kGround_m}, {radius_m, radius_m}, material,
                  sides);
}

/// Upright disc that looks to -x.
void add_disc(Mesh& mesh, const Vector3d& middle, double radius_m, Material material) {
  add_polygon(mesh, middle, radius_m * Vector3d::UnitZ(), radius_m * Vector3d::UnitY(), 10,
              material);
}

/// Housing with one lens above the other that looks to -x, its back's lower middle there.
void add_signal(Mesh& mesh, const Vector3d& low, int lenses, double lens_radius_m) {
  const double room_m = 2.6 * lens_radius_m;
  const double half_m = 1.4 * lens_radius_m;
  const double front_m = low.x() - 0.18;
  const Material housing(Surface::kFurniture, 0.35);
  add_box(mesh, {front_m, low.y() - half_m, low.z()},
          {low.x(), low.y() + half_m, low.z() + room_m * lenses}, housing);
  for (int i = 0; i < lenses; ++i) {
    const Vector3d middle(front_m - 0.01, low.y(), low.z() + room_m * (i + 0.5));
    add_disc(mesh, middle, lens_radius_m, {Surface::kFurniture, 1.2});
    // The hood covers a lens from above.
    const Vector3d side(0.0, lens_radius_m, 0.0);
    const Vector3d top(0.0, 0.0, 1.05 * lens_radius_m);
    const Vector3d out(-0.16, 0.0, 0.0);
    mesh.add_quad(middle - side, middle - 0.6 * side + top, middle - 0.6 * side + top + out,
                  middle - side + 0.6 * out, housing);
    mesh.add_quad(middle - 0.6 * side + top, middle + 0.6 * side + top,
                  middle + 0.6 * side + top + out, middle - 0.6 * side + top + out, housing);
    mesh.add_quad(middle + side, middle + 0.6 * side + top, middle + 0.6 * side + top + out,
                  middle + side + 0.6 * out, housing);
  }
}

/// Litter bin on a post.
void add_litter_bin(Mesh& mesh, const Material& material, Random& random) {
  const double low_m = random.uniform(0.35, 0.5);
  const double radius_m = random.uniform(0.17, 0.22);
  add_post(mesh, 0.0, radius_m + 0.04, low_m + 0.75, 0.03, Surface::kPole);
  mesh.add_column({0.0, 0.0, low_m}, {0.0, 0.0, 0.55}, {0.85 * radius_m, radius_m}, material, 10);
  add_polygon(mesh, {0.0, 0.0, low_m}, 0.85 * radius_m * Vector3d::UnitX(),
              0.85 * radius_m * Vector3d::UnitY(), 10, material);
}

/// Bin on two wheels; its handle and wheels are away from the road. Measures after EN 840-1.
void add_wheeled_bin(Mesh& mesh, const Material& material, Random& random) {
  const bool large = random.chance(0.5);
  const double width_m = large ? 0.58 : 0.48;
  const double depth_m = large ? 0.70 : 0.54;
  const double high_m = large ? 1.0 : 0.86;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.rotate(Eigen::AngleAxisd(random.uniform(-0.2, 0.2), Vector3d::UnitZ()));
  Mesh bin;
  add_tapered_box(bin, Eigen::Isometry3d::Identity(),
                  {{0.8 * width_m, 0.72 * depth_m}, {width_m, 0.95 * depth_m}, 0.06, high_m},
                  material);
  // The lid slopes to the front and stands over on all sides.
  const double w = 0.5 * width_m + 0.02;
  const double d = 0.5 * depth_m + 0.02;
  const Material lid(Surface::kFurniture, random.uniform(0.5, 1.6));
  const std::array<Vector3d, 4> rim{Vector3d(-w, -d, high_m), Vector3d(w, -d, high_m),
                                    Vector3d(w, d, high_m), Vector3d(-w, d, high_m)};
  const std::array<Vector3d, 4> top{
      Vector3d(-0.9 * w, -0.9 * d, high_m + 0.05), Vector3d(0.9 * w, -0.9 * d, high_m + 0.05),
      Vector3d(0.9 * w, 0.95 * d, high_m + 0.1), Vector3d(-0.9 * w, 0.95 * d, high_m + 0.1)};
  bin.add_quad(top[0], top[1], top[2], top[3], lid);
  for (std::size_t i = 0; i < rim.size(); ++i)
    bin.add_quad(rim.at(i), rim.at((i + 1) % 4), top.at((i + 1) % 4), top.at(i), lid);
  const double back_m = 0.5 * depth_m + 0.06;
  add_bar(bin, {-w, back_m, high_m + 0.03}, {w, back_m, high_m + 0.03}, 0.015, material, 4);
  for (const double side : {-1.0, 1.0}) {
    const double x = side * 0.46 * width_m;
    bin.add_column({x, 0.42 * depth_m, 0.1}, {side * 0.05, 0.0, 0.0}, {0.1, 0.1},
                   {Surface::kFurniture, 0.3}, 10);
    add_bar(bin, {x, d, high_m}, {x, back_m, high_m + 0.03}, 0.015, material);
  }
  mesh.add(bin, T);
}

/// One to three plates on a post, a note below a sign if any.
std::vector<PlateShape> draw_plates(Random& random) {
  std::vector<PlateShape> plates;
  if (random.chance(0.35)) plates.push_back(PlateShape::kNote);
  const std::size_t signs = random.chance(0.3) ? 2 : 1;
  for (std::size_t i = 0; i < signs; ++i)
    plates.push_back(static_cast<PlateShape>(random.index(static_cast<int>(PlateShape::kNote))));
  return plates;
}

}  // namespace

Mesh make_lamp(Random& random) {
  const double high_m = random.uniform(5.0, 9.0);
  const double reach_m = random.uniform(0.8, 0.25 * high_m);
  const double rise_m = random.uniform(0.1, 0.5);
  const Material pole(Surface::kPole, random.uniform(0.7, 1.3));
  Mesh mesh;
  // Its door and cables sit in a wider foot.
  add_post(mesh, 0.0, 0.0, 1.1, 0.009 * high_m + 0.035, pole, 10);
  mesh.add_column({0.0, 0.0, kGround_m}, {0.0, 0.0, high_m - kGround_m},
                  {0.009 * high_m + 0.015, 0.04}, pole, 10);
  constexpr int kBends = 4;
  Vector3d from(0.0, 0.0, high_m);
  for (int i = 1; i <= kBends; ++i) {
    const double t = static_cast<double>(i) / kBends;
    // Rises steeply first and ends level.
    const Vector3d to(0.0, -reach_m * t, high_m + rise_m * t * (2.0 - t));
    add_bar(mesh, from, to, 0.032, pole, 6);
    from = to;
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = from + Vector3d(0.0, -0.25, 0.0);
  add_tapered_box(mesh, T, {{0.3, 0.7}, {0.16, 0.5}, -0.06, 0.06}, pole);
  return mesh;
}

Mesh make_traffic_sign(Random& random) {
  const std::vector<PlateShape> plates = draw_plates(random);
  Mesh mesh;
  double z = random.uniform(2.0, 2.25);
  for (const PlateShape plate : plates) {
    add_plate(mesh, plate, {-0.045, 0.0, z});
    for (const double share : {0.25, 0.75}) {
      const double clamp_m = z + share * plate_height_m(plate);
      add_bar(mesh, {-0.038, -0.05, clamp_m}, {-0.038, 0.05, clamp_m}, 0.012, Surface::kPole);
    }
    z += plate_height_m(plate) + 0.03;
  }
  add_post(mesh, 0.0, 0.0, z - 0.06, 0.032, Surface::kPole);
  return mesh;
}

Mesh make_traffic_light(Random& random) {
  constexpr double kLens_m = 0.1;
  const bool arm = random.chance(0.4);
  const double high_m = arm ? 5.6 : random.uniform(3.2, 3.6);
  const Material pole(Surface::kPole, random.uniform(0.6, 1.2));
  Mesh mesh;
  mesh.add_column({0.0, 0.0, kGround_m}, {0.0, 0.0, high_m - kGround_m},
                  {arm ? 0.1 : 0.07, arm ? 0.07 : 0.06}, pole, 10);
  add_signal(mesh, {-0.14, 0.0, 2.3}, 3, kLens_m);
  for (const double z : {2.4, 3.0}) add_bar(mesh, {-0.14, 0.0, z}, {0.0, 0.0, z}, 0.02, pole);
  // For who walks across the road: looks to the carriageway.
  Mesh walkers;
  add_signal(walkers, {-0.12, 0.0, 2.1}, 2, kLens_m);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.rotate(Eigen::AngleAxisd(-0.5 * std::numbers::pi, Vector3d::UnitZ()));
  mesh.add(walkers, T);
  add_box(mesh, {-0.06, -0.15, 0.95}, {0.06, -0.06, 1.2}, {Surface::kFurniture, 1.3});
  if (!arm) return mesh;
  const double reach_m = random.uniform(2.8, 4.0);
  add_bar(mesh, {0.0, 0.0, 5.4}, {0.0, reach_m, 5.6}, 0.05, pole, 8);
  // A dark board behind it, so that it is seen against the sky.
  const double y = reach_m - 0.3;
  add_signal(mesh, {-0.1, y, 5.15}, 3, kLens_m);
  add_box(mesh, {-0.1, y - 0.3, 5.05}, {-0.09, y + 0.3, 6.03}, {Surface::kFurniture, 0.35});
  return mesh;
}

Mesh make_bollard(Random& random) {
  const double high_m = random.uniform(0.8, 1.1);
  const double radius_m = random.uniform(0.04, 0.08);
  const Material material(Surface::kPole, random.uniform(0.5, 1.4));
  Mesh mesh;
  add_post(mesh, 0.0, 0.0, high_m - 0.5 * radius_m, radius_m, material, 10);
  mesh.add_column({0.0, 0.0, high_m - 0.5 * radius_m}, {0.0, 0.0, 0.5 * radius_m},
                  {radius_m, 0.5 * radius_m}, material, 10);
  // White band under the top.
  add_bar(mesh, {0.0, 0.0, high_m - 0.22}, {0.0, 0.0, high_m - 0.12}, radius_m + 0.003,
          {Surface::kPole, 1.9}, 10);
  return mesh;
}

Mesh make_bin(Random& random) {
  const Material material(Surface::kFurniture, random.uniform(0.4, 1.3));
  Mesh mesh;
  if (random.chance(0.25)) {
    add_litter_bin(mesh, material, random);
  } else {
    add_wheeled_bin(mesh, material, random);
  }
  return mesh;
}

/// One sits on it looking at the road.
Mesh make_bench(Random& random) {
  const double half_m = 0.5 * random.uniform(1.4, 1.9);
  const Material wood(Surface::kFurniture, random.uniform(0.7, 1.4));
  const Material metal(Surface::kFurniture, 0.6);
  Mesh mesh;
  for (int i = 0; i < 4; ++i) {
    const double y = -0.22 + 0.115 * i;
    add_box(mesh, {-half_m, y, 0.42}, {half_m, y + 0.095, 0.455}, wood);
  }
  for (int i = 0; i < 3; ++i) {
    const double z = 0.53 + 0.125 * i;
    const double y = 0.25 + 0.03 * i;
    mesh.add_quad({-half_m, y, z}, {half_m, y, z}, {half_m, y + 0.025, z + 0.1},
                  {-half_m, y + 0.025, z + 0.1}, wood);
  }
  for (const double x : {-0.75 * half_m, 0.75 * half_m}) {
    add_box(mesh, {x - 0.025, -0.2, kGround_m}, {x + 0.025, -0.15, 0.42}, metal);
    add_box(mesh, {x - 0.025, 0.2, kGround_m}, {x + 0.025, 0.25, 0.42}, metal);
    add_bar(mesh, {x, 0.25, 0.4}, {x, 0.35, 0.9}, 0.025, metal, 4);
  }
  return mesh;
}

Mesh make_cabinet(Random& random) {
  const double half_m = 0.5 * random.uniform(0.6, 1.4);
  const double depth_m = random.uniform(0.32, 0.42);
  const double high_m = random.uniform(0.9, 1.35);
  const Material body(Surface::kFurniture, random.uniform(0.9, 1.6));
  Mesh mesh;
  add_box(mesh, {-half_m + 0.02, 0.02, kGround_m}, {half_m - 0.02, depth_m - 0.02, 0.15},
          {Surface::kFurniture, 0.8});
  add_box(mesh, {-half_m, 0.0, 0.15}, {half_m, depth_m, high_m - 0.06}, body);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Vector3d(0.0, 0.5 * depth_m, 0.0);
  const Eigen::Vector2d roof(2.0 * half_m + 0.05, depth_m + 0.05);
  add_tapered_box(mesh, T, {roof, 0.9 * roof, high_m - 0.06, high_m}, body);
  // Its doors stand out a little.
  const int doors = half_m > 0.5 ? 2 : 1;
  const double width_m = (2.0 * half_m - 0.06) / doors;
  for (int i = 0; i < doors; ++i) {
    const double x = -half_m + 0.03 + width_m * i;
    add_box(mesh, {x + 0.01, -0.015, 0.2}, {x + width_m - 0.01, 0.0, high_m - 0.1}, body);
  }
  return mesh;
}

Mesh make_utility_pole(Random& random) {
  const double high_m = random.uniform(7.0, 9.5);
  const Material wood(Surface::kPole, random.uniform(0.5, 0.9));
  Mesh mesh;
  mesh.add_column({0.0, 0.0, kGround_m}, {0.0, 0.0, high_m - kGround_m}, {0.14, 0.09}, wood, 10);
  // Wires run along the road, so the arms lie across it.
  const int arms = random.chance(0.5) ? 2 : 1;
  for (int i = 0; i < arms; ++i) {
    const double z = high_m - 0.35 - 0.7 * i;
    add_box(mesh, {0.09, -0.8, z - 0.06}, {0.18, 0.8, z + 0.06}, wood);
    for (const double y : {-0.7, -0.35, 0.35, 0.7}) {
      mesh.add_column({0.135, y, z + 0.06}, {0.0, 0.0, 0.16}, {0.03, 0.045}, {Surface::kPole, 1.4},
                      6);
    }
    for (const double side : {-1.0, 1.0})
      add_bar(mesh, {0.12, side * 0.5, z}, {0.12, 0.0, z - 0.5}, 0.015, wood);
  }
  return mesh;
}

}  // namespace stillmap::simulation
