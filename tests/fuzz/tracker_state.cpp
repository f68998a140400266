// The state of a tracker, as the program writes it: what is taken is written again as it was, and
// the tracker goes on from it. The first byte says how the next scans are answered.
#include "fuzz_target.hpp"
#include "support/synthetic_world.hpp"
#include "tracking/session_state.hpp"

#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/error.hpp>

#include <limits>
#include <memory>
#include <stdexcept>

namespace {

using namespace stillmap;

class AlignerOfBits : public localization::Aligner {
 public:
  explicit AlignerOfBits(std::uint8_t bits) : bits_(bits) {}
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud&, const std::optional<localization::Prior>& prior) const override {
    localization::AlignmentResult result;
    const bool found = (bits_ >> calls_++ % 8 & 1U) != 0;
    if (!found) return result;
    result.status = localization::PoseStatus::kOk;
    result.T_map_lidar = prior ? prior->T_map_lidar : test::pose_at(1.0, 2.0);
    result.covariance = 1e-3 * Eigen::Matrix<double, 6, 6>::Identity();
    return result;
  }

 private:
  std::uint8_t bits_;
  mutable unsigned calls_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes = fuzz::text_of(data + 1, size - 1);
  const auto state =
      fuzz::taken<maps::InputError>([&] { return localization::decode_state(bytes); });
  if (!state) return 0;
  const std::string written = localization::encode_state(*state);
  fuzz::require(bytes.size() <= localization::kMaxTrackerStateBytes, "states are bounded");
  fuzz::require(written.size() <= bytes.size(), "a state is written as short as it can be");
  fuzz::require(localization::encode_state(localization::decode_state(written)) == written,
                "what is written is read again");
  localization::Tracker tracker =
      localization::Tracker::restored(std::make_shared<AlignerOfBits>(data[0]), {}, bytes);
  std::int64_t stamp_ns = state->newest_ns;
  for (int k = 0; k < 4 && stamp_ns < std::numeric_limits<std::int64_t>::max() - 200'000'000; ++k) {
    stamp_ns += 100'000'000;
    // A prediction that is nowhere is the aligner's to refuse.
    if (!fuzz::taken<std::invalid_argument>([&] { return tracker.track(stamp_ns, {}); })) return 0;
    fuzz::require(tracker.newest_ns() == stamp_ns, "it goes on");
    fuzz::require(tracker.state().size() <= localization::kMaxTrackerStateBytes,
                  "states stay bounded");
  }
  return 0;
}
