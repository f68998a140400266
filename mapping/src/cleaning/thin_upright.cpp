#include "cleaning/thin_upright.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr float kCoreM = 0.25F;
constexpr float kRingM = 0.6F;
constexpr float kSliceM = 0.25F;
constexpr int kSlices = 5;
/// Of the slices of a stretch.
constexpr int kFilled = 4;
constexpr std::size_t kRingPerCore = 5;

/// Points by squares of the ground plan, as wide as the ring.
class Squares {
 public:
  explicit Squares(std::span<const Eigen::Vector3f> positions) : positions_(positions) {
    for (std::uint32_t i = 0; i < positions.size(); ++i)
      squares_[key(square(positions[i]))].push_back(i);
  }

  template <typename Visit>
  void around(const Eigen::Vector3f& p, const Visit& visit) const {
    const Eigen::Vector2i centre = square(p);
    for (int n = 0; n < 9; ++n) {
      const std::vector<std::uint32_t>* numbers =
          squares_.find(key(centre + Eigen::Vector2i(n % 3 - 1, n / 3 - 1)));
      if (numbers == nullptr) continue;
      for (const std::uint32_t i : *numbers) visit(positions_[i]);
    }
  }

 private:
  [[nodiscard]] static Eigen::Vector2i square(const Eigen::Vector3f& p) {
    return (p.head<2>() / kRingM).array().floor().cast<int>();
  }
  [[nodiscard]] static std::uint64_t key(const Eigen::Vector2i& square) {
    return maps::plane_cell_key(square.x(), square.y());
  }

  std::span<const Eigen::Vector3f> positions_;
  maps::CellMap<std::vector<std::uint32_t>> squares_;
};

bool is_part_of_a_pole(const Squares& squares, const Eigen::Vector3f& p) {
  // The cell's own slice is in the middle.
  std::bitset<2 * kSlices - 1> filled;
  std::size_t core = 0, ring = 0;
  squares.around(p, [&](const Eigen::Vector3f& other) {
    const float up_m = other.z() - p.z() + 0.5F * kSliceM;
    const int slice = static_cast<int>(std::floor(up_m / kSliceM)) + kSlices - 1;
    if (slice < 0 || slice >= 2 * kSlices - 1) return;
    const float aside_m = (other.head<2>() - p.head<2>()).norm();
    if (aside_m <= kCoreM) {
      filled.set(static_cast<std::size_t>(slice));
      ++core;
    } else if (aside_m <= kRingM) {
      ++ring;
    }
  });
  if (kRingPerCore * ring > core) return false;
  for (std::size_t first = 0; first < kSlices; ++first) {
    int count = 0;
    for (std::size_t slice = first; slice < first + kSlices; ++slice)
      count += filled[slice] ? 1 : 0;
    if (count >= kFilled) return true;
  }
  return false;
}

}  // namespace

std::vector<std::uint8_t> thin_upright(std::span<const Eigen::Vector3f> positions,
                                       std::span<const std::uint8_t> wanted) {
  if (wanted.size() != positions.size())
    throw std::invalid_argument("wanted: expected one flag a point");
  std::vector<std::uint8_t> thin(positions.size());
  if (std::ranges::none_of(wanted, [](std::uint8_t flag) { return flag != 0; })) return thin;
  const Squares squares(positions);
  for (std::size_t i = 0; i < thin.size(); ++i)
    thin[i] = wanted[i] != 0 && is_part_of_a_pole(squares, positions[i]) ? 1 : 0;
  return thin;
}

}  // namespace stillmap::mapping
