#include <stillmap/localization/aligner.hpp>

#include "voxel_aligner.hpp"

#include <fmt/format.h>

#include <stdexcept>

namespace stillmap::localization {

std::string_view name_of(PoseStatus status) {
  switch (status) {
    case PoseStatus::kOk:
      return "ok";
    case PoseStatus::kDegraded:
      return "degraded";
    case PoseStatus::kLost:
      return "lost";
  }
  throw std::invalid_argument(fmt::format("PoseStatus: {}, unknown", static_cast<int>(status)));
}

std::vector<std::string> aligner_names() { return {"default"}; }

std::unique_ptr<Aligner> make_aligner(std::string_view method,
                                      std::shared_ptr<const MapIndex> index) {
  if (method == "default") return std::make_unique<VoxelAligner>(std::move(index));
  throw std::invalid_argument(fmt::format("method: found '{}', expected one of: {}", method,
                                          fmt::join(aligner_names(), ", ")));
}

}  // namespace stillmap::localization
