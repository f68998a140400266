#pragma once

#include "derived/derived_worker.hpp"

#include <stillmap/localization/aligner.hpp>

#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace stillmap::server {

/// Made in the background when the first query asks for it, since few maps are ever asked for a
/// reference method. Until then queries are told to come back, so that none holds a worker
/// meanwhile. Safe from several threads.
class LazyAligner final : public localization::Aligner {
 public:
  using Maker = std::function<std::unique_ptr<const localization::Aligner>()>;

  /// @param what    as messages name it. @param make  may take seconds; run once, unless it fails,
  ///                perhaps when this is gone. @param worker  outlives this.
  LazyAligner(std::string what, Maker make, DerivedWorker& worker);
  ~LazyAligner() override;

  /// @throws ApiError kMapLoading while it is being made, kMapUnusable when that has just failed,
  /// kBusy when too much else is to be made; each with Retry-After.
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& prior) const override;

 private:
  struct State;
  [[nodiscard]] std::shared_ptr<const localization::Aligner> made() const;

  std::string what_;
  std::shared_ptr<State> state_;
  DerivedWorker& worker_;
};

}  // namespace stillmap::server
