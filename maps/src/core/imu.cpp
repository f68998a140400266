#include <stillmap/maps/imu.hpp>

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

/// Readings farther apart tell nothing of the turn between them [ns].
constexpr std::int64_t kMostGapNs = 50'000'000;
constexpr double kGravity = 9.80665;

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

/// The lidar's orientation against that at a first stamp, at each reading until a last one.
struct Turns {
  std::vector<std::int64_t> times_ns;
  std::vector<Eigen::Matrix3d> R_first_then;
};

/// @param from_ns, to_ns  by the IMU's clock; from <= to.
/// @return nothing where readings are missing.
std::optional<Turns> turns_between(std::span<const ImuReading> readings,
                                   const Eigen::Vector3d& bias, std::int64_t from_ns,
                                   std::int64_t to_ns) {
  auto next = std::ranges::upper_bound(readings, from_ns, {}, &ImuReading::stamp_ns);
  if (next == readings.begin()) return std::nullopt;
  Turns turns{{from_ns}, {Eigen::Matrix3d::Identity()}};
  for (; turns.times_ns.back() < to_ns; ++next) {
    if (next == readings.end()) return std::nullopt;
    const ImuReading& before = *(next - 1);
    const std::int64_t gap_ns = next->stamp_ns - before.stamp_ns;
    if (gap_ns > kMostGapNs) return std::nullopt;
    const std::int64_t begin_ns = turns.times_ns.back();
    const std::int64_t end_ns = std::min(next->stamp_ns, to_ns);
    // The rate between two readings is linear in time; its middle value counts.
    const double share = (seconds(begin_ns - before.stamp_ns) + seconds(end_ns - before.stamp_ns)) /
                         (2.0 * seconds(gap_ns));
    const Eigen::Vector3d rate = (1.0 - share) * before.rate_radps.cast<double>() +
                                 share * next->rate_radps.cast<double>() - bias;
    turns.R_first_then.push_back(turns.R_first_then.back() *
                                 exp_so3(rate * seconds(end_ns - begin_ns)));
    turns.times_ns.push_back(end_ns);
  }
  return turns;
}

bool is_finite(const ImuReading& reading) {
  return reading.rate_radps.allFinite() && reading.force_mps2.allFinite();
}

}  // namespace

double Imu::rate_hz() const {
  return static_cast<double>(readings->size() - 1) /
         seconds(readings->back().stamp_ns - readings->front().stamp_ns);
}

double Imu::longest_gap_s() const {
  std::int64_t longest_ns = 0;
  for (std::size_t i = 1; i < readings->size(); ++i)
    longest_ns = std::max(longest_ns, (*readings)[i].stamp_ns - (*readings)[i - 1].stamp_ns);
  return seconds(longest_ns);
}

std::shared_ptr<const std::vector<ImuReading>> usable_readings(std::vector<ImuReading> readings,
                                                               const std::string& source,
                                                               std::vector<std::string>& notes) {
  const std::size_t all = readings.size();
  std::erase_if(readings, [](const ImuReading& reading) { return !is_finite(reading); });
  std::ranges::stable_sort(readings, {}, &ImuReading::stamp_ns);
  const auto again = std::ranges::unique(readings, {}, &ImuReading::stamp_ns);
  readings.erase(again.begin(), again.end());
  if (readings.size() < all)
    notes.push_back(
        fmt::format("{}: {} of {} readings left out, which are not finite or have the "
                    "stamp of another one",
                    source, all - readings.size(), all));
  if (readings.size() < 2) return nullptr;
  std::vector<double> norms;
  for (std::size_t i = 0; i < std::min<std::size_t>(readings.size(), 10'000); ++i)
    norms.push_back(static_cast<double>(readings[i].force_mps2.norm()));
  const double usual = median(std::move(norms));
  if (usual > 0.9 && usual < 1.1) {
    for (ImuReading& reading : readings) reading.force_mps2 *= static_cast<float>(kGravity);
    notes.push_back(
        fmt::format("{}: acceleration with a median of {:.2f}, taken as g", source, usual));
  }
  return std::make_shared<const std::vector<ImuReading>>(std::move(readings));
}

SweepTurn::SweepTurn(std::vector<float> times_s, std::vector<Eigen::Matrix3f> R_stamp_then)
    : times_s_(std::move(times_s)), R_stamp_then_(std::move(R_stamp_then)) {
  if (times_s_.size() < 2 || times_s_.size() != R_stamp_then_.size())
    throw std::invalid_argument(
        fmt::format("SweepTurn: {} times and {} rotations", times_s_.size(), R_stamp_then_.size()));
}

Eigen::Matrix3f SweepTurn::at(float time_s) const {
  if (is_none()) return Eigen::Matrix3f::Identity();
  const auto after = std::ranges::upper_bound(times_s_, time_s);
  const auto next = std::clamp<std::ptrdiff_t>(after - times_s_.begin(), 1,
                                               static_cast<std::ptrdiff_t>(times_s_.size()) - 1);
  const auto i = static_cast<std::size_t>(next);
  const float step_s = times_s_[i] - times_s_[i - 1];
  const float share = step_s > 0.0F ? (time_s - times_s_[i - 1]) / step_s : 1.0F;
  return R_stamp_then_[i - 1] +
         std::clamp(share, 0.0F, 1.0F) * (R_stamp_then_[i] - R_stamp_then_[i - 1]);
}

std::optional<Eigen::Matrix3d> turn_between_stamps(std::span<const ImuReading> readings,
                                                   const Imu::Fit& fit, std::int64_t from_ns,
                                                   std::int64_t to_ns) {
  const auto turns =
      turns_between(readings, fit.bias_radps, std::min(from_ns, to_ns) - fit.clock_offset_ns,
                    std::max(from_ns, to_ns) - fit.clock_offset_ns);
  if (!turns) return std::nullopt;
  const Eigen::Matrix3d& R = turns->R_first_then.back();
  return from_ns <= to_ns ? R : Eigen::Matrix3d(R.transpose());
}

std::shared_ptr<const SweepTurn> turn_of(const Scan& scan, std::span<const ImuReading> readings,
                                         const Imu::Fit& fit) {
  const std::vector<float>& times_s = scan.cloud.time_offsets_s;
  if (times_s.empty()) return nullptr;
  const auto [first_s, last_s] = std::ranges::minmax(times_s);
  const auto ns = [](float s) { return std::llround(1e9 * static_cast<double>(s)); };
  const std::int64_t first_ns = scan.stamp_ns + ns(first_s);
  const std::int64_t last_ns = scan.stamp_ns + ns(last_s);
  if (first_ns == last_ns) return nullptr;
  const auto turns = turns_between(readings, fit.bias_radps, first_ns - fit.clock_offset_ns,
                                   last_ns - fit.clock_offset_ns);
  const auto R_stamp_first = turn_between_stamps(readings, fit, scan.stamp_ns, first_ns);
  if (!turns || !R_stamp_first) return nullptr;
  std::vector<float> at_s;
  std::vector<Eigen::Matrix3f> R_stamp_then;
  for (std::size_t i = 0; i < turns->times_ns.size(); ++i) {
    at_s.push_back(
        static_cast<float>(seconds(turns->times_ns[i] + fit.clock_offset_ns - scan.stamp_ns)));
    R_stamp_then.push_back((*R_stamp_first * turns->R_first_then[i]).cast<float>());
  }
  return std::make_shared<const SweepTurn>(std::move(at_s), std::move(R_stamp_then));
}

void turn_to_stamp(PointCloud& cloud) {
  if (!cloud.turn || cloud.turn->is_none()) return;
  for (std::size_t i = 0; i < cloud.time_offsets_s.size(); ++i)
    cloud.positions[i] = cloud.turn->at(cloud.time_offsets_s[i]) * cloud.positions[i];
  cloud.turn = std::make_shared<const SweepTurn>();
}

}  // namespace stillmap::maps
