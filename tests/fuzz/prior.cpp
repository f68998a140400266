// Numbers of a prior, a mount and a box, from bytes: 3 + 4 + 36 + 7 doubles, zeros where bytes end.
#include "pose_rules.hpp"

#include <array>
#include <cstring>

namespace {

using namespace stillmap;

template <std::size_t kCount>
std::array<double, kCount> take(std::string_view& bytes) {
  std::array<double, kCount> numbers{};
  const std::size_t size = std::min(sizeof(numbers), bytes.size());
  std::memcpy(numbers.data(), bytes.data(), size);
  bytes.remove_prefix(size);
  return numbers;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view bytes = fuzz::text_of(data, size);
  const auto position = take<3>(bytes);
  const auto quaternion = take<4>(bytes);
  auto values = take<36>(bytes);
  server::PoseParameters parameters;
  if (const auto T = fuzz::taken<server::ApiError>([&] {
        return server::checked_pose(position, quaternion,
                                    {server::ErrorCode::kInvalidPrior, "t", "q"});
      })) {
    parameters.prior = localization::Prior{.T_map_lidar = *T, .covariance = {}};
    parameters.T_base_lidar = *T;
  }
  // As it is, and made symmetric: few mutations would be.
  for (const bool mirrored : {false, true}) {
    for (std::size_t i = 0; mirrored && i < 36; ++i) values[i] = values[(i % 6) * 6 + i / 6];
    const auto covariance = fuzz::taken<server::ApiError>(
        [&] { return server::checked_prior_covariance(std::span<const double, 36>(values), "c"); });
    if (covariance && parameters.prior) {
      parameters.prior->covariance = *covariance;
      localization::AlignmentResult result;
      result.covariance = *covariance;
      static_cast<void>(localization::contradicts(*parameters.prior, result));
      static_cast<void>(localization::protection_levels(*covariance));
      static_cast<void>(localization::protection_levels_in_base(result, *parameters.T_base_lidar));
    }
    fuzz::require_bounds(parameters);
  }
  const auto box = fuzz::taken<server::ApiError>(
      [&] { return server::checked_box(take<3>(bytes), take<3>(bytes), take<1>(bytes)[0], "b"); });
  if (!box) return 0;
  maps::PointCloud cloud;
  cloud.positions = {box->centre.cast<float>(), Eigen::Vector3f(1.0F, 2.0F, 3.0F)};
  static_cast<void>(localization::without_points_in(cloud, std::span(&*box, 1)));
  return 0;
}
