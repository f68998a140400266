#pragma once

#include <stillmap/maps/cell_table.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

// How a scan is thinned before it is matched: by the server, and by clients that send only what the
// server would keep. One rule, so that both ways give the same answer. C++17 and the standard
// library alone; equal bits need IEEE floats without contraction (GCC, Clang: -ffp-contract=off).

namespace stillmap::localization {

/// Points as they lie in memory, which must outlive the view: three float32 x, y, z [m] in the
/// lidar frame, and where there are times one float32 [s] relative to the scan's stamp.
struct ScanView {
  const void* xyz = nullptr;
  std::size_t xyz_stride_bytes = 0;
  std::size_t size = 0;
  /// Null without times.
  const void* time_s = nullptr;
  std::size_t time_stride_bytes = 0;

  [[nodiscard]] std::array<float, 3> point(std::size_t i) const {
    std::array<float, 3> p;
    std::memcpy(p.data(), static_cast<const char*>(xyz) + i * xyz_stride_bytes, sizeof(p));
    return p;
  }
  /// False where nothing came back: a number that is not finite, or 0, 0, 0.
  [[nodiscard]] bool is_point(std::size_t i) const {
    const auto [x, y, z] = point(i);
    return is_point(x, y, z);
  }
  [[nodiscard]] static bool is_point(float x, float y, float z) {
    // A number that is not finite makes the first sum NaN.
    return (0.0F * x + 0.0F * y + 0.0F * z == 0.0F) & ((x != 0.0F) | (y != 0.0F) | (z != 0.0F));
  }
  /// 0 without times.
  [[nodiscard]] float time(std::size_t i) const {
    float t = 0.0F;
    if (time_s != nullptr)
      std::memcpy(&t, static_cast<const char*>(time_s) + i * time_stride_bytes, sizeof(t));
    return t;
  }
};

/// What happens to points that have no other point near them, as from rain, dust and crosstalk.
/// They are always kept in a scan of fewer than 10,000 points, and in one that was thinned before
/// (many lone points near the sensor).
enum class Lone { kKept, kLeftOut };

/// Points nearer than this are the vehicle itself [m]; `AlignerOptions::own_vehicle_m` says why.
inline constexpr double kOwnVehicleM = 2.7;
/// Most points that are matched.
inline constexpr std::size_t kMaxQueryPoints = 4000;

namespace thin_detail {

using maps::CellTable;

/// Edge of the cells of which one point is kept; half of it where fewer points than `kFewPoints`
/// would be left, as in a room.
inline constexpr float kCellM = 0.5F;
inline constexpr std::size_t kFewPoints = 1000;
inline constexpr float kMaxRangeM = 500.0F;
/// Where more of a scan is as near as the vehicle itself, one is in a narrow place, and it counts.
inline constexpr float kMostOwnShare = 0.25F;
/// Larger scans are strided down to this first; neighbours in the scan are closer than a cell
/// anyway.
inline constexpr std::size_t kMaxRead = 400'000;
/// Lone points are looked for in cells whose edge is at least one of so many parts of the range: a
/// surface seen by a lidar of 0.7 degrees a column has two points or more in each.
inline constexpr float kEdgesPerRange = 32.0F;
/// They double with the range, up to so many edges of the first; what is farther is sparse anyway.
inline constexpr float kMostLoneEdges = 4.0F;
/// In sparse scans surfaces have lone points, too: of 2,000 to 5,000 points of a hand-held sensor a
/// fifth of the near cells.
inline constexpr std::size_t kSparsePoints = 10'000;
/// Where more of the points are lone, and more of those in a range, the scan was thinned before.
inline constexpr double kMostLoneShare = 0.15;
inline constexpr double kMostLoneShareOfRange = 0.35;

inline float squared_range(const std::array<float, 3>& p) {
  return p[0] * p[0] + (p[1] * p[1] + p[2] * p[2]);
}

/// For points that are left out: other numbers have no cell, nor has NaN.
inline float in_range(float coordinate_m) {
  const float below = coordinate_m < kMaxRangeM ? coordinate_m : kMaxRangeM;
  return below > -kMaxRangeM ? below : -kMaxRangeM;
}

inline std::int32_t cell_of(float coordinate_m, float edge_m) {
  // std::floor is a call of the library where the compiler may not use SSE 4.1.
  const float cells = coordinate_m / edge_m;
  const auto towards_0 = static_cast<std::int32_t>(cells);
  return towards_0 - (cells < static_cast<float>(towards_0) ? 1 : 0) + maps::kCellsPerAxis / 2;
}

inline std::uint64_t key_of(const std::array<float, 3>& p, float edge_m) {
  return maps::cell_key(cell_of(p[0], edge_m), cell_of(p[1], edge_m), cell_of(p[2], edge_m));
}

/// Some points of a scan, a column for each coordinate, so that the compiler takes several at once.
struct ScanColumns {
  static constexpr std::size_t kMost = 256;
  std::array<float, kMost> x, y, z;
  std::size_t size = 0;

  /// Every `step`-th point from the first on. @return the first one that is not read.
  std::size_t read(const ScanView& scan, std::size_t first, std::size_t step) {
    const std::size_t left = (scan.size - first + step - 1) / step;
    size = left < kMost ? left : kMost;
    for (std::size_t i = 0; i < size; ++i, first += step) {
      const std::array<float, 3> p = scan.point(first);
      x[i] = p[0];
      y[i] = p[1];
      z[i] = p[2];
    }
    return first;
  }
  [[nodiscard]] float range2(std::size_t i) const { return squared_range({x[i], y[i], z[i]}); }
};

/// The cells of these points.
struct CellColumns {
  /// Of a point that is left out.
  static constexpr std::int32_t kNone = std::numeric_limits<std::int32_t>::min();
  std::array<std::int32_t, ScanColumns::kMost> x, y, z;
  /// 0 for a point in the cell of the point before it.
  std::array<std::int32_t, ScanColumns::kMost> differs;

  CellColumns(const ScanColumns& points, float edge_m, float nearest2) {
    // Loops without branches, so that the compiler takes several points at once.
    for (std::size_t i = 0; i < points.size; ++i) {
      x[i] = cell_of(in_range(points.x[i]), edge_m);
      y[i] = cell_of(in_range(points.y[i]), edge_m);
      z[i] = cell_of(in_range(points.z[i]), edge_m);
    }
    for (std::size_t i = 0; i < points.size; ++i) {
      const float range2 = points.range2(i);
      const bool is_kept =
          (range2 < kMaxRangeM * kMaxRangeM) & (range2 >= nearest2) & (range2 != 0.0F);
      x[i] = is_kept ? x[i] : kNone;
    }
    differs[0] = 1;
    for (std::size_t i = 1; i < points.size; ++i)
      differs[i] = (x[i] ^ x[i - 1]) | (y[i] ^ y[i - 1]) | (z[i] ^ z[i - 1]);
  }
};

/// One point of each cell, and how many different points the cell has.
struct Cells {
  float edge_m;
  std::vector<std::size_t> points;
  std::vector<std::array<float, 3>> positions;
  std::vector<std::uint32_t> counts;

  /// Counts points of a scan that follow each other in the cell, `of_run(0)` to `of_run(size - 1)`.
  /// A point that is sent twice is alone still.
  template <typename OfRun>
  void count_run(std::uint32_t cell, std::size_t size, const OfRun& of_run) {
    std::size_t i = 0;
    while (counts[cell] == 1 && i < size)
      if (of_run(i++) != positions[cell]) ++counts[cell];
    counts[cell] += static_cast<std::uint32_t>(size - i);
  }
};

/// Numbers of the cells within a range whose point is the only one in a cell of the edge `edge_m`,
/// and the share of the points there that these are.
struct LoneCells {
  std::vector<std::size_t> cells;
  double share = 0.0;
};

/// @param ranges2  of the cells' points.
inline LoneCells lone_cells(const Cells& cells, const std::vector<float>& ranges2, float edge_m,
                            float from_m, float to_m) {
  constexpr float kDiagonal = 1.74F;
  const auto is_within = [&](std::size_t i, float near_m, float far_m) {
    const float range2 = ranges2[i];
    return (range2 >= near_m * near_m) & (range2 < far_m * far_m);
  };
  const auto key = [&](std::size_t i) { return key_of(cells.positions[i], edge_m); };
  LoneCells lone;
  // Without branches, which would be mispredicted often.
  std::vector<std::size_t> single(cells.points.size());
  std::size_t points = 0, singles = 0;
  for (std::size_t i = 0; i < cells.points.size(); ++i) {
    const std::uint32_t counted = is_within(i, from_m, to_m) ? cells.counts[i] : 0;
    points += counted;
    single[singles] = i;
    singles += counted == 1 ? 1 : 0;
  }
  single.resize(singles);
  if (edge_m > cells.edge_m) {
    CellTable coarse(single.size());
    std::vector<std::uint32_t> counts;
    for (const std::size_t i : single)
      if (coarse.insert(key(i)).second) counts.push_back(0);
    const float margin_m = kDiagonal * edge_m;
    for (std::size_t i = 0; i < cells.points.size(); ++i) {
      if (!is_within(i, from_m - margin_m, to_m + margin_m)) continue;
      const std::uint32_t cell = coarse.find(key(i));
      if (cell != CellTable::kNone) counts[cell] += cells.counts[i];
    }
    for (const std::size_t i : single)
      if (counts[coarse.find(key(i))] <= 1) lone.cells.push_back(i);
  } else {
    lone.cells = std::move(single);
  }
  const auto all = static_cast<double>(points > 0 ? points : 1);
  lone.share = static_cast<double>(lone.cells.size()) / all;
  return lone;
}

/// Leaves out the cells whose point is the only one around it, as rain, dust and crosstalk give
/// them.
inline void leave_out_lone(Cells& cells) {
  std::vector<float> ranges2;
  ranges2.reserve(cells.positions.size());
  for (const std::array<float, 3>& p : cells.positions) ranges2.push_back(squared_range(p));
  std::vector<LoneCells> by_range;
  std::size_t found = 0;
  float from_m = 0.0F;
  for (float edge_m = cells.edge_m; edge_m <= kMostLoneEdges * cells.edge_m; edge_m *= 2.0F) {
    const float to_m = kEdgesPerRange * edge_m;
    by_range.push_back(lone_cells(cells, ranges2, edge_m, from_m, to_m));
    found += by_range.back().cells.size();
    from_m = to_m;
  }
  const auto all = std::accumulate(cells.counts.begin(), cells.counts.end(), std::size_t{0});
  const bool many = static_cast<double>(found) > kMostLoneShare * static_cast<double>(all);
  std::vector<char> lone(cells.points.size(), 0);
  for (const LoneCells& in_range : by_range) {
    if (many && in_range.share > kMostLoneShareOfRange) continue;
    for (const std::size_t i : in_range.cells) lone[i] = 1;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cells.points.size(); ++i)
    if (lone[i] == 0) cells.points[kept++] = cells.points[i];
  cells.points.resize(kept);
}

}  // namespace thin_detail

/// How many points a scan has, apart from those that say that nothing came back.
struct ScanCounts {
  /// With a range: finite, not exactly 0, 0, 0.
  std::size_t points = 0;
  std::size_t no_returns = 0;
  /// Range below which points are left out [m]: `own_vehicle_m`, or 0 where a quarter of the points
  /// is that near.
  float nearest_m = 0.0F;
  float own_vehicle_m = 0.0F;
};

/// @param own_vehicle_m  see `kOwnVehicleM`, 0 and more.
[[nodiscard]] inline ScanCounts count_points(const ScanView& scan, double own_vehicle_m) {
  const auto own_m = static_cast<float>(own_vehicle_m);
  ScanCounts counts;
  counts.own_vehicle_m = own_m;
  std::size_t near = 0;
  thin_detail::ScanColumns columns;
  for (std::size_t first = 0; first < scan.size;) {
    first = columns.read(scan, first, 1);
    std::uint32_t points_here = 0, near_here = 0;
    for (std::size_t i = 0; i < columns.size; ++i) {
      const std::uint32_t is_point =
          ScanView::is_point(columns.x[i], columns.y[i], columns.z[i]) ? 1U : 0U;
      points_here += is_point;
      near_here += is_point & (columns.range2(i) < own_m * own_m ? 1U : 0U);
    }
    counts.points += points_here;
    near += near_here;
  }
  counts.no_returns = scan.size - counts.points;
  const float share = static_cast<float>(near) / static_cast<float>(counts.points + 1);
  counts.nearest_m = share < thin_detail::kMostOwnShare ? own_m : 0.0F;
  return counts;
}

/// Thins a scan to the first point of each cell. Points beyond 500 m are left out (no lidar of ours
/// sees so far, and they would overflow the grid). So are those nearer than `counts.nearest_m`, and
/// no returns.
/// @param cell_m  edge of a cell, above 0. @param counts  `count_points` of the scan.
/// @return indices, ascending. Scans of more than 400,000 points are strided first.
[[nodiscard]] inline std::vector<std::size_t> one_point_a_cell(const ScanView& scan, float cell_m,
                                                               Lone lone,
                                                               const ScanCounts& counts) {
  using namespace thin_detail;
  Cells cells{cell_m, {}, {}, {}};
  std::vector<std::uint64_t> keys;
  maps::CellIndex index(counts.points / 8);
  const std::size_t step = counts.points / kMaxRead + 1;
  ScanColumns points;
  for (std::size_t first = 0; first < scan.size;) {
    const std::size_t next = points.read(scan, first, step);
    const CellColumns cell(points, cell_m, counts.nearest_m * counts.nearest_m);
    // Neighbours in a scan mostly lie in one cell.
    for (std::size_t i = 0, end = 0; i < points.size; i = end) {
      for (end = i + 1; end < points.size && cell.differs[end] == 0;) ++end;
      if (cell.x[i] == CellColumns::kNone) continue;
      const auto of_run = [&](std::size_t k) {
        return std::array<float, 3>{points.x[i + k], points.y[i + k], points.z[i + k]};
      };
      const std::uint64_t key = maps::cell_key(cell.x[i], cell.y[i], cell.z[i]);
      const auto [number, is_new] =
          index.insert(key, [&](std::uint32_t known) { return keys[known]; });
      if (is_new) {
        keys.push_back(key);
        cells.points.push_back(first + i * step);
        cells.positions.push_back(of_run(0));
        cells.counts.push_back(1);
      }
      cells.count_run(number, end - i, of_run);
    }
    first = next;
  }
  if (lone == Lone::kLeftOut && counts.points >= kSparsePoints) leave_out_lone(cells);
  return std::move(cells.points);
}

/// What of a scan is needed to match it.
struct ThinPoints {
  /// Indices of points of the scan: first those that are matched, ascending, then those that tell
  /// with them where the ground is, ascending.
  std::vector<std::size_t> indices;
  /// How many are matched, at most `kMaxQueryPoints`.
  std::size_t matched = 0;
  /// Edge of the cells [m].
  float cell_m = thin_detail::kCellM;
  ScanCounts counts;
};

/// One point of each cell of 0.5 m, or of 0.25 m where that would leave fewer than 1,000, without
/// lone points; matched are all of them, or 4,000 spread evenly.
[[nodiscard]] inline ThinPoints thin_points(const ScanView& scan,
                                            double own_vehicle_m = kOwnVehicleM) {
  using namespace thin_detail;
  ThinPoints thin;
  thin.counts = count_points(scan, own_vehicle_m);
  std::vector<std::size_t> kept = one_point_a_cell(scan, kCellM, Lone::kLeftOut, thin.counts);
  if (kept.size() < kFewPoints) {
    thin.cell_m = 0.5F * kCellM;
    kept = one_point_a_cell(scan, thin.cell_m, Lone::kLeftOut, thin.counts);
  }
  thin.matched = kept.size() < kMaxQueryPoints ? kept.size() : kMaxQueryPoints;
  thin.indices.reserve(kept.size());
  std::vector<char> is_matched(kept.size(), 0);
  for (std::size_t i = 0; i < thin.matched; ++i) {
    const std::size_t source = i * kept.size() / thin.matched;
    is_matched[source] = 1;
    thin.indices.push_back(kept[source]);
  }
  for (std::size_t i = 0; i < kept.size(); ++i)
    if (is_matched[i] == 0) thin.indices.push_back(kept[i]);
  return thin;
}

/// How a thin scan travels. The layout of both stands in localization/thin_scan.md.
enum class ThinProfile {
  kExact,    ///< float32: the server answers as for the whole scan, to the bit
  kCompact,  ///< 16-bit steps and at most `kMostCompactBytes`
};
inline constexpr std::size_t kMostCompactBytes = 48'000;

namespace thin_detail {

inline constexpr std::size_t kHeaderBytes = 44;
inline constexpr std::uint8_t kVersion = 1;
inline constexpr std::uint8_t kHasTimes = 1;
inline constexpr std::uint8_t kNearKept = 2;
inline constexpr std::uint8_t kZstd = 4;
inline constexpr float kColumnM = 2.0F;

/// Little-endian, as the machines are that this is written for.
template <typename Value>
void append(std::vector<char>& bytes, Value value) {
  const std::size_t at = bytes.size();
  bytes.resize(at + sizeof(value));
  std::memcpy(bytes.data() + at, &value, sizeof(value));
}

/// Of the points that are not matched, those that are the lowest of their column of 2 m in the
/// lidar frame; if these are still too many, every k-th.
inline void keep_lowest(const ScanView& scan, ThinPoints& thin, std::size_t most) {
  if (thin.indices.size() <= most) return;
  CellTable columns(thin.indices.size() / 4);
  std::vector<std::size_t> lowest;
  for (const std::size_t i : thin.indices) {
    const auto [x, y, z] = scan.point(i);
    const auto [column, inserted] = columns.insert(key_of({x, y, 0.0F}, kColumnM));
    if (inserted) lowest.push_back(i);
    if (z < scan.point(lowest[column])[2]) lowest[column] = i;
  }
  std::vector<std::size_t> extra;
  for (std::size_t k = thin.matched; k < thin.indices.size(); ++k) {
    const std::size_t i = thin.indices[k];
    const auto [x, y, z] = scan.point(i);
    if (lowest[columns.find(key_of({x, y, 0.0F}, kColumnM))] == i) extra.push_back(i);
  }
  const std::size_t room = most - thin.matched;
  const std::size_t count = extra.size() < room ? extra.size() : room;
  thin.indices.resize(thin.matched);
  for (std::size_t k = 0; k < count; ++k) thin.indices.push_back(extra[k * extra.size() / count]);
}

/// The largest absolute value that `value(i)` has for the points.
template <typename ValueOf>
float farthest(const ThinPoints& thin, const ValueOf& value) {
  float most = 0.0F;
  for (const std::size_t i : thin.indices) most = std::fmax(most, std::fabs(value(i)));
  return most;
}

template <typename ValueOf>
void append_steps(std::vector<char>& bytes, const ThinPoints& thin, float step,
                  const ValueOf& value) {
  for (const std::size_t i : thin.indices)
    append(bytes, static_cast<std::int16_t>(step > 0.0F ? std::lround(value(i) / step) : 0));
}

/// How numbers of a body are written: as they are, or in steps where these are not 0.
struct Steps {
  float step_m = 0.0F;
  float step_s = 0.0F;
};

inline void append_header(std::vector<char>& bytes, const ThinPoints& thin, ThinProfile profile,
                          bool has_times, const Steps& steps) {
  for (const char c : {'S', 'M', 'T', 'S'}) bytes.push_back(c);
  append(bytes, kVersion);
  append(bytes, static_cast<std::uint8_t>(profile == ThinProfile::kCompact ? 1 : 0));
  const bool near_kept = thin.counts.nearest_m == 0.0F;
  append(bytes,
         static_cast<std::uint8_t>((has_times ? kHasTimes : 0) | (near_kept ? kNearKept : 0)));
  append(bytes, std::uint8_t{0});
  append(bytes, static_cast<std::uint32_t>(thin.indices.size()));
  append(bytes, static_cast<std::uint32_t>(thin.matched));
  append(bytes, static_cast<std::uint32_t>(thin.counts.points));
  append(bytes, static_cast<std::uint32_t>(thin.counts.no_returns));
  append(bytes, thin.cell_m);
  append(bytes, thin.counts.own_vehicle_m);
  append(bytes, steps.step_m);
  append(bytes, steps.step_s);
  append(bytes, std::uint32_t{0});
}

inline void append_exact(std::vector<char>& bytes, const ScanView& scan, const ThinPoints& thin) {
  for (const std::size_t i : thin.indices)
    for (const float coordinate : scan.point(i)) append(bytes, coordinate);
  if (scan.time_s == nullptr) return;
  for (const std::size_t i : thin.indices) append(bytes, scan.time(i));
}

/// Steps of which the largest number has as many as fit.
inline Steps steps_of(const ScanView& scan, const ThinPoints& thin) {
  constexpr float kMostSteps = std::numeric_limits<std::int16_t>::max();
  Steps steps;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float most_m = farthest(thin, [&](std::size_t i) { return scan.point(i)[axis]; });
    steps.step_m = std::fmax(steps.step_m, most_m / kMostSteps);
  }
  steps.step_s = farthest(thin, [&](std::size_t i) { return scan.time(i); }) / kMostSteps;
  return steps;
}

inline void append_compact(std::vector<char>& bytes, const ScanView& scan, const ThinPoints& thin,
                           const Steps& steps) {
  for (std::size_t axis = 0; axis < 3; ++axis)
    append_steps(bytes, thin, steps.step_m, [&](std::size_t i) { return scan.point(i)[axis]; });
  if (scan.time_s == nullptr) return;
  append_steps(bytes, thin, steps.step_s, [&](std::size_t i) { return scan.time(i); });
}

}  // namespace thin_detail

/// A scan as `application/vnd.stillmap.scan`.
/// @param own_vehicle_m  as the server's option of this name.
[[nodiscard]] inline std::vector<char> encode_thin_scan(const ScanView& scan, ThinProfile profile,
                                                        double own_vehicle_m = kOwnVehicleM) {
  using namespace thin_detail;
  ThinPoints thin = thin_points(scan, own_vehicle_m);
  const bool has_times = scan.time_s != nullptr;
  const std::size_t values = has_times ? 4 : 3;
  std::vector<char> bytes;
  if (profile == ThinProfile::kExact) {
    bytes.reserve(kHeaderBytes + thin.indices.size() * values * sizeof(float));
    append_header(bytes, thin, profile, has_times, {});
    append_exact(bytes, scan, thin);
    return bytes;
  }
  keep_lowest(scan, thin, (kMostCompactBytes - kHeaderBytes) / (values * sizeof(std::int16_t)));
  const Steps steps = steps_of(scan, thin);
  bytes.reserve(kMostCompactBytes);
  append_header(bytes, thin, profile, has_times, steps);
  append_compact(bytes, scan, thin, steps);
  return bytes;
}

}  // namespace stillmap::localization
