#include "session_state.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

namespace stillmap::localization {

static_assert(std::endian::native == std::endian::little, "states are little-endian");

namespace {

constexpr std::uint8_t kFormat = 1;
/// Of the byte of flags.
constexpr std::uint8_t kMatched = 1, kHasAnchor = 2, kHasNewest = 4, kNewestIsAnchor = 8,
                       kConfirmed = 16, kAllFlags = 31;
/// Counts grow by one a scan; beyond this none is true.
constexpr std::int32_t kMostCount = 1 << 30;
constexpr double kMaxRotationError = 1e-3;

[[noreturn]] void refuse(const std::string& found, const std::string& expected) {
  throw maps::InputError("tracker's state", found,
                         expected + ": give the bytes back as they came, or start a new session");
}

template <typename Value>
void put(std::string& bytes, const Value& value) {
  static_assert(std::is_arithmetic_v<Value>);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

template <int kRows, int kColumns>
void put(std::string& bytes, const Eigen::Matrix<double, kRows, kColumns>& matrix) {
  bytes.append(reinterpret_cast<const char*>(matrix.data()), sizeof(double) * kRows * kColumns);
}

class Reader {
 public:
  explicit Reader(std::string_view bytes) : rest_(bytes) {}

  template <typename Value>
  Value number() {
    static_assert(std::is_arithmetic_v<Value>);
    Value value;
    take(&value, sizeof(value));
    return value;
  }
  std::int32_t count(const char* what) {
    const auto value = number<std::int32_t>();
    if (value < 0 || value > kMostCount)
      refuse(fmt::format("{} {}", what, value), fmt::format("0 to {}", kMostCount));
    return value;
  }
  template <int kRows, int kColumns>
  Eigen::Matrix<double, kRows, kColumns> matrix() {
    Eigen::Matrix<double, kRows, kColumns> result;
    take(result.data(), sizeof(double) * kRows * kColumns);
    if (!result.allFinite()) refuse("a number that is not finite", "finite numbers");
    return result;
  }
  void require_end() const {
    if (!rest_.empty()) refuse(fmt::format("{} bytes too many", rest_.size()), "none");
  }

 private:
  void take(void* to, std::size_t size) {
    if (rest_.size() < size)
      refuse("the end of the bytes", fmt::format("{} more", size - rest_.size()));
    std::memcpy(to, rest_.data(), size);
    rest_.remove_prefix(size);
  }

  std::string_view rest_;
};

/// All bits of the numbers, so that whoever goes on computes the same.
void put(std::string& bytes, const MotionState& state) {
  put(bytes, state.stamp_ns);
  put<3, 3>(bytes, state.pose.T.linear());
  put<3, 1>(bytes, state.pose.T.translation());
  put(bytes, state.pose.covariance);
  put(bytes, state.twist);
  put(bytes, state.twist_covariance);
  put(bytes, state.drift_m);
  put(bytes, static_cast<std::int32_t>(state.odometry_steps));
}

Eigen::Isometry3d read_pose(Reader& from) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = from.matrix<3, 3>();
  T.translation() = from.matrix<3, 1>();
  const Eigen::Matrix3d R = T.linear();
  const Eigen::Matrix3d off = R.transpose() * R - Eigen::Matrix3d::Identity();
  if (!(off.cwiseAbs().maxCoeff() < kMaxRotationError) || !(R.determinant() > 0.0))
    refuse("a pose that is not rigid", "a rotation and a translation");
  return T;
}

/// @param newest_ns  no state is newer.
MotionState read_motion(Reader& from, std::int64_t newest_ns) {
  MotionState state;
  state.stamp_ns = from.number<std::int64_t>();
  if (state.stamp_ns > newest_ns) refuse("a pose that is newer than the scans", "none");
  state.pose.T = read_pose(from);
  state.pose.covariance = from.matrix<6, 6>();
  state.twist = from.matrix<6, 1>();
  state.twist_covariance = from.matrix<6, 6>();
  state.drift_m = from.number<double>();
  if (!(state.drift_m >= 0.0) || !std::isfinite(state.drift_m))
    refuse(fmt::format("a drift of {} m", state.drift_m), "0 or more");
  state.odometry_steps = from.count("odometry steps");
  return state;
}

/// Equal to the bit.
bool is_same(const MotionState& a, const MotionState& b) {
  std::string of_a, of_b;
  put(of_a, a);
  put(of_b, b);
  return of_a == of_b;
}

void require_flags(std::uint8_t flags) {
  const auto needs = [&](std::uint8_t one, std::uint8_t other) {
    return (flags & one) == 0 || (flags & other) == other;
  };
  if ((flags & ~kAllFlags) != 0 || !needs(kNewestIsAnchor, kHasNewest | kHasAnchor) ||
      !needs(kConfirmed, kHasNewest))
    refuse(fmt::format("flags {}", flags), "those that localization/sessions.md lists");
}

}  // namespace

std::string encode_state(const TrackingState& state) {
  const TrackingBelief& belief = state.belief;
  const bool newest_is_anchor =
      state.newest && belief.anchor && is_same(state.newest->state, *belief.anchor);
  std::uint8_t flags = 0;
  if (belief.matched) flags |= kMatched;
  if (belief.anchor) flags |= kHasAnchor;
  if (state.newest) flags |= kHasNewest;
  if (newest_is_anchor) flags |= kNewestIsAnchor;
  if (state.newest && state.newest->confirmed) flags |= kConfirmed;
  std::string bytes;
  put(bytes, kFormat);
  put(bytes, static_cast<std::uint8_t>(belief.mode));
  put(bytes, flags);
  put(bytes, state.newest_ns);
  put(bytes, belief.matched_ns);
  put(bytes, static_cast<std::int32_t>(belief.agreed));
  put(bytes, static_cast<std::int32_t>(belief.contradictions));
  put(bytes, static_cast<std::int32_t>(belief.misses));
  if (belief.anchor) put(bytes, *belief.anchor);
  if (state.newest && !newest_is_anchor) put(bytes, state.newest->state);
  return bytes;
}

TrackingState decode_state(std::string_view bytes) {
  Reader from(bytes);
  if (const auto format = from.number<std::uint8_t>(); format != kFormat)
    refuse(fmt::format("format {}", format), fmt::format("{}", kFormat));
  TrackingState state;
  TrackingBelief& belief = state.belief;
  const auto mode = from.number<std::uint8_t>();
  if (mode > static_cast<std::uint8_t>(TrackingMode::kEverywhere))
    refuse(fmt::format("mode {}", mode), "0 to 2");
  belief.mode = static_cast<TrackingMode>(mode);
  const auto flags = from.number<std::uint8_t>();
  require_flags(flags);
  const auto has = [&](std::uint8_t flag) { return (flags & flag) != 0; };
  belief.matched = has(kMatched);
  state.newest_ns = from.number<std::int64_t>();
  belief.matched_ns = from.number<std::int64_t>();
  if (belief.matched && belief.matched_ns > state.newest_ns)
    refuse("a match newer than the scans", "none");
  belief.agreed = from.count("agreeing answers");
  belief.contradictions = from.count("contradictions");
  belief.misses = from.count("misses");
  if (has(kHasAnchor)) belief.anchor = read_motion(from, state.newest_ns);
  if (has(kNewestIsAnchor)) {
    state.newest = TrackingHistory::Known{*belief.anchor, has(kConfirmed)};
  } else if (has(kHasNewest)) {
    state.newest = TrackingHistory::Known{read_motion(from, state.newest_ns), has(kConfirmed)};
  }
  if (state.newest && state.newest->state.stamp_ns != state.newest_ns)
    refuse("a pose of another scan", "one of the newest scan");
  from.require_end();
  return state;
}

}  // namespace stillmap::localization
