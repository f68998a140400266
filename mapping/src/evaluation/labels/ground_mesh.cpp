#include "evaluation/labels/ground_mesh.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Some 20 of the simulator's triangles.
constexpr double kMeshCellM = 4.0;
constexpr double kMostM = 1e5;
constexpr double kMostExtentM = 5e4;
/// A place on an edge belongs to both sides, whatever rounding says.
constexpr double kOnEdge = 1e-6;

constexpr std::size_t kVertexBytes = 12;
constexpr std::size_t kFaceBytes = 17;
constexpr std::size_t kMostHeaderBytes = 4096;
/// 2 GiB of ground: far more than any drive has.
constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 31U;

}  // namespace

GroundMesh::GroundMesh(std::vector<Eigen::Vector3f> vertices, std::vector<Triangle> triangles)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(std::numeric_limits<double>::max());
  Eigen::Vector2d max = -min;
  for (const Eigen::Vector3f& vertex : vertices_) {
    if (!vertex.allFinite() || !(vertex.cwiseAbs().maxCoeff() < kMostM))
      throw std::invalid_argument("ground mesh: a vertex that is not finite or beyond 100 km");
    min = min.cwiseMin(vertex.head<2>().cast<double>());
    max = max.cwiseMax(vertex.head<2>().cast<double>());
  }
  for (const Triangle& triangle : triangles_) {
    for (const std::uint32_t corner : triangle) {
      if (corner >= vertices_.size())
        throw std::invalid_argument(fmt::format(
            "ground mesh: vertex {} of a triangle, expected < {}", corner, vertices_.size()));
    }
  }
  if (triangles_.empty()) return;
  if (!((max - min).maxCoeff() < kMostExtentM))
    throw std::invalid_argument("ground mesh: wider than 50 km");
  min_ = min;
  columns_ = static_cast<std::int64_t>((max - min).x() / kMeshCellM) + 1;
  rows_ = static_cast<std::int64_t>((max - min).y() / kMeshCellM) + 1;
  sort_into_cells();
}

std::array<std::int64_t, 2> GroundMesh::cell_of(double x, double y) const {
  return {static_cast<std::int64_t>(std::floor((x - min_.x()) / kMeshCellM)),
          static_cast<std::int64_t>(std::floor((y - min_.y()) / kMeshCellM))};
}

/// Every cell that the triangle's bounding rectangle touches.
template <typename Visit>
void GroundMesh::for_each_cell(const Triangle& triangle, const Visit& visit) const {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::max());
  Eigen::Vector2d high = -low;
  for (const std::uint32_t corner : triangle) {
    low = low.cwiseMin(vertices_[corner].head<2>().cast<double>());
    high = high.cwiseMax(vertices_[corner].head<2>().cast<double>());
  }
  const auto first = cell_of(low.x(), low.y());
  const auto last = cell_of(high.x(), high.y());
  for (std::int64_t row = first[1]; row <= last[1]; ++row) {
    for (std::int64_t column = first[0]; column <= last[0]; ++column)
      visit(static_cast<std::size_t>(row * columns_ + column));
  }
}

void GroundMesh::sort_into_cells() {
  begins_.assign(static_cast<std::size_t>(columns_ * rows_) + 1, 0);
  for (const Triangle& triangle : triangles_)
    for_each_cell(triangle, [this](std::size_t cell) { ++begins_[cell + 1]; });
  for (std::size_t cell = 1; cell < begins_.size(); ++cell) begins_[cell] += begins_[cell - 1];
  members_.resize(begins_.back());
  std::vector<std::uint32_t> next(begins_.begin(), begins_.end() - 1);
  for (std::size_t i = 0; i < triangles_.size(); ++i) {
    for_each_cell(triangles_[i], [&](std::size_t cell) {
      members_[next[cell]++] = static_cast<std::uint32_t>(i);
    });
  }
}

std::optional<double> GroundMesh::height_on(const Triangle& triangle, double x, double y) const {
  const Eigen::Vector3d a = vertices_[triangle[0]].cast<double>();
  const Eigen::Vector3d ab = vertices_[triangle[1]].cast<double>() - a;
  const Eigen::Vector3d ac = vertices_[triangle[2]].cast<double>() - a;
  const double area = ab.x() * ac.y() - ab.y() * ac.x();
  // Upright faces have no height of their own; their edges belong to the neighbours.
  if (!(std::abs(area) > 1e-12)) return std::nullopt;
  const double dx = x - a.x();
  const double dy = y - a.y();
  const double b = (dx * ac.y() - dy * ac.x()) / area;
  const double c = (dy * ab.x() - dx * ab.y()) / area;
  if (!(b >= -kOnEdge && c >= -kOnEdge && b + c <= 1.0 + kOnEdge)) return std::nullopt;
  return a.z() + b * ab.z() + c * ac.z();
}

std::optional<double> GroundMesh::height(double x, double y) const {
  if (!(std::abs(x) < 2.0 * kMostM && std::abs(y) < 2.0 * kMostM)) return std::nullopt;
  const auto [column, row] = cell_of(x, y);
  if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return std::nullopt;
  const auto cell = static_cast<std::size_t>(row * columns_ + column);
  std::optional<double> highest;
  for (std::uint32_t i = begins_[cell]; i < begins_[cell + 1]; ++i) {
    const auto found = height_on(triangles_[members_[i]], x, y);
    if (found && (!highest || *found > *highest)) highest = found;
  }
  return highest;
}

namespace {

/// The header, a line each time; comments are passed over.
class HeaderLines {
 public:
  HeaderLines(std::string_view text, std::string name)
      : text_(text.substr(0, kMostHeaderBytes)), name_(std::move(name)) {}

  void expect(std::string_view line) {
    const std::string_view found = next();
    if (found != line) refuse(found, line);
  }
  std::size_t expect_count(std::string_view words) {
    const std::string_view line = next();
    std::size_t count = 0;
    if (line.starts_with(words)) {
      const char* const end = line.data() + line.size();
      const auto [last, error] = std::from_chars(line.data() + words.size(), end, count);
      if (error == std::errc() && last == end) return count;
    }
    refuse(line, fmt::format("{}COUNT", words));
  }
  [[nodiscard]] std::size_t size() const { return at_; }

 private:
  std::string_view next() {
    while (true) {
      const std::size_t end = text_.find('\n', at_);
      if (end == std::string_view::npos) refuse("a header without its end", "end_header");
      const std::string_view line = text_.substr(at_, end - at_);
      at_ = end + 1;
      if (!line.starts_with("comment")) return line;
    }
  }
  [[noreturn]] void refuse(std::string_view found, std::string_view expected) const {
    throw maps::InputError(name_, fmt::format("'{}'", found.substr(0, 64)),
                           fmt::format("'{}'", expected));
  }

  std::string_view text_;
  std::string name_;
  std::size_t at_ = 0;
};

template <typename Number>
Number number_at(const char* bytes) {
  Number number{};
  std::memcpy(&number, bytes, sizeof(number));
  return number;
}

std::vector<GroundMesh::Triangle> triangles_of(std::string_view bytes, std::size_t vertices,
                                               const std::string& name) {
  std::vector<GroundMesh::Triangle> triangles(bytes.size() / kFaceBytes);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const char* const face = bytes.data() + i * kFaceBytes;
    if (face[0] != 3)
      throw maps::InputError(name, fmt::format("face {} of {} corners", i, int{face[0]}), "3");
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const auto index = number_at<std::int32_t>(face + 1 + 4 * corner);
      if (index < 0 || static_cast<std::size_t>(index) >= vertices)
        throw maps::InputError(name, fmt::format("face {} with vertex {}", i, index),
                               fmt::format("a vertex in [0, {})", vertices));
      triangles[i][corner] = static_cast<std::uint32_t>(index);
    }
  }
  return triangles;
}

}  // namespace

GroundMesh read_ground_mesh(const std::filesystem::path& file) {
  const std::string name = file.string();
  const std::string bytes = maps::read_text(file, kMostBytes);
  HeaderLines header(bytes, name);
  header.expect("ply");
  header.expect("format binary_little_endian 1.0");
  const std::size_t vertices = header.expect_count("element vertex ");
  for (const std::string_view line : {"property float x", "property float y", "property float z"})
    header.expect(line);
  const std::size_t faces = header.expect_count("element face ");
  for (const std::string_view line :
       {"property list uchar int vertex_indices", "property int label", "end_header"})
    header.expect(line);
  const std::size_t body = bytes.size() - header.size();
  // Counts are compared by division first, so that no product of theirs can overflow.
  if (vertices > body / kVertexBytes || faces > body / kFaceBytes ||
      vertices * kVertexBytes + faces * kFaceBytes != body) {
    throw maps::InputError(name, fmt::format("{} bytes after the header", body),
                           fmt::format("{} vertices and {} faces", vertices, faces));
  }
  std::vector<Eigen::Vector3f> positions(vertices);
  for (std::size_t i = 0; i < vertices; ++i) {
    const char* const vertex = bytes.data() + header.size() + i * kVertexBytes;
    positions[i] = {number_at<float>(vertex), number_at<float>(vertex + 4),
                    number_at<float>(vertex + 8)};
  }
  const std::string_view rest =
      std::string_view(bytes).substr(header.size() + vertices * kVertexBytes);
  try {
    return {std::move(positions), triangles_of(rest, vertices, name)};
  } catch (const std::invalid_argument& broken) {
    throw maps::InputError(name, broken.what(), "a ground that a drive can be on");
  }
}

}  // namespace stillmap::mapping
