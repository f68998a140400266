#pragma once

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/progress.hpp>

#include <CLI/CLI.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapper {

/// In the help, of the options that share one build.
inline constexpr const char* kUnitGroup = "One build by several processes";

/// Options of the commands that can build in Slurm.
struct ExecutorArguments {
  std::string executor = "process";
  std::vector<std::string> slurm_options;
  [[nodiscard]] bool is_slurm() const { return executor == "slurm"; }
};

void add_executor_options(CLI::App& command, ExecutorArguments& arguments);

/// One build as jobs in Slurm (mapping/units.md).
struct SlurmBuild {
  std::filesystem::path target;
  /// Does a unit once `--unit NAME` is added; program first.
  std::vector<std::string> command;
  /// Before the name of each unit.
  std::string prefix;
  std::size_t units = 1;
  /// Of each unit; 0 = a whole machine.
  int threads = 0;
  /// Of each unit.
  std::uint64_t memory_bytes = 0;
  /// For `sbatch`; they win over what is chosen here.
  std::vector<std::string> options;
};

/// What came of the jobs.
struct SlurmResult {
  /// What the unit `merge` printed; nothing where another process has followed the same jobs to
  /// their end, and told of it.
  std::optional<std::string> said;
  /// When this goes, the folder of the jobs is removed. To be kept until `said` is told.
  std::shared_ptr<void> jobs;
};

/// The command of a unit: this program, called as this one was, without options of the executor.
/// @param except  more options to leave out.
[[nodiscard]] std::vector<std::string> unit_command(const CLI::App& command,
                                                    const std::vector<std::string>& except);

/// Where the jobs of a build leave their logs, beside the map. It is removed when the map is made.
[[nodiscard]] std::filesystem::path slurm_folder(const std::filesystem::path& target);

/// Submits the jobs of a build and follows them until the map is at its place. Jobs of the same
/// build that are in Slurm already are followed, and not submitted again. Waits for another process
/// that follows them. When cancelled, it cancels them.
/// @throws std::runtime_error naming a unit that failed; mapping::Cancelled; maps::InputError for a
///         target that exists; maps::StorageError.
SlurmResult build_in_slurm(const SlurmBuild& build, const mapping::ProgressCallback& progress,
                           const mapping::CancelFlag& cancel);

}  // namespace stillmap::mapper
