#pragma once

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/mapping/progress_lines.hpp>

#include <CLI/CLI.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "mapper/slurm_build.hpp"

namespace stillmap::mapper {

/// Options of `build` and `rebuild` that share one build between processes.
struct UnitArguments {
  std::size_t units = 0;
  std::string list;
  std::filesystem::path plan;
  ExecutorArguments executor;
};

/// @param unit_help  what `--unit` of this command does.
void add_unit_options(CLI::App& command, UnitArguments& arguments, const char* unit_help);
/// `--plan`, after them.
void add_plan_option(CLI::App& command, UnitArguments& arguments);

/// @throws std::invalid_argument for `--units` without an option that says what becomes of them,
///         and for options of a cluster without one.
void require_usable(const UnitArguments& arguments);
/// Those to do; none: the whole build. @throws std::invalid_argument naming the option.
[[nodiscard]] std::vector<mapping::BuildUnit> units_to_do(const UnitArguments& arguments);

/// Writes the commands of all units to `arguments.plan`: a line each, an empty line between steps.
/// @param command  `build` as it was called.
/// @throws std::invalid_argument for options that units cannot build with.
void write_plan(const UnitArguments& arguments, const mapping::MapBuildOptions& options,
                const CLI::App& command);

/// Tells of the stages of a unit under its name.
[[nodiscard]] mapping::ProgressCallback under_unit(const mapping::BuildUnit& unit,
                                                   const mapping::ProgressCallback& progress);

/// Of the progress of some units; stages are named `UNIT: STAGE`.
[[nodiscard]] std::vector<mapping::StageShare> stages_of(
    const std::vector<mapping::BuildUnit>& units, bool registers);

}  // namespace stillmap::mapper
