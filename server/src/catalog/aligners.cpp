#include "catalog/aligners.hpp"

#include <spdlog/spdlog.h>

#include <memory>
#include <mutex>
#include <optional>

namespace stillmap::server {
namespace {

/// Makes its aligner when the first query asks for it, since few maps are ever asked for a
/// reference method. A failure is thrown at that query and tried again at the next.
class LazyAligner : public localization::Aligner {
 public:
  /// @param map  outlives this.
  LazyAligner(std::string method, const maps::MapPackage& map)
      : method_(std::move(method)), map_(map) {}

  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& prior) const override {
    return made().align(scan_lidar, prior);
  }

 private:
  const localization::Aligner& made() const {
    const std::scoped_lock lock(mutex_);
    if (!aligner_) aligner_ = localization::make_aligner(method_, map_);
    return *aligner_;
  }

  std::string method_;
  const maps::MapPackage& map_;
  mutable std::mutex mutex_;
  mutable std::unique_ptr<const localization::Aligner> aligner_;
};

}  // namespace

Aligners build_aligners(const maps::MapPackage& map) {
  const std::shared_ptr<const localization::MapIndex> index = localization::MapIndex::open(map);
  if (!index->rebuilt_because().empty()) {
    spdlog::info("index of {} was built, since no usable one was there: {}", map.folder().string(),
                 index->rebuilt_because());
  }
  if (!index->kept_in_memory_because().empty()) {
    spdlog::warn("index of {} is kept in memory and will be built again: {}", map.folder().string(),
                 index->kept_in_memory_because());
  }
  const std::vector<Eigen::Isometry3d> seen_from = localization::seen_from(map);
  Aligners aligners;
  for (const std::string& method : localization::aligner_names()) {
    if (aligners.empty()) {
      aligners.emplace_back(method, localization::make_aligner(method, index, seen_from));
    } else {
      aligners.emplace_back(method, std::make_shared<const LazyAligner>(method, map));
    }
  }
  return aligners;
}

}  // namespace stillmap::server
