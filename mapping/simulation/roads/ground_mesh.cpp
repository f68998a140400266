#include "roads/ground_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "geometry/random.hpp"
#include "roads/lane_markings.hpp"

namespace stillmap::simulation {
namespace {

/// Corner of a cell, with what decides how the cell is cut.
struct Corner {
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  /// RoadPlace::outside_m; far when no road is in reach.
  double outside = 0.0;
  double rough = 0.0;
};

Corner between(const Corner& a, const Corner& b, double level) {
  const double t = (level - a.outside) / (b.outside - a.outside);
  return {a.p + t * (b.p - a.p), level, a.rough + t * (b.rough - a.rough)};
}

class GroundBuilder {
 public:
  GroundBuilder(const Terrain& terrain, const RoadNetwork& network, const GroundCover& cover,
                std::uint64_t seed)
      : terrain_(terrain), network_(network), cover_(cover), seed_(seed) {}

  Mesh build() {
    const Eigen::AlignedBox2d bounds = terrain_.bounds();
    const auto columns = static_cast<std::size_t>(bounds.sizes().x());
    const auto rows = static_cast<std::size_t>(bounds.sizes().y());
    std::vector<Lattice> below(columns + 1);
    std::vector<Lattice> above(columns + 1);
    for (std::size_t y = 0; y <= rows; ++y) {
      for (std::size_t x = 0; x <= columns; ++x) {
        above[x] = lattice_at(bounds.min() +
                              Eigen::Vector2d(static_cast<double>(x), static_cast<double>(y)));
      }
      for (std::size_t x = 0; y > 0 && x < columns; ++x) {
        add_cell({&below[x], &below[x + 1], &above[x + 1], &above[x]});
      }
      std::swap(below, above);
    }
    return std::move(mesh_);
  }

 private:
  struct Lattice {
    Corner corner;
    std::optional<RoadPlace> place;
    bool covered = false;
    std::optional<std::uint32_t> vertex;
  };

  Lattice lattice_at(const Eigen::Vector2d& p) {
    Lattice lattice;
    lattice.covered = terrain_.covers(p);
    if (!lattice.covered) return lattice;
    lattice.place = network_.place(p);
    Random random(key_of({seed_, static_cast<std::uint64_t>(Stream::kGround),
                          static_cast<std::uint64_t>(std::llround(p.x())),
                          static_cast<std::uint64_t>(std::llround(p.y()))}));
    const double outside =
        lattice.place ? lattice.place->outside_m : std::numeric_limits<double>::max();
    const double edge =
        lattice.place ? network_.edges()[lattice.place->edge].section.pavement_width + 0.5 : 0.0;
    const double amplitude = outside > edge ? cover_.beside_roughness_m : cover_.road_roughness_m;
    lattice.corner = {p, outside, amplitude * random.uniform(-1.0, 1.0)};
    return lattice;
  }

  double height(const Corner& c) const {
    RoadPlace place = network_.place(c.p).value_or(RoadPlace{});
    place.outside_m = c.outside;
    return terrain_.height(c.p, place) + c.rough;
  }

  std::uint32_t vertex_of(Lattice& lattice) {
    if (!lattice.vertex) {
      const Corner& c = lattice.corner;
      const double z = lattice.place ? terrain_.height(c.p, *lattice.place) : terrain_.height(c.p);
      lattice.vertex = static_cast<std::uint32_t>(mesh_.vertices.size());
      mesh_.vertices.push_back(Eigen::Vector3d(c.p.x(), c.p.y(), z + c.rough).cast<float>());
    }
    return *lattice.vertex;
  }

  Surface surface_at(double outside, double pavement) const {
    if (outside < 0.0) return Surface::kAsphalt;
    return outside < pavement ? Surface::kPavement : cover_.beside;
  }

  void add_cell(const std::array<Lattice*, 4>& cell) {
    if (!std::all_of(cell.begin(), cell.end(), [](const Lattice* c) { return c->covered; })) return;
    const double pavement =
        cell[0]->place ? network_.edges()[cell[0]->place->edge].section.pavement_width : 0.0;
    const std::array<double, 3> levels{0.0, Terrain::kKerbWidth,
                                       std::max(pavement, 2.0 * Terrain::kKerbWidth)};
    double low = std::numeric_limits<double>::max();
    double high = std::numeric_limits<double>::lowest();
    for (const Lattice* c : cell) {
      low = std::min(low, c->corner.outside);
      high = std::max(high, c->corner.outside);
    }
    const bool cut = std::any_of(levels.begin(), levels.end(),
                                 [&](double level) { return low < level && level < high; });
    for (const auto& [a, b, c] : {std::array{0, 1, 2}, std::array{0, 2, 3}}) {
      const auto corner = [&](int i) -> Lattice& { return *cell.at(static_cast<std::size_t>(i)); };
      if (!cut) {
        mesh_.triangles.push_back(
            {vertex_of(corner(a)), vertex_of(corner(b)), vertex_of(corner(c))});
        const Surface surface = surface_at(0.5 * (low + high), pavement);
        mesh_.materials.emplace_back(surface, brightness(surface, *cell[0]));
      } else {
        brightness_ = [this, &cell](Surface surface) { return brightness(surface, *cell[0]); };
        add_cut({corner(a).corner, corner(b).corner, corner(c).corner}, levels, pavement);
      }
    }
  }

  /// Roads are laid in different years and patched; each metre differs a little.
  double brightness(Surface surface, const Lattice& lattice) const {
    const std::uint64_t edge = lattice.place ? lattice.place->edge : 0;
    Random of_road(key_of({seed_, static_cast<std::uint64_t>(Stream::kGround), 7,
                           static_cast<std::uint64_t>(surface), edge}));
    Random of_cell(key_of({seed_, static_cast<std::uint64_t>(Stream::kGround), 8,
                           static_cast<std::uint64_t>(std::llround(lattice.corner.p.x())),
                           static_cast<std::uint64_t>(std::llround(lattice.corner.p.y()))}));
    return of_road.uniform(0.75, 1.2) * of_cell.uniform(0.88, 1.12);
  }

  /// Cuts a triangle at the first level that crosses it, and its parts at the next ones.
  void add_cut(std::array<Corner, 3> t, std::span<const double> levels, double pavement) {
    while (!levels.empty()) {
      const double level = levels.front();
      const auto above = [&](const Corner& c) { return c.outside > level; };
      const auto count = std::count_if(t.begin(), t.end(), above);
      if (count == 1 || count == 2) {
        // Turned so that the first corner is alone on its side.
        const bool lone_above = count == 1;
        while (above(t[0]) != lone_above || above(t[1]) == lone_above)
          std::rotate(t.begin(), t.begin() + 1, t.end());
        const Corner ab = between(t[0], t[1], level);
        const Corner ac = between(t[0], t[2], level);
        const auto rest = levels.subspan(1);
        add_cut({t[0], ab, ac}, rest, pavement);
        add_cut({ab, t[1], t[2]}, rest, pavement);
        add_cut({ab, t[2], ac}, rest, pavement);
        return;
      }
      levels = levels.subspan(1);
    }
    const double middle = (t[0].outside + t[1].outside + t[2].outside) / 3.0;
    std::array<Eigen::Vector3d, 3> v;
    for (std::size_t i = 0; i < 3; ++i) v.at(i) << t.at(i).p, height(t.at(i));
    const Surface surface = surface_at(middle, pavement);
    mesh_.add_triangle(v[0], v[1], v[2], {surface, brightness_(surface)});
  }

  const Terrain& terrain_;
  const RoadNetwork& network_;
  GroundCover cover_;
  std::uint64_t seed_;
  Mesh mesh_;
  /// Of the cell that is being cut.
  std::function<double(Surface)> brightness_;
};

}  // namespace

Mesh make_ground(const Terrain& terrain, const RoadNetwork& network, const GroundCover& cover,
                 std::uint64_t seed) {
  Mesh mesh = GroundBuilder(terrain, network, cover, seed).build();
  add_lane_markings(mesh, terrain, network);
  return mesh;
}

}  // namespace stillmap::simulation
