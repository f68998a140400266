#include "import/column_ground.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr float kColumnLayerM = 0.15F;
constexpr float kMostStepM = 0.2F;
constexpr std::size_t kLeastPart = 200;  // 50 m^2
constexpr float kTakenFromM = 0.35F;
constexpr float kTakenToM = 2.0F;
constexpr std::int64_t kFreeAround = 2;    // 1 m
constexpr int kMostUnknown = 5;            // of 25
constexpr std::int64_t kCellsOfPlace = 8;  // 4 m
constexpr std::int64_t kSlopeAround = 4;   // 2 m
constexpr double kSensorHeightM = 1.8;

std::int64_t floor_div(std::int64_t a, std::int64_t b) {
  return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);
}

/// Mean of the lowest layer. A single point below everything else is a reflection.
float lowest_layer(const std::vector<float>& heights_m) {
  std::size_t first = 0;
  if (heights_m.size() > 1 && heights_m[1] - heights_m[0] > kColumnLayerM) first = 1;
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = first;
       i < heights_m.size() && heights_m[i] - heights_m[first] <= kColumnLayerM; ++i, ++count)
    sum += static_cast<double>(heights_m[i]);
  return static_cast<float>(sum / static_cast<double>(count));
}

}  // namespace

ColumnGround::Cell ColumnGround::cell_of(const Eigen::Vector3f& p) {
  return {static_cast<std::int64_t>(std::floor(static_cast<double>(p.x()) / kCellM)),
          static_cast<std::int64_t>(std::floor(static_cast<double>(p.y()) / kCellM))};
}

Eigen::Vector2d ColumnGround::centre_of(const Cell& cell) {
  return {(static_cast<double>(cell.x) + 0.5) * kCellM,
          (static_cast<double>(cell.y) + 0.5) * kCellM};
}

const ColumnGround::Column* ColumnGround::find(const Cell& cell) const {
  const maps::TileId id{0, static_cast<std::int32_t>(floor_div(cell.x, kCells)),
                        static_cast<std::int32_t>(floor_div(cell.y, kCells))};
  const auto tile = tiles_.find(id);
  if (tile == tiles_.end()) return nullptr;
  const std::int64_t x = cell.x - std::int64_t{id.x} * kCells;
  const std::int64_t y = cell.y - std::int64_t{id.y} * kCells;
  return &tile->second[static_cast<std::size_t>(y * kCells + x)];
}

ColumnGround::Column* ColumnGround::find(const Cell& cell) {
  return const_cast<Column*>(std::as_const(*this).find(cell));
}

void ColumnGround::add(maps::TileId id, std::span<const Eigen::Vector3f> points) {
  Tile& tile = tiles_[id];
  std::vector<std::vector<float>> heights_m(tile.size());
  for (const Eigen::Vector3f& p : points) {
    const Cell cell = cell_of(p);
    const std::int64_t x =
        std::clamp<std::int64_t>(cell.x - std::int64_t{id.x} * kCells, 0, kCells - 1);
    const std::int64_t y =
        std::clamp<std::int64_t>(cell.y - std::int64_t{id.y} * kCells, 0, kCells - 1);
    heights_m[static_cast<std::size_t>(y * kCells + x)].push_back(p.z());
  }
  for (std::size_t i = 0; i < tile.size(); ++i) {
    std::vector<float>& heights = heights_m[i];
    if (heights.empty()) continue;
    std::sort(heights.begin(), heights.end());
    Column& column = tile[i];
    column.part = kNotYet;
    column.height_m = lowest_layer(heights);
    column.taken = std::any_of(heights.begin(), heights.end(), [&](float z) {
      return z - column.height_m > kTakenFromM && z - column.height_m < kTakenToM;
    });
  }
}

std::vector<ColumnGround::Column*> ColumnGround::part_from(const Cell& seed, int number) {
  struct Reached {
    Cell cell;
    Column* column;
  };
  std::vector<Reached> reached{{seed, find(seed)}};
  reached.front().column->part = number;
  for (std::size_t i = 0; i < reached.size(); ++i) {
    const Reached from = reached[i];
    for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      const Cell cell{from.cell.x + dx, from.cell.y + dy};
      Column* next = find(cell);
      if (next == nullptr || next->part != kNotYet ||
          std::abs(next->height_m - from.column->height_m) > kMostStepM)
        continue;
      next->part = number;
      reached.push_back({cell, next});
    }
  }
  std::vector<Column*> columns;
  columns.reserve(reached.size());
  for (const Reached& each : reached) columns.push_back(each.column);
  return columns;
}

void ColumnGround::finish() {
  int number = 0;
  for (auto& [id, tile] : tiles_) {
    for (std::size_t i = 0; i < tile.size(); ++i) {
      if (tile[i].part != kNotYet) continue;
      const auto at = static_cast<std::int64_t>(i);
      const std::vector<Column*> part = part_from(
          {std::int64_t{id.x} * kCells + at % kCells, std::int64_t{id.y} * kCells + at / kCells},
          number);
      if (part.size() >= kLeastPart) {
        ++number;
        continue;
      }
      for (Column* column : part) column->part = kNotGround;
    }
  }
}

std::optional<float> ColumnGround::at(const Eigen::Vector3f& p) const {
  const Column* column = find(cell_of(p));
  if (column == nullptr || column->part < 0) return std::nullopt;
  return column->height_m;
}

bool ColumnGround::is_free(const Cell& cell) const {
  const Column* middle = find(cell);
  if (middle == nullptr || middle->part < 0 || middle->taken) return false;
  int unknown = 0;
  for (std::int64_t y = cell.y - kFreeAround; y <= cell.y + kFreeAround; ++y) {
    for (std::int64_t x = cell.x - kFreeAround; x <= cell.x + kFreeAround; ++x) {
      const Column* column = find(Cell{x, y});
      if (column == nullptr || column->part == kNothing) {
        ++unknown;
      } else if (column->part != middle->part || column->taken) {
        return false;
      }
    }
  }
  return unknown <= kMostUnknown;
}

Eigen::Isometry3d ColumnGround::place_at(const Cell& cell) const {
  const Column& middle = *find(cell);
  // Plane z = a x + b y + c through the ground around, in metres from the middle; drawn to level,
  // or a few columns in a row would leave the slope across them free.
  Eigen::Matrix3d H = Eigen::Vector3d(1.0, 1.0, 0.0).asDiagonal();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  for (std::int64_t y = -kSlopeAround; y <= kSlopeAround; ++y) {
    for (std::int64_t x = -kSlopeAround; x <= kSlopeAround; ++x) {
      const Column* column = find(Cell{cell.x + x, cell.y + y});
      if (column == nullptr || column->part != middle.part) continue;
      const Eigen::Vector3d row(static_cast<double>(x) * kCellM, static_cast<double>(y) * kCellM,
                                1.0);
      H += row * row.transpose();
      g += row * static_cast<double>(column->height_m - middle.height_m);
    }
  }
  const Eigen::Vector3d plane = H.llt().solve(g);
  const Eigen::Vector3d up = Eigen::Vector3d(-plane.x(), -plane.y(), 1.0).normalized();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = maps::turn_between(Eigen::Vector3d::UnitZ(), up).toRotationMatrix();
  T.translation() << centre_of(cell), static_cast<double>(middle.height_m) + plane.z();
  T.translation() += kSensorHeightM * up;
  return T;
}

std::vector<Eigen::Isometry3d> ColumnGround::places() const {
  std::vector<Eigen::Isometry3d> places;
  // Whole squares fit into a tile.
  static_assert(kCells % kCellsOfPlace == 0);
  for (const auto& [id, tile] : tiles_) {
    for (std::int64_t square = 0; square < 25; ++square) {
      const Cell corner{std::int64_t{id.x} * kCells + square % 5 * kCellsOfPlace,
                        std::int64_t{id.y} * kCells + square / 5 * kCellsOfPlace};
      std::optional<Cell> best;
      std::int64_t nearest = std::numeric_limits<std::int64_t>::max();
      for (std::int64_t i = 0; i < kCellsOfPlace * kCellsOfPlace; ++i) {
        const std::int64_t x = i % kCellsOfPlace;
        const std::int64_t y = i / kCellsOfPlace;
        // Twice the distance from the middle, so that it is a whole number.
        const std::int64_t dx = 2 * x + 1 - kCellsOfPlace;
        const std::int64_t dy = 2 * y + 1 - kCellsOfPlace;
        const Cell cell{corner.x + x, corner.y + y};
        if (dx * dx + dy * dy >= nearest || !is_free(cell)) continue;
        nearest = dx * dx + dy * dy;
        best = cell;
      }
      if (best) places.push_back(place_at(*best));
    }
  }
  return places;
}

}  // namespace stillmap::mapping
