#include "consistency/surface_cells.hpp"

#include "core/point_cells.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Large enough for 25 voxels of a plane.
constexpr double kLeastCellM = 0.5;
constexpr double kCellVoxels = 5.0;
/// A plane has three parameters; with fewer points its own noise decides.
constexpr double kLeastSurfacePoints = 8.0;
/// A plane spreads this far in two directions [m]: a pole or the edge of a wall does not.
constexpr double kLeastAlongM = 0.06;
/// ... and at most half as far across as along. A full cell of 0.5 m spreads 0.144 m along.
constexpr double kMostAcrossToAlong = 0.5;
constexpr double kMostAcrossM = 0.125;

constexpr double kLeastRadiusM = 0.3;
constexpr double kRadiusVoxels = 3.0;
/// As MapEval, with the point itself, which is a voxel's mean as the others are.
constexpr std::size_t kLeastNeighbours = 11;
/// What a coordinate is rounded to, added to each variance [m]: a perfect plane has a finite
/// entropy.
constexpr double kRoundingM = 0.001;
/// Points of finer voxels are not all asked, but as many as there are of this size [m]: a fourth of
/// those of 0.1 m. The mean is the same within 0.01 nat, at a fourth of the time.
constexpr double kAskedVoxelM = 0.2;

/// Finer than anything that is told apart; the last one is kMostAcrossM and what is beyond.
constexpr double kThicknessBinM = 0.0001;
constexpr std::size_t kThicknessBins = 1251;

/// Weighted first and second moments, about a place near the points.
class WeightedMoments {
 public:
  void add(const Eigen::Vector3d& p, double weight) {
    ++count_;
    sum_weights_ += weight;
    sum_squared_weights_ += weight * weight;
    const Eigen::Vector3d weighted = weight * p;
    sum_ += weighted;
    xx_ += weighted.x() * p.x();
    xy_ += weighted.x() * p.y();
    xz_ += weighted.x() * p.z();
    yy_ += weighted.y() * p.y();
    yz_ += weighted.y() * p.z();
    zz_ += weighted.z() * p.z();
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  /// As many points of equal weight know as much (Kish).
  [[nodiscard]] double effective_count() const {
    return count_ == 0 ? 0.0 : sum_weights_ * sum_weights_ / sum_squared_weights_;
  }
  /// About the mean, divided by the weights.
  [[nodiscard]] Eigen::Matrix3d covariance() const {
    const Eigen::Vector3d mean = sum_ / sum_weights_;
    Eigen::Matrix3d covariance;
    covariance << xx_, xy_, xz_, xy_, yy_, yz_, xz_, yz_, zz_;
    return covariance / sum_weights_ - mean * mean.transpose();
  }

 private:
  std::size_t count_ = 0;
  double sum_weights_ = 0.0, sum_squared_weights_ = 0.0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  double xx_ = 0.0, xy_ = 0.0, xz_ = 0.0, yy_ = 0.0, yz_ = 0.0, zz_ = 0.0;
};

std::uint64_t surface_key(const Eigen::Vector3f& p, double cell_m, bool is_ground) {
  const auto cell = [&](float x) {
    return static_cast<std::int64_t>(std::floor(static_cast<double>(x) / cell_m));
  };
  return std::uint64_t{is_ground ? 1U : 0U} << 63U |
         maps::signed_cell_key(cell(p.x()), cell(p.y()), cell(p.z()));
}

/// Of the normal distribution with the covariance of the points; NaN of too few.
double normal_entropy(const WeightedMoments& neighbours) {
  const double count = neighbours.effective_count();
  if (neighbours.count() < kLeastNeighbours || !(count > 1.0))
    return std::numeric_limits<double>::quiet_NaN();
  Eigen::Matrix3d covariance = neighbours.covariance() * (count / (count - 1.0));
  covariance.diagonal().array() += kRoundingM * kRoundingM;
  const double determinant = covariance.determinant();
  return 0.5 * (3.0 * std::log(2.0 * std::numbers::pi * std::numbers::e) + std::log(determinant));
}

/// An entropy for each point that is asked; NaN for the others, and where there is none.
std::vector<double> entropies_of(const std::vector<SurfacePoint>& points, double voxel_size_m) {
  const double radius_m = entropy_radius_m(voxel_size_m);
  std::vector<double> entropies(points.size(), std::numeric_limits<double>::quiet_NaN());
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(points.size());
  for (const SurfacePoint& point : points) positions.push_back(point.position);
  const PointCells cells(std::move(positions), radius_m);
  const std::vector<Eigen::Vector3f>& sorted = cells.in_cell_order();
  const std::vector<std::uint32_t>& given = cells.given_index();
  const double low = radius_m, high = maps::kTileSizeM - radius_m;
  const auto inside = [&](float x) { return x >= low && x <= high; };
  const double finer = std::max(1.0, kAskedVoxelM / voxel_size_m);
  const auto step = static_cast<std::uint32_t>(finer * finer);
  const auto most2 = static_cast<float>(radius_m * radius_m);
  std::vector<std::pair<Eigen::Vector3f, double>> around;
  for (std::size_t cell = 0; cell < cells.cells(); ++cell) {
    around.clear();
    const PointCells::Range own = cells.cell(cell);
    for (const PointCells::Range& range : cells.around(cell)) {
      for (std::uint32_t i = range.begin; i < range.end; ++i)
        around.emplace_back(sorted[i], points[given[i]].weight);
    }
    for (std::uint32_t i = own.begin; i < own.end; ++i) {
      if (i % step != 0 || !inside(sorted[i].x()) || !inside(sorted[i].y())) continue;
      WeightedMoments neighbours;
      for (const auto& [p, weight] : around) {
        const Eigen::Vector3f offset = p - sorted[i];
        if (offset.squaredNorm() <= most2) neighbours.add(offset.cast<double>(), weight);
      }
      entropies[given[i]] = normal_entropy(neighbours);
    }
  }
  return entropies;
}

void measure_thickness(const WeightedMoments& moments, SurfaceCell& cell) {
  const double count = moments.effective_count();
  if (!(count >= kLeastSurfacePoints)) return;
  const maps::SymmetricEigen<3> eigen = maps::eigen_directly_of(moments.covariance());
  // A fitted plane takes three degrees of freedom from the residuals.
  const double across_m = std::sqrt(std::max(0.0, eigen.values[0]) * count / (count - 3.0));
  const double along_m = std::sqrt(std::max(0.0, eigen.values[1]));
  cell.thickness_m = across_m;
  cell.is_planar =
      along_m >= kLeastAlongM && across_m <= std::min(kMostAcrossM, kMostAcrossToAlong * along_m);
}

/// Appends the cells of one kind.
void append_cells(const std::vector<SurfacePoint>& points, const std::vector<double>& entropies,
                  double cell_m, bool is_ground, std::vector<SurfaceCell>& out) {
  std::vector<std::uint32_t> numbers;
  std::vector<Eigen::Vector3f> positions;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].is_ground != is_ground) continue;
    numbers.push_back(static_cast<std::uint32_t>(i));
    positions.push_back(points[i].position);
  }
  const PointCells cells(std::move(positions), cell_m);
  for (std::size_t number = 0; number < cells.cells(); ++number) {
    const PointCells::Range range = cells.cell(number);
    const Eigen::Vector3f first = cells.in_cell_order()[range.begin];
    SurfaceCell cell{.key = surface_key(first, cell_m, is_ground), .is_ground = is_ground};
    WeightedMoments moments;
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      const std::uint32_t point = numbers[cells.given_index()[i]];
      moments.add((cells.in_cell_order()[i] - first).cast<double>(), points[point].weight);
      if (!(entropies[point] == entropies[point])) continue;
      cell.entropy_sum += entropies[point];
      ++cell.entropy_points;
    }
    measure_thickness(moments, cell);
    out.push_back(cell);
  }
}

/// The value below which a share of a histogram lies, evenly spread within a bin.
double binned_quantile(const std::vector<std::uint64_t>& bins, std::uint64_t count, double share) {
  if (count == 0) return std::numeric_limits<double>::quiet_NaN();
  double left = share * static_cast<double>(count);
  std::size_t bin = 0;
  while (bin + 1 < bins.size() && left > static_cast<double>(bins[bin])) {
    left -= static_cast<double>(bins[bin]);
    ++bin;
  }
  const double part = bins[bin] == 0 ? 0.0 : left / static_cast<double>(bins[bin]);
  return kThicknessBinM * (static_cast<double>(bin) + std::min(1.0, part));
}

}  // namespace

double entropy_radius_m(double voxel_size_m) {
  return std::max(kLeastRadiusM, kRadiusVoxels * voxel_size_m);
}

std::vector<SurfacePoint> surface_points(maps::TileId id, const maps::MapTile& tile) {
  std::vector<SurfacePoint> out;
  out.reserve(tile.size());
  for (const maps::MapPoint& point : tile) {
    if (!maps::is_measured(point.kind)) continue;
    out.push_back({(tile.from_origin(point) - maps::corner_of(id)).cast<float>(),
                   static_cast<float>(std::max<std::uint16_t>(1, point.observations)),
                   point.kind == maps::PointKind::kGround});
  }
  return out;
}

std::vector<SurfaceCell> surface_cells(const std::vector<SurfacePoint>& points,
                                       double voxel_size_m) {
  std::vector<SurfaceCell> cells;
  const std::vector<double> entropies = entropies_of(points, voxel_size_m);
  const double cell_m = std::max(kLeastCellM, kCellVoxels * voxel_size_m);
  for (const bool is_ground : {false, true})
    append_cells(points, entropies, cell_m, is_ground, cells);
  return cells;
}

ConsistencySum::ConsistencySum() {
  for (Kind& kind : kinds_) kind.planar.assign(kThicknessBins, 0);
}

void ConsistencySum::add(const std::vector<SurfaceCell>& cells) {
  for (const SurfaceCell& cell : cells) {
    entropy_sum_ += cell.entropy_sum;
    entropy_points_ += cell.entropy_points;
    if (!cell.has_thickness()) continue;
    Kind& kind = kinds_[cell.is_ground ? 1 : 0];
    ++kind.cells;
    if (!cell.is_planar) continue;
    const auto bin = static_cast<std::size_t>(cell.thickness_m / kThicknessBinM);
    ++kind.planar[std::min(bin, kThicknessBins - 1)];
  }
}

void ConsistencySum::add(const ConsistencySum& other) {
  entropy_sum_ += other.entropy_sum_;
  entropy_points_ += other.entropy_points_;
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    kinds_[i].cells += other.kinds_[i].cells;
    for (std::size_t bin = 0; bin < kThicknessBins; ++bin)
      kinds_[i].planar[bin] += other.kinds_[i].planar[bin];
  }
}

void ConsistencySum::put_into(std::string& bytes) const {
  put_number(bytes, entropy_sum_);
  put_number(bytes, entropy_points_);
  for (const Kind& kind : kinds_) {
    put_number(bytes, kind.cells);
    // A tile fills a few of the bins.
    const auto filled = std::count_if(kind.planar.begin(), kind.planar.end(),
                                      [](std::uint64_t count) { return count > 0; });
    put_number(bytes, static_cast<std::size_t>(filled));
    for (std::size_t bin = 0; bin < kind.planar.size(); ++bin) {
      if (kind.planar[bin] == 0) continue;
      put_number(bytes, bin);
      put_number(bytes, kind.planar[bin]);
    }
  }
}

void ConsistencySum::get_from(ByteReader& reader) {
  *this = ConsistencySum();
  entropy_sum_ = reader.number<double>();
  entropy_points_ = reader.number<std::uint64_t>();
  for (Kind& kind : kinds_) {
    kind.cells = reader.number<std::uint64_t>();
    for (std::size_t left = reader.count(16); left > 0; --left) {
      const auto bin = reader.number<std::size_t>();
      if (bin >= kind.planar.size()) reader.refuse("a bin that is none");
      kind.planar[bin] = reader.number<std::uint64_t>();
    }
  }
}

MapConsistency ConsistencySum::result() const {
  MapConsistency out;
  out.entropy_points = entropy_points_;
  if (entropy_points_ > 0)
    out.mean_map_entropy = entropy_sum_ / static_cast<double>(entropy_points_);
  for (const bool is_ground : {false, true}) {
    const Kind& kind = kinds_[is_ground ? 1 : 0];
    SurfaceThickness& surface = is_ground ? out.ground : out.walls;
    surface.cells = kind.cells;
    for (const std::uint64_t count : kind.planar) surface.planar_cells += count;
    surface.median_m = binned_quantile(kind.planar, surface.planar_cells, 0.5);
    surface.p95_m = binned_quantile(kind.planar, surface.planar_cells, 0.95);
  }
  return out;
}

}  // namespace stillmap::mapping
