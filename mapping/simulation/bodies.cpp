#include "bodies.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <span>

namespace stillmap::simulation {
namespace {

/// Measures of a vehicle [m], along its length from the front bumper.
struct VehicleShape {
  maps::ObjectClass object_class;
  double length, width, height;
  /// Where the bonnet meets the windscreen, where the roof starts and ends, where the rear window
  /// ends.
  double screen_foot, roof_front, roof_rear, rear_foot;
  /// Height of the bonnet and of the lower edge of the side windows.
  double bonnet, belt;
};

constexpr std::array<VehicleShape, 5> kShapes{{
    {maps::ObjectClass::kCar, 3.60, 1.64, 1.48, 0.85, 1.50, 3.05, 3.50, 0.90, 0.95},
    {maps::ObjectClass::kCar, 4.50, 1.80, 1.44, 1.20, 2.05, 3.25, 3.85, 0.85, 0.92},
    {maps::ObjectClass::kCar, 4.70, 1.82, 1.50, 1.20, 2.05, 4.20, 4.62, 0.86, 0.94},
    {maps::ObjectClass::kCar, 4.60, 1.90, 1.70, 1.10, 1.85, 3.95, 4.50, 1.02, 1.10},
    {maps::ObjectClass::kVan, 5.20, 1.95, 2.05, 0.75, 1.35, 5.05, 5.15, 1.10, 1.15},
}};

constexpr double kSill = 0.2;
constexpr double kWheelRadius = 0.32;
constexpr double kWheelWidth = 0.2;

/// Section of a body across its length: half width and height range at x.
struct Section {
  double x, half_width, low, high;
};

std::array<Eigen::Vector3d, 4> corners(const Section& s) {
  return {{{s.x, s.half_width, s.low},
           {s.x, s.half_width, s.high},
           {s.x, -s.half_width, s.high},
           {s.x, -s.half_width, s.low}}};
}

/// Skin around sections from front to rear, closed at both ends.
void add_hull(Mesh& mesh, std::span<const Section> sections, Surface surface) {
  for (std::size_t i = 0; i + 1 < sections.size(); ++i) {
    const auto a = corners(sections[i]);
    const auto b = corners(sections[i + 1]);
    for (std::size_t k = 0; k < 4; ++k) {
      mesh.add_quad(a[k], a[(k + 1) % 4], b[(k + 1) % 4], b[k], surface);
    }
  }
  for (const Section& end : {sections.front(), sections.back()}) {
    const auto c = corners(end);
    mesh.add_quad(c[0], c[1], c[2], c[3], surface);
  }
}

/// Body below the windows; bumpers are narrower and lower, so that the corners are not square.
void add_lower_body(Mesh& mesh, const VehicleShape& v) {
  const double front = 0.5 * v.length;
  const double half = 0.5 * v.width;
  const auto at = [&](double from_front) { return front - from_front; };
  const std::array<Section, 7> sections{{
      {at(0.0), 0.62 * half, 0.35, 0.55},
      {at(0.12), 0.86 * half, kSill + 0.05, 0.72},
      {at(0.40), 0.98 * half, kSill, v.bonnet - 0.08},
      {at(v.screen_foot), half, kSill, v.bonnet},
      {at(v.rear_foot - 0.2), half, kSill, v.belt},
      {at(v.length - 0.12), 0.9 * half, kSill + 0.05, v.belt - 0.04},
      {at(v.length), 0.72 * half, 0.35, 0.75},
  }};
  add_hull(mesh, sections, Surface::kPaint);
}

/// Windows all around, between belt and roof, leaning inwards; and the roof.
void add_cabin(Mesh& mesh, const VehicleShape& v) {
  const double front = 0.5 * v.length;
  const double low = 0.5 * v.width - 0.02;
  const double high = 0.5 * v.width - 0.02 - 0.22 * (v.height - v.belt);
  const std::array<Eigen::Vector3d, 4> belt{{{front - v.screen_foot, low, v.belt},
                                             {front - v.screen_foot, -low, v.belt},
                                             {front - v.rear_foot, -low, v.belt},
                                             {front - v.rear_foot, low, v.belt}}};
  const std::array<Eigen::Vector3d, 4> roof{{{front - v.roof_front, high, v.height},
                                             {front - v.roof_front, -high, v.height},
                                             {front - v.roof_rear, -high, v.height},
                                             {front - v.roof_rear, high, v.height}}};
  const bool panelled = v.object_class == maps::ObjectClass::kVan;
  for (std::size_t k = 0; k < 4; ++k) {
    // A van has glass in front only.
    const Surface side = panelled && k != 0 ? Surface::kPaint : Surface::kCarGlass;
    mesh.add_quad(belt[k], belt[(k + 1) % 4], roof[(k + 1) % 4], roof[k], side);
    // The pillar between two windows.
    const Eigen::Vector3d lean = roof[k] - belt[k];
    mesh.add_column(belt[k] - 0.02 * belt[k].cwiseProduct(Eigen::Vector3d(0.0, 1.0, 0.0)), lean,
                    {0.04, 0.04}, Surface::kPaint);
  }
  mesh.add_quad(roof[0], roof[1], roof[2], roof[3], Surface::kPaint);
}

void add_wheels(Mesh& mesh, const VehicleShape& v) {
  for (const double x : {0.5 * v.length - 0.8, -0.5 * v.length + 0.8}) {
    for (const double side : {-1.0, 1.0}) {
      const double y = side * (0.5 * v.width - kWheelWidth);
      // A twelve-sided wheel of this radius touches z = 0 with a corner.
      mesh.add_column({x, y, kWheelRadius}, {0.0, side * (kWheelWidth - 0.01), 0.0},
                      {kWheelRadius, kWheelRadius}, Surface::kTyre);
    }
  }
}

Mesh make_capsule(double height, double radius) {
  constexpr int kRings = 10;
  constexpr int kSides = 12;
  const auto at = [&](int ring, int side) {
    const double polar = std::numbers::pi * ring / kRings;
    const double angle = 2.0 * std::numbers::pi * side / kSides;
    const double middle = 2 * ring <= kRings ? radius : height - radius;
    const double r = radius * std::sin(polar);
    return Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle),
                           middle - radius * std::cos(polar));
  };
  Mesh mesh;
  for (int ring = 0; ring < kRings; ++ring) {
    for (int side = 0; side < kSides; ++side) {
      mesh.add_quad(at(ring, side), at(ring, side + 1), at(ring + 1, side + 1), at(ring + 1, side),
                    Surface::kCloth);
    }
  }
  return mesh;
}

}  // namespace

std::vector<Body> make_vehicles() {
  std::vector<Body> bodies;
  for (const VehicleShape& shape : kShapes) {
    Body body{.object_class = shape.object_class, .mesh = {}};
    add_lower_body(body.mesh, shape);
    add_cabin(body.mesh, shape);
    add_wheels(body.mesh, shape);
    bodies.push_back(std::move(body));
  }
  return bodies;
}

std::vector<Body> make_persons() {
  std::vector<Body> bodies;
  for (const double height : {1.62, 1.75, 1.88}) {
    bodies.push_back({maps::ObjectClass::kPedestrian, make_capsule(height, 0.25)});
  }
  return bodies;
}

}  // namespace stillmap::simulation
