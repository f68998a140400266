#pragma once

#include "jobs/job_folder.hpp"
#include "jobs/job_request.hpp"

#include <stillmap/server/server_options.hpp>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// Beside this program, or where it is installed; empty when it is at neither.
[[nodiscard]] std::filesystem::path find_mapper();

/// Whether a rebuild's work goes on without its process here.
[[nodiscard]] bool runs_in_cluster(const JobOptions& jobs);

/// What a rebuild reads besides its own folder.
struct RebuildSources {
  std::vector<std::filesystem::path> drives;
  std::optional<std::filesystem::path> held_back;
  /// Package of the version that was active.
  std::optional<std::filesystem::path> previous;
};

/// Command lines of the mapper, program first (mapping/rebuild.md, mapping/registration.md). Every
/// text in them is ours, a path of ours, or one of the words that a client may choose from.
[[nodiscard]] std::vector<std::string> rebuild_command(const std::filesystem::path& mapper,
                                                       const RebuildRequest& request,
                                                       const RebuildSources& sources,
                                                       const JobFolder& folder,
                                                       const JobOptions& jobs);
[[nodiscard]] std::vector<std::string> estimate_command(const std::filesystem::path& mapper,
                                                        const RebuildRequest& request,
                                                        const RebuildSources& sources);
[[nodiscard]] std::vector<std::string> convert_command(const std::filesystem::path& mapper,
                                                       const std::filesystem::path& file,
                                                       const JobFolder& folder, int threads);
/// The limits of the gate, as the mapper reads them.
[[nodiscard]] std::string gate_json(const QualityGateOptions& gate);

}  // namespace stillmap::server
