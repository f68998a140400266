#include "views/range_view.hpp"

#include <stillmap/localization/thinning.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// A second surface in a bin is kept when it is this much farther [m]; less is the same surface, or
/// noise.
constexpr float kApartM = 0.3F;

/// Half-width of what a ray may miss by: pose and deskewing, in translation [m] and rotation [rad],
/// with the beam's own half-width (0.1 degree) in the latter.
constexpr float kGuardM = 0.03F;
constexpr float kGuardRad = 0.0035F;

/// How far apart one thing may lie in scans that are seconds apart: poses of GNSS and odometry
/// wander by this much within a street [m]. What a scan sees so near to a cell may be the very
/// thing that others saw in it.
constexpr float kWanderM = 0.3F;

/// A view says "free" only where it saw nothing within so many times the uncertainty of its pose.
constexpr float kDoubts = 3.0F;

/// Beyond it a view can say nothing of a place [m]; it also bounds what has to be looked at.
constexpr float kMostDoubtM = 2.0F;

/// A surface counts as beyond a cell from here on [m]; grows with range, since surfaces seen at a
/// grazing angle cover a longer way within a bin.
constexpr float kBeyondM = 0.3F;
constexpr float kBeyondPerM = 0.01F;

std::uint16_t quantized(float range_m, float quantum_m) {
  return static_cast<std::uint16_t>(std::clamp(range_m / quantum_m, 1.0F, 65534.0F));
}

/// What two lidars say at one moment. What one of them met is there, whatever the other says.
Look both(const Look& a, const Look& b) {
  for (const Sight sight : {Sight::kHit, Sight::kMixed}) {
    if (a.sight == sight || b.sight == sight) return {sight};
  }
  // `rays` is 0 unless it is free.
  return {std::max(a.sight, b.sight), a.rays + b.rays};
}

/// Columns and rows that a cone touches; columns still unwrapped, rows within the view.
struct Window {
  int row_begin, row_end, column_begin, column_end;
};

}  // namespace

/// A direction in units of bins.
struct RangeView::Aim {
  float row, column;
  /// How many columns a row's height is wide: more towards the poles. Near one, a wide piece of
  /// the circle does as well as all of it, since what matters is at street level.
  float columns_per_row;

  Aim(const Eigen::Vector3f& p, float range_m) {
    constexpr float kHalfTurn = std::numbers::pi_v<float>;
    const float flat_m = std::sqrt(p.x() * p.x() + p.y() * p.y());
    row = (maps::fast_angle(p.z(), flat_m) + 0.5F * kHalfTurn) * (1.0F / ViewGrid::kRowRad);
    // A turn more keeps it above zero, so that truncation rounds down.
    column = (ViewGrid::azimuth(p) + 3.0F * kHalfTurn) * (1.0F / ViewGrid::kColumnRad);
    columns_per_row = std::min(range_m, 20.0F * flat_m) / std::max(flat_m, 0.05F * range_m);
  }

  [[nodiscard]] Window cone(float radius_rad, int first_row, int end_row) const {
    const float rows = radius_rad * (1.0F / ViewGrid::kRowRad);
    const float columns = radius_rad * (1.0F / ViewGrid::kColumnRad) * columns_per_row;
    return {std::max(static_cast<int>(row - rows), first_row),
            std::min(static_cast<int>(row + rows) + 1, end_row), static_cast<int>(column - columns),
            static_cast<int>(column + columns) + 1};
  }
};

RangeView::RangeView(std::span<const Eigen::Vector3f> positions,
                     std::span<const std::uint8_t> is_ground) {
  if (!is_ground.empty() && is_ground.size() != positions.size())
    throw std::invalid_argument("is_ground: expected one flag a point or none");
  std::vector<std::uint16_t> rows(positions.size());
  int lowest = ViewGrid::kRows, highest = -1;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const int row = ViewGrid::row_of(ViewGrid::elevation(positions[i]));
    rows[i] = static_cast<std::uint16_t>(row);
    lowest = std::min(lowest, row);
    highest = std::max(highest, row);
  }
  if (highest < lowest) return;
  first_row_ = lowest;
  bins_.resize(static_cast<std::size_t>(highest - lowest + 1) * ViewGrid::kColumns);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const int column = ViewGrid::wrapped(ViewGrid::column_of(ViewGrid::azimuth(positions[i])));
    Bin& bin = bins_[static_cast<std::size_t>((rows[i] - lowest) * ViewGrid::kColumns + column)];
    const std::uint16_t range = quantized(positions[i].norm(), kQuantumM);
    bin.farthest = std::max(bin.farthest, range);
    if (is_ground.empty() || is_ground[i] == 0) bin.nearest = std::min(bin.nearest, range);
  }
  const std::uint16_t apart = quantized(kApartM, kQuantumM);
  for (Bin& bin : bins_) {
    if (bin.nearest != kNone && bin.farthest < bin.nearest + apart) bin.farthest = bin.nearest;
  }
}

RangeView::RangeView(const maps::PointCloud& cloud, std::span<const std::uint8_t> is_ground) {
  if (cloud.lidars.empty()) {
    *this = RangeView(std::span(cloud.positions), is_ground);
    return;
  }
  if (!is_ground.empty() && is_ground.size() != cloud.size())
    throw std::invalid_argument("is_ground: expected one flag a point or none");
  for (std::size_t lidar = 0; lidar < cloud.lidar_origins.size(); ++lidar) {
    std::vector<std::uint8_t> flags;
    for (std::size_t i = 0; i < is_ground.size(); ++i) {
      if (cloud.lidars[i] == lidar) flags.push_back(is_ground[i]);
    }
    RangeView view(cloud.of_lidar(lidar).positions, flags);
    view.origin_ = cloud.lidar_origins[lidar];
    if (lidar == 0)
      *this = std::move(view);
    else
      others_.push_back(std::move(view));
  }
}

/// Whether a return from anything but the ground lies within some decimetres of a cell.
/// @param aim  at the cell, at this range.
bool RangeView::any_near(const Aim& aim, float range_m, float radius_m, float doubt_m) const {
  const float wander_m = std::max(kWanderM, kDoubts * doubt_m);
  const float beyond_m = kBeyondM + kBeyondPerM * range_m;
  const Window around =
      aim.cone((radius_m + wander_m) / range_m + kGuardRad, first_row_, end_row());
  const auto before = static_cast<int>((range_m - beyond_m - wander_m) / kQuantumM);
  const auto after = static_cast<int>((range_m + beyond_m + wander_m) / kQuantumM);
  const auto low = static_cast<std::uint32_t>(std::max(before, 0));
  const std::uint32_t most = static_cast<std::uint32_t>(std::min(after, kNone - 1)) - low;
  // All bins of a piece of a row, since that is several at once.
  const auto any_in = [&](const Bin* bins, int count) {
    std::uint32_t any = 0;
    for (int i = 0; i < count; ++i) any |= std::uint32_t{bins[i].nearest} - low <= most ? 1U : 0U;
    return any != 0;
  };
  const int begin = ViewGrid::wrapped(around.column_begin);
  const int end = begin + std::min(around.column_end - around.column_begin, ViewGrid::kColumns);
  for (int row = around.row_begin; row < around.row_end; ++row) {
    const Bin* bins = &bin(row, 0);
    if (any_in(bins + begin, std::min(end, ViewGrid::kColumns) - begin) ||
        any_in(bins, std::max(0, end - ViewGrid::kColumns)))
      return true;
  }
  return false;
}

Look RangeView::own_look(const Eigen::Vector3f& p, float radius_m, float doubt_m) const {
  const float range_m = p.norm();
  if (!(range_m > radius_m)) return {};
  const float beyond_m = kBeyondM + kBeyondPerM * range_m;
  const auto after = static_cast<int>((range_m + beyond_m) / kQuantumM);
  const auto before = static_cast<int>((range_m - beyond_m) / kQuantumM);
  const Aim aim(p, range_m);
  bool any = false, passed = false;
  const Window inner = aim.cone(radius_m / range_m, first_row_, end_row());
  for (int row = inner.row_begin; row < inner.row_end; ++row) {
    for (int column = inner.column_begin; column < inner.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.farthest == 0) continue;
      any = true;
      // Of ground the farthest return is known; before the cell it says nothing.
      const std::uint16_t met = b.nearest != kNone ? b.nearest : b.farthest;
      if (met >= before && met <= after) return {Sight::kHit};
      if (b.farthest > after) passed = true;
    }
  }
  if (!any) return {};
  if (!passed) return {Sight::kHidden};
  if (kDoubts * doubt_m > kMostDoubtM) return {};
  const Window outer = aim.cone((radius_m + std::max(kGuardM, doubt_m)) / range_m + kGuardRad,
                                first_row_, end_row());
  int rays = 0;
  for (int row = outer.row_begin; row < outer.row_end; ++row) {
    for (int column = outer.column_begin; column < outer.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.nearest <= after) return {Sight::kMixed};
      if (b.farthest != 0) ++rays;
    }
  }
  // Says nothing either way: against the cell it would shield all that moves along a wall.
  if (any_near(aim, range_m, radius_m, doubt_m)) return {};
  return {Sight::kFree, rays};
}

Look RangeView::look(const Eigen::Vector3f& p, float radius_m, float doubt_m) const {
  Look all = own_look(p - origin_, radius_m, doubt_m);
  for (const RangeView& other : others_) {
    const Eigen::Vector3f ray = p - other.origin_;
    // Nearer, a lidar that is not the reference meets its own vehicle.
    if (!(ray.norm() > static_cast<float>(localization::kOwnVehicleM))) continue;
    all = both(all, other.own_look(ray, radius_m, doubt_m));
  }
  return all;
}

// --- what a box hides and what passes through it

namespace {

/// A return this far outside of the box still belongs to it [m]: range noise and the box's fit.
constexpr double kSkinM = 0.1;

/// Only rays through this middle part of the length and width, and below this part of the height,
/// tell whether the box is empty: a car leaves the corners of its box and what is above its bonnet
/// free.
constexpr double kCoreAcross = 0.6;
constexpr double kCoreUp = 0.8;

/// Unit directions of columns and rows.
struct Directions {
  std::array<Eigen::Vector2d, ViewGrid::kColumns> columns;
  std::array<Eigen::Vector2d, ViewGrid::kRows> rows;  ///< cosine, sine of the elevation
  Directions() {
    for (int i = 0; i < ViewGrid::kColumns; ++i) {
      const double a = ViewGrid::azimuth_of(i);
      columns[static_cast<std::size_t>(i)] = {std::cos(a), std::sin(a)};
    }
    for (int i = 0; i < ViewGrid::kRows; ++i) {
      const double a = ViewGrid::elevation_of(i);
      rows[static_cast<std::size_t>(i)] = {std::cos(a), std::sin(a)};
    }
  }
};

const Directions& directions() {
  static const Directions all;
  return all;
}

/// Ranges at which a ray enters and leaves [m]; it misses when enter > leave.
struct Crossing {
  double enter, leave;
  [[nodiscard]] bool hits() const { return enter <= leave; }
};

/// A box with the sensor at a place of its own frame (x along the heading).
struct BoxFrame {
  Eigen::Vector3d half, sensor;
  double cos_yaw, sin_yaw;

  explicit BoxFrame(const maps::Box& box)
      : half(0.5 * box.size_m), cos_yaw(std::cos(box.yaw_rad)), sin_yaw(std::sin(box.yaw_rad)) {
    sensor = turned(-box.centre);
  }
  [[nodiscard]] Eigen::Vector3d turned(const Eigen::Vector3d& v) const {
    return {cos_yaw * v.x() + sin_yaw * v.y(), cos_yaw * v.y() - sin_yaw * v.x(), v.z()};
  }
  /// Over the box's bottom.
  [[nodiscard]] double height_at(const Eigen::Vector3d& direction, double range_m) const {
    return half.z() + sensor.z() + range_m * direction.z();
  }

  [[nodiscard]] Crossing whole(const Eigen::Vector3d& direction) const {
    return between(-half, half, direction);
  }
  [[nodiscard]] Crossing core(const Eigen::Vector3d& direction) const {
    const Eigen::Vector3d low(-kCoreAcross * half.x(), -kCoreAcross * half.y(), -half.z());
    const Eigen::Vector3d high(-low.x(), -low.y(), (2.0 * kCoreUp - 1.0) * half.z());
    return between(low, high, direction);
  }

 private:
  [[nodiscard]] Crossing between(const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                                 const Eigen::Vector3d& direction) const {
    Crossing crossing{0.0, std::numeric_limits<double>::infinity()};
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const double inverse = 1.0 / direction[axis];
      const double a = (low[axis] - sensor[axis]) * inverse;
      const double b = (high[axis] - sensor[axis]) * inverse;
      crossing.enter = std::max(crossing.enter, std::min(a, b));
      crossing.leave = std::min(crossing.leave, std::max(a, b));
    }
    return crossing;
  }
};

/// Ranges of a direction's returns [m]: of the nearest that is not ground, infinite without one,
/// and of the farthest.
struct Returns {
  double nearest, farthest;
};

void add(BoxRays& rays, const BoxFrame& box, const Eigen::Vector3d& direction,
         const Returns& returns) {
  const Crossing whole = box.whole(direction);
  if (!whole.hits()) return;
  const double height_in = box.height_at(direction, whole.enter);
  if (std::max(height_in, box.height_at(direction, whole.leave)) < kRayFloorM) return;
  if (returns.nearest >= whole.enter - kSkinM && returns.nearest <= whole.leave + kSkinM) {
    ++rays.inside;
  } else if (!box.core(direction).hits()) {
    return;
  } else if (returns.nearest < whole.enter || returns.farthest < whole.enter) {
    ++rays.before;
  } else if (returns.farthest > whole.leave || height_in >= kRayFloorM) {
    // The latter ended on the ground inside of the box.
    ++rays.through;
  }
}

/// Columns and rows that hold the box, seen from the origin.
struct Extent {
  int row_begin = ViewGrid::kRows, row_end = 0, column_begin = 0, column_end = 0;
};

Extent extent_of(const maps::Box& box) {
  const double centre_azimuth = std::atan2(box.centre.y(), box.centre.x());
  const double c = std::cos(box.yaw_rad), s = std::sin(box.yaw_rad);
  double left = 0.0, right = 0.0;
  Extent extent;
  double nearest = std::numeric_limits<double>::infinity();
  for (int corner = 0; corner < 4; ++corner) {
    const double x = ((corner & 1) != 0 ? 0.5 : -0.5) * box.size_m.x();
    const double y = ((corner & 2) != 0 ? 0.5 : -0.5) * box.size_m.y();
    const Eigen::Vector2d p = box.centre.head<2>() + Eigen::Vector2d(c * x - s * y, s * x + c * y);
    const double off =
        std::remainder(std::atan2(p.y(), p.x()) - centre_azimuth, 2.0 * std::numbers::pi);
    left = std::max(left, off);
    right = std::min(right, off);
    nearest = std::min(nearest, p.norm());
  }
  // A side may be nearer than its ends: its foot point is at worst half a side from a corner.
  nearest = std::max(0.1, nearest - 0.5 * box.size_m.head<2>().maxCoeff());
  const double farthest = box.centre.head<2>().norm() + box.size_m.head<2>().norm();
  const double bottom = box.centre.z() - 0.5 * box.size_m.z();
  const double top = box.centre.z() + 0.5 * box.size_m.z();
  const double low = std::atan2(bottom, bottom < 0.0 ? nearest : farthest);
  const double high = std::atan2(top, top > 0.0 ? nearest : farthest);
  extent.row_begin = ViewGrid::row_of(static_cast<float>(low));
  extent.row_end = ViewGrid::row_of(static_cast<float>(high)) + 1;
  extent.column_begin = ViewGrid::column_of(static_cast<float>(centre_azimuth + right));
  extent.column_end = ViewGrid::column_of(static_cast<float>(centre_azimuth + left)) + 1;
  return extent;
}

}  // namespace

BoxRays RangeView::count(const maps::Box& box) const {
  BoxRays rays = own_count(box);
  for (const RangeView& other : others_) rays += other.own_count(box);
  return rays;
}

BoxRays RangeView::own_count(const maps::Box& box_in_frame) const {
  BoxRays rays;
  maps::Box box = box_in_frame;
  box.centre -= origin_.cast<double>();
  if (!(box.centre.allFinite() && box.size_m.allFinite() && std::isfinite(box.yaw_rad) &&
        box.size_m.minCoeff() > 0.0))
    return rays;
  const BoxFrame frame(box);
  // From inside of the box every direction leaves it, and none tells whether it is there.
  if ((frame.sensor.cwiseAbs() - frame.half).maxCoeff() <= 0.0) return rays;
  const Extent extent = extent_of(box);
  const Directions& all = directions();
  const int row_end = std::min(extent.row_end, end_row());
  for (int row = std::max(extent.row_begin, first_row_); row < row_end; ++row) {
    const Eigen::Vector2d& slope = all.rows[static_cast<std::size_t>(row)];
    for (int column = extent.column_begin; column < extent.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.farthest == 0) continue;
      const Eigen::Vector2d& heading =
          all.columns[static_cast<std::size_t>(ViewGrid::wrapped(column))];
      const Eigen::Vector3d direction(slope.x() * heading.x(), slope.x() * heading.y(), slope.y());
      add(rays, frame, frame.turned(direction),
          {b.nearest == kNone ? std::numeric_limits<double>::infinity()
                              : b.nearest * static_cast<double>(kQuantumM),
           b.farthest * static_cast<double>(kQuantumM)});
    }
  }
  return rays;
}

// --- as bytes

namespace {

/// What a bin holds, two bits each: most have one range, so that a view takes half the space.
enum : unsigned { kEmpty = 0, kGroundOnly = 1, kOneSurface = 2, kTwoRanges = 3 };

constexpr std::size_t kHeaderBytes = sizeof(Eigen::Vector3f) + 4;
constexpr std::size_t kKindBytesPerRow = ViewGrid::kColumns / 4;

void put(std::string& bytes, std::uint16_t value) {
  bytes.push_back(static_cast<char>(value & 0xFFU));
  bytes.push_back(static_cast<char>(value >> 8U));
}

std::uint16_t get(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[at]) |
                                    (static_cast<unsigned char>(bytes[at + 1]) << 8U));
}

}  // namespace

// A lidar each: its place; first row, rows; a row each: its kinds (all zero for an empty row); then
// the ranges in order.
std::string RangeView::to_bytes() const {
  std::string bytes;
  add_bytes(bytes);
  for (const RangeView& other : others_) other.add_bytes(bytes);
  return bytes;
}

void RangeView::add_bytes(std::string& all) const {
  const std::size_t rows = bins_.size() / ViewGrid::kColumns;
  std::string bytes(sizeof origin_, '\0'), ranges;
  std::memcpy(bytes.data(), origin_.data(), sizeof origin_);
  put(bytes, static_cast<std::uint16_t>(first_row_));
  put(bytes, static_cast<std::uint16_t>(rows));
  bytes.resize(kHeaderBytes + rows * kKindBytesPerRow);
  ranges.reserve(2 * bins_.size());
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    const Bin& b = bins_[i];
    unsigned kind = kEmpty;
    if (b.farthest != 0)
      kind = b.nearest == kNone ? kGroundOnly : b.nearest == b.farthest ? kOneSurface : kTwoRanges;
    char& packed = bytes[kHeaderBytes + i / 4];
    packed = static_cast<char>(static_cast<unsigned char>(packed) | (kind << (2U * (i % 4))));
    if (kind == kTwoRanges) put(ranges, b.nearest);
    if (kind != kEmpty) put(ranges, b.farthest);
  }
  all += bytes;
  all += ranges;
}

RangeView RangeView::from_bytes(std::string_view bytes) {
  std::size_t at = 0;
  RangeView view = one_from_bytes(bytes, at);
  while (at < bytes.size()) view.others_.push_back(one_from_bytes(bytes, at));
  return view;
}

RangeView RangeView::one_from_bytes(std::string_view bytes, std::size_t& at) {
  const std::size_t begin = at + sizeof origin_;
  if (bytes.size() < begin + 4) throw std::invalid_argument("range view: shorter than its head");
  RangeView view;
  std::memcpy(view.origin_.data(), bytes.data() + at, sizeof origin_);
  view.first_row_ = get(bytes, begin);
  const std::size_t rows = get(bytes, begin + 2);
  const std::size_t kinds = begin + 4;
  at = kinds + rows * kKindBytesPerRow;
  if (static_cast<std::size_t>(view.first_row_) + rows > ViewGrid::kRows || at > bytes.size())
    throw std::invalid_argument("range view: more rows than bytes");
  view.bins_.resize(rows * ViewGrid::kColumns);
  const auto next = [&] {
    if (at + 2 > bytes.size()) throw std::invalid_argument("range view: ranges end too early");
    at += 2;
    return get(bytes, at - 2);
  };
  for (std::size_t i = 0; i < view.bins_.size(); ++i) {
    const auto packed = static_cast<unsigned char>(bytes[kinds + i / 4]);
    const unsigned kind = (packed >> (2U * (i % 4))) & 3U;
    if (kind == kEmpty) continue;
    Bin& b = view.bins_[i];
    if (kind == kTwoRanges) b.nearest = next();
    b.farthest = next();
    if (kind == kOneSurface) b.nearest = b.farthest;
  }
  return view;
}

}  // namespace stillmap::mapping
