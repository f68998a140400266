#include "accuracy/truth_ground.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>

namespace stillmap::test {
namespace {

constexpr double kCellM = 2.0;

long long key_of(long long ix, long long iy) { return (ix << 32) ^ (iy & 0xffffffffLL); }

long long cell_of(double coordinate) {
  return static_cast<long long>(std::floor(coordinate / kCellM));
}

template <typename T>
T take(std::ifstream& in, const std::string& file) {
  T value;
  if (!in.read(reinterpret_cast<char*>(&value), sizeof value))
    throw maps::InputError(file, "its end", "more vertices or faces");
  return value;
}

struct Header {
  std::size_t vertices = 0, faces = 0;
};

Header read_header(std::ifstream& in, const std::string& file) {
  Header header;
  std::string line, properties;
  while (std::getline(in, line) && line != "end_header") {
    if (line.starts_with("element vertex ")) header.vertices = std::stoul(line.substr(15));
    if (line.starts_with("element face ")) header.faces = std::stoul(line.substr(13));
    if (line.starts_with("property ")) properties += line.substr(9) + ";";
  }
  const std::string expected = "float x;float y;float z;list uchar int vertex_indices;int label;";
  if (properties != expected) throw maps::InputError(file, properties, expected);
  return header;
}

}  // namespace

TruthGround TruthGround::read(const std::filesystem::path& ply_file) {
  const std::string file = ply_file.string();
  std::ifstream in(ply_file, std::ios::binary);
  const Header header = read_header(in, file);
  TruthGround ground;
  for (std::size_t i = 0; i < header.vertices; ++i) {
    const auto p = take<std::array<float, 3>>(in, file);
    ground.vertices_.emplace_back(p[0], p[1], p[2]);
  }
  for (std::size_t i = 0; i < header.faces; ++i) {
    const auto corners = take<std::uint8_t>(in, file);
    const auto indices = take<std::array<std::int32_t, 3>>(in, file);
    take<std::int32_t>(in, file);
    const auto [least, most] = std::minmax_element(indices.begin(), indices.end());
    if (corners != 3 || *least < 0 || static_cast<std::size_t>(*most) >= header.vertices)
      throw maps::InputError(file, "a face of other corners", "three indices of vertices");
    ground.triangles_.push_back({indices[0], indices[1], indices[2]});
    ground.add_to_cells(static_cast<int>(i));
  }
  return ground;
}

void TruthGround::add_to_cells(int triangle) {
  Eigen::Vector2f low = Eigen::Vector2f::Constant(1e30F), high = -low;
  for (const int corner : triangles_[static_cast<std::size_t>(triangle)]) {
    const Eigen::Vector2f p = vertices_[static_cast<std::size_t>(corner)].head<2>();
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  for (long long ix = cell_of(low.x()); ix <= cell_of(high.x()); ++ix) {
    for (long long iy = cell_of(low.y()); iy <= cell_of(high.y()); ++iy)
      cells_[key_of(ix, iy)].push_back(triangle);
  }
}

std::optional<double> TruthGround::height_at(const Eigen::Vector3d& p_map) const {
  const auto cell = cells_.find(key_of(cell_of(p_map.x()), cell_of(p_map.y())));
  if (cell == cells_.end()) return std::nullopt;
  std::optional<double> nearest;
  for (const int triangle : cell->second) {
    std::array<Eigen::Vector3d, 3> v;
    for (std::size_t k = 0; k < 3; ++k) {
      const int corner = triangles_[static_cast<std::size_t>(triangle)][k];
      v[k] = vertices_[static_cast<std::size_t>(corner)].cast<double>();
    }
    // Barycentric coordinates in x, y.
    const Eigen::Vector2d a = (v[1] - v[0]).head<2>(), b = (v[2] - v[0]).head<2>();
    const Eigen::Vector2d q = (p_map - v[0]).head<2>();
    const double area = a.x() * b.y() - a.y() * b.x();
    const double s = (q.x() * b.y() - q.y() * b.x()) / area;
    const double t = (a.x() * q.y() - a.y() * q.x()) / area;
    if (!(s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9)) continue;
    const double z = v[0].z() + s * (v[1].z() - v[0].z()) + t * (v[2].z() - v[0].z());
    if (!nearest || std::abs(z - p_map.z()) < std::abs(*nearest - p_map.z())) nearest = z;
  }
  return nearest;
}

}  // namespace stillmap::test
